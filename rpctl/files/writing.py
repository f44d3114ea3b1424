"""Files and JSON: whole or not at all, and only what JSON can say; links are written through."""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from rpctl.errors import RpctlError, printable

UNFINISHED = ".part"  # what a file's name ends with until it is whole
NAME_LENGTH = 48  # characters of the final name in that of an unfinished file: a name has 255 bytes
MAX_LINKS = 40  # links that lead to one another, as Linux follows
DESCRIPTOR = re.compile(r"/proc/\d+/fd/(\d+)")  # what /dev/stdout and /dev/fd/N are links to
NEW_MODE = 0o666  # of a new file, less the umask


def write_atomically(
    path: str | Path, data: bytes, *, follow_links: bool = True, mode: int = NEW_MODE
) -> Path:
    """Write a file; it is there whole or not at all, also after Ctrl-C or a loss of power.

    Args:
        path: The file; see :func:`writing`.
        data: Its content.
        follow_links: Whether a link is written through; False replaces it.
        mode: Of a new file, less the umask.

    Returns:
        The path.

    Raises:
        RpctlError: It cannot be written.
    """
    with writing(path, follow_links=follow_links, mode=mode) as file:
        file.write(data)
    return Path(path)


@contextmanager
def writing(
    path: str | Path, *, follow_links: bool = True, mode: int = NEW_MODE
) -> Iterator[BinaryIO]:
    """Yield a binary file; what the block writes to it becomes the file at the end, whole.

    If the block raises, an older file stays as it is. A new file gets the mode that the umask
    leaves; an older one keeps its mode and, as far as the system lets, its owner. A link stays,
    and what it leads to is replaced. Character devices, pipes and ``/dev/stdout`` are written
    through: they cannot be replaced, and what was written to them stays.

    Args:
        path: The file. Its folder must be there.
        follow_links: Whether a link is written through; False replaces it. False is for names
            that the user did not give, in folders that others may have filled.
        mode: Of a new file, less the umask.

    Raises:
        RpctlError: It cannot be written: by its folder, its kind, its mode, or a full disk.
    """
    try:
        target = _follow(Path(path)) if follow_links else Path(path)
        through = follow_links and _is_stream(target)
        with _open_stream(target) if through else _replacing(target, mode) as file:
            yield file
    except OSError as error:
        raise _refusal(path, error) from None


def require_writable(path: str | Path, *, makes_folder: bool = False) -> None:
    """Refuse a file that could not be written; called before long work. Nothing is left behind.

    Args:
        path: The file.
        makes_folder: Whether its folder, and those above it, would be made.

    Raises:
        RpctlError: It cannot be written, or its folder cannot be made.
    """
    try:
        target = _follow(Path(path))
        if _is_stream(target):
            return
        folder = target.parent
        while makes_folder and not folder.exists() and folder != folder.parent:
            folder = folder.parent
        _older(target)
        with _unfinished(folder / target.name, NEW_MODE):
            pass
    except OSError as error:
        raise _refusal(path, error) from None


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are not there.

    Raises:
        RpctlError: It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be made: {error.strerror or error}") from None


def _refusal(path: str | Path, error: OSError) -> RpctlError:
    folder = Path(path).parent
    if isinstance(error, FileNotFoundError) and not folder.exists():
        return RpctlError(f"{path}: there is no folder {folder}; make it first")
    return RpctlError(f"{path}: cannot be written: {error.strerror or error}")


def _follow(path: Path) -> Path:
    """Return where a path leads, its links followed; of an open file of this process, its name.

    Links of ``/proc`` lead to open files and not to paths; such a name is returned as it is.
    """
    if "\0" in str(path):
        raise OSError("a file name cannot contain NUL")
    for _ in range(MAX_LINKS):
        path = Path(os.path.realpath(path.parent)) / path.name
        if DESCRIPTOR.fullmatch(str(path)) or not path.is_symlink():
            return path
        path = path.parent / path.readlink()
    return path  # whoever opens it is told of the circle


def _is_stream(target: Path) -> bool:
    """Return whether a target is written through, not replaced.

    Raises:
        OSError: It is neither a file nor written through.
    """
    if DESCRIPTOR.fullmatch(str(target)):
        return True
    with suppress(FileNotFoundError):
        mode = target.stat().st_mode
        if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):
            return True
        if not stat.S_ISREG(mode):
            kind = "folder" if stat.S_ISDIR(mode) else "device or socket"
            raise OSError(f"it is a {kind}; give a file")
    return False


def _open_stream(target: Path) -> BinaryIO:
    """Open what is written through; what was printed before comes first."""
    found = DESCRIPTOR.fullmatch(str(target))
    if found is None:
        return os.fdopen(os.open(target, os.O_WRONLY | os.O_NOCTTY), "wb")
    for each in (sys.stdout, sys.stderr):
        if each is not None:
            each.flush()
    return os.fdopen(os.dup(int(found[1])), "wb")


@contextmanager
def _replacing(target: Path, mode: int) -> Iterator[BinaryIO]:
    """Yield an unfinished file beside a target that replaces it at the end."""
    before = _older(target)
    with _unfinished(target, mode if before is None else 0o600) as (file, name):
        yield file
        if before is not None:
            with suppress(PermissionError):
                os.fchown(file.fileno(), before.st_uid, before.st_gid)
            os.fchmod(file.fileno(), stat.S_IMODE(before.st_mode) & 0o777)
        file.flush()
        os.fsync(file.fileno())
        name.replace(target)


def _older(target: Path) -> os.stat_result | None:
    """Return what is known of a file that is there; None of what is none.

    Raises:
        PermissionError: It is write-protected.
    """
    try:
        found = target.lstat()
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    if not os.access(target, os.W_OK):
        raise PermissionError("it is write-protected")
    return found


@contextmanager
def _unfinished(target: Path, mode: int) -> Iterator[tuple[BinaryIO, Path]]:
    """Yield a new, empty file beside a target and its name, under which it does not stay.

    The name is chosen before the file is made, so that a signal at any moment leaves nothing.
    """
    name = target.with_name(f".{target.name[:NAME_LENGTH]}.{secrets.token_hex(8)}{UNFINISHED}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    try:
        with os.fdopen(os.open(name, flags, mode), "wb") as file:
            yield file, name
    finally:
        name.unlink(missing_ok=True)


def to_json(value: Any) -> str:
    """Return strict, indented JSON; a number that is not finite becomes null.

    Signs that do not print are written as ``\\u001b``, and so are the bytes of a path that are no
    UTF-8: ``\\udcff``, which Python reads again as that path.
    """
    text = json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    return printable(text, keep="\n", escape=json_escape)


def json_escape(sign: str) -> str:
    """Return a sign as a string in JSON holds it in ASCII."""
    return json.dumps(sign)[1:-1]


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def write_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files of one set; wherever it ends, those that are there are of one set.

    The first file holds all that the others show. These are removed before it is replaced, and
    written after: what is left early is the older first file alone, or the new one with some of
    the others. Other files of the folder stay.

    Args:
        folder: Where; made if it is not there.
        files: Their contents by name, the first one first.

    Raises:
        RpctlError: The folder cannot be made or written to.
    """
    make_folder(folder)
    first, *rest = files
    try:
        for name in rest:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be written: {error.strerror or error}") from None
    for name in (first, *rest):
        write_atomically(folder / name, files[name], follow_links=False)
