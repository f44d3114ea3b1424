"""Machine code on disk, by what it was made of; a file is used only if whole and this user's own.

A file holds its key and the hash of its content: one that is torn, altered or under another key's
name is made anew. Files and folder are for their owner only; those of others are not touched. A
folder that cannot be used costs time, never an error.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.files.caps import at_home
from rpctl.files.writing import write_atomically

FOLDER_VARIABLE = "RPCTL_CACHE_DIR"
MARK = b"rpctl machine code\n"
DIGEST = 32  # bytes
MOST_BYTES = 256 * 2**20  # of all files together; the least recently used go first
FOLDER_MODE, FILE_MODE = 0o700, 0o600
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def cached(key: bytes, make: Callable[[], bytes], anew: bool = False) -> bytes:
    """Return what is kept under a key; if nothing sound is, make it and keep it.

    Args:
        key: A hash of all that the content depends on.
        make: Makes it.
        anew: Whether to make it in any case.
    """
    folder = _own_folder()
    if folder is None:
        return make()
    file = folder / f"{key.hex()}.code"
    found = None if anew else _read(file, key)
    if found is None:
        found = make()
        keep(file, key, found)
    return found


@cache
def sources() -> str:
    """Return what tells the sources of this rpctl from others: sizes and times of its files."""
    folder = Path(__file__).parents[1]
    stats = ((file, file.stat()) for file in sorted(folder.rglob("*.py")))
    told = [(str(f.relative_to(folder)), s.st_size, s.st_mtime_ns) for f, s in stats]
    return repr((str(folder), told))


def keep(file: Path, key: bytes, content: bytes) -> None:
    """Write a file of the cache, or leave it; then remove the oldest ones beyond the bound.

    Args:
        file: The file.
        key: Its key.
        content: What is kept.
    """
    with suppress(OSError, RpctlError):  # no room, no right: it is made again the next time
        file.unlink(missing_ok=True)  # of another mode or owner, perhaps
        data = MARK + key + hashlib.sha256(key + content).digest() + content
        write_atomically(file, data, follow_links=False, mode=FILE_MODE)
        _remove_oldest(file.parent)


def cache_folder(environment: dict[str, str] | os._Environ[str] = os.environ) -> Path:
    """Return where rpctl keeps what it can make again: ``RPCTL_CACHE_DIR``, or the platform's.

    Args:
        environment: The variables.
    """
    given = environment.get(FOLDER_VARIABLE)
    if given:
        return at_home(given).absolute()
    home = at_home("~")
    if sys.platform == "darwin":
        return home / "Library/Caches/rpctl"
    if sys.platform == "win32":
        return Path(environment.get("LOCALAPPDATA") or home / "AppData/Local") / "rpctl/Cache"
    base = Path(environment.get("XDG_CACHE_HOME") or home / ".cache")
    return (base if base.is_absolute() else home / ".cache") / "rpctl"  # as XDG says


def _own_folder() -> Path | None:
    """Return the folder of machine code, made if need be; None if it is not one's own."""
    folder = cache_folder() / "code"
    if not folder.is_absolute():  # nobody's home is known: it would lie wherever rpctl is started
        return None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True, mode=FOLDER_MODE)
        with suppress(FileExistsError):
            folder.mkdir(mode=FOLDER_MODE)
        return folder if _is_own(folder.lstat(), stat.S_ISDIR) else None
    except (OSError, ValueError):
        return None


def _is_own(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    """Return whether nobody else could have written a file or folder."""
    if not is_kind(found.st_mode):
        return False
    if sys.platform == "win32":
        return True  # below one's profile
    return found.st_uid == os.geteuid() and not found.st_mode & OTHERS_WRITE


def _read(file: Path, key: bytes) -> bytes | None:
    """Return the content of a file of the cache; None if it is not sound."""
    try:
        number = os.open(file, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | os.O_NONBLOCK)
        with os.fdopen(number, "rb") as opened:
            found = os.fstat(number)
            if not _is_own(found, stat.S_ISREG) or found.st_size > MOST_BYTES:
                return None
            data = opened.read()
    except OSError:
        return None
    with suppress(OSError):  # where nothing can be written, nothing is removed
        os.utime(file)  # used now
    head = MARK + key
    hashed, content = data[len(head) :][:DIGEST], data[len(head) + DIGEST :]
    sound = data.startswith(head) and hashed == hashlib.sha256(key + content).digest()
    return content if sound else None


def _remove_oldest(folder: Path) -> None:
    """Remove files, the least recently used first, until the others are within the bound."""
    files = []
    for file in folder.glob("*.code"):
        with suppress(FileNotFoundError):  # another process removed it
            found = file.lstat()
            files.append((found.st_mtime, found.st_size, file))
    total = sum(size for _, size, _ in files)
    for _, size, file in sorted(files):
        if total <= MOST_BYTES:
            break
        file.unlink(missing_ok=True)
        total -= size
