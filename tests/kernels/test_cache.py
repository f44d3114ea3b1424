"""Machine code on disk: found again, and never run if torn, altered or somebody else's."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rpctl.kernels import cache

KEY, OTHER_KEY = hashlib.sha256(b"key").digest(), hashlib.sha256(b"other").digest()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of machine code, which is not there yet."""
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "code"


class Maker:
    """Counts how often it makes what is asked for."""

    def __init__(self, content: bytes = b"content") -> None:
        self.content, self.made = content, 0

    def __call__(self) -> bytes:
        self.made += 1
        return self.content


def fetch(key: bytes = KEY) -> int:
    """Return how often the content had to be made."""
    make = Maker()
    assert cache.cached(key, make) == b"content"
    return make.made


def test_what_was_made_is_found_again_by_its_key(folder: Path) -> None:
    assert (fetch(), fetch(), fetch(OTHER_KEY), fetch(OTHER_KEY)) == (1, 0, 1, 0)
    (file, _) = folder.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600
    assert folder.stat().st_mode & 0o777 == 0o700


def _truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-1])


def _empty(file: Path) -> None:
    file.write_bytes(b"")


def _flip(at: int) -> Callable[[Path], None]:
    def flip(file: Path) -> None:
        data = bytearray(file.read_bytes())
        data[at] ^= 1
        file.write_bytes(data)

    return flip


def _take_anothers(file: Path) -> None:
    fetch(OTHER_KEY)
    file.write_bytes((file.parent / f"{OTHER_KEY.hex()}.code").read_bytes())


def _link(file: Path) -> None:
    file.rename(file.with_suffix(".elsewhere"))
    file.symlink_to(file.with_suffix(".elsewhere"))


def _let_others_write(file: Path) -> None:
    file.chmod(0o620)


def _make_a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


FAULTS: list[Callable[[Path], None]] = [
    _truncate,
    _empty,
    _take_anothers,
    _link,
    _let_others_write,
    _make_a_pipe,
]
FAULTS += [_flip(at) for at in (0, len(cache.MARK) + 3, len(cache.MARK) + 40, -1)]


@pytest.mark.parametrize("spoil", FAULTS)
def test_what_is_not_sound_is_made_again(folder: Path, spoil: Callable[[Path], None]) -> None:
    fetch()
    file = folder / f"{KEY.hex()}.code"
    spoil(file)
    assert fetch() == 1
    assert fetch() == 0
    assert not file.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o600


def test_another_users_file_or_folder_is_not_taken(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fetch()
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    assert (fetch(), fetch()) == (1, 1)
    monkeypatch.undo()
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(folder.parent))
    assert fetch() == 0
    folder.chmod(0o770)
    assert (fetch(), fetch()) == (1, 1)


def test_a_folder_that_cannot_be_used_costs_time_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError("read-only file system")

    fetch()
    monkeypatch.setattr(cache, "write_atomically", refuse)
    assert (fetch(OTHER_KEY), fetch(OTHER_KEY)) == (1, 1)
    file = folder.parent.parent / "file"
    file.write_text("no folder")
    for place in (file, file / "below", "no\0name", "~nobody-here/x"):
        monkeypatch.setattr(cache, "cache_folder", lambda place=place: Path(place))
        assert (fetch(), fetch()) == (1, 1)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_costs_time_only(folder: Path) -> None:
    fetch()
    folder.chmod(0o500)
    assert (fetch(), fetch(OTHER_KEY), fetch(OTHER_KEY)) == (0, 1, 1)


def test_the_least_recently_used_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = [hashlib.sha256(bytes([k])).digest() for k in range(4)]
    for age, key in enumerate(keys[:3]):
        fetch(key)
        os.utime(folder / f"{key.hex()}.code", (1000.0 + age, 1000.0 + age))
    assert fetch(keys[0]) == 0  # used now
    size = (folder / f"{keys[0].hex()}.code").stat().st_size
    monkeypatch.setattr(cache, "MOST_BYTES", 3 * size)
    fetch(keys[3])
    left = {bytes.fromhex(file.stem) for file in folder.iterdir()}
    assert left == {keys[0], keys[2], keys[3]}


def test_several_writers_and_readers_at_once_find_whole_content(folder: Path) -> None:
    content = os.urandom(300_000)

    def use(_: int) -> bool:
        cache.keep(folder / f"{KEY.hex()}.code", KEY, content)
        return cache.cached(KEY, Maker(content)) == content

    fetch(OTHER_KEY)
    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(use, range(24)))
    assert len(list(folder.iterdir())) == 2  # nothing unfinished stays


def test_the_folder_is_the_platforms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/ada")
    for platform, environment, wanted in (
        ("linux", {}, "/home/ada/.cache/rpctl"),
        ("linux", {"XDG_CACHE_HOME": "/fast"}, "/fast/rpctl"),
        ("linux", {"XDG_CACHE_HOME": "fast"}, "/home/ada/.cache/rpctl"),
        ("darwin", {"XDG_CACHE_HOME": "/fast"}, "/home/ada/Library/Caches/rpctl"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/rpctl/Cache"),
        ("linux", {"RPCTL_CACHE_DIR": "~/there"}, "/home/ada/there"),
        ("linux", {"RPCTL_CACHE_DIR": ""}, "/home/ada/.cache/rpctl"),
    ):
        monkeypatch.setattr(sys, "platform", platform)
        assert cache.cache_folder(environment) == Path(wanted)


@pytest.mark.thorough
def test_two_processes_that_write_at_once_leave_one_whole_file(folder: Path) -> None:
    script = (
        "from tests.kernels.test_cache import *\n"
        "content = bytes(range(256)) * 4000\n"
        "for _ in range(50):\n"
        "    cache.keep(cache.cache_folder() / 'code' / f'{KEY.hex()}.code', KEY, content)\n"
        "    assert cache.cached(KEY, Maker(content)) == content\n"
    )
    fetch(OTHER_KEY)
    command = [sys.executable, "-c", script]
    both = [subprocess.Popen(command, cwd=Path(__file__).parents[2]) for _ in range(2)]
    assert [process.wait() for process in both] == [0, 0]
    make = Maker()
    assert cache.cached(KEY, make) == bytes(range(256)) * 4000
    assert not make.made
    assert len(list(folder.iterdir())) == 2
