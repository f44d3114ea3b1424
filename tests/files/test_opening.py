"""One way to open an input: what is no regular file, too long or still growing is refused."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rpctl.errors import InputError
from rpctl.files.caps import open_input, read_input

PATIENCE = 2.0  # s; a pipe that nobody writes to would hold the process for ever


def _loop(path: Path) -> None:
    path.symlink_to(path.with_name("other"))
    path.with_name("other").symlink_to(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(os.path.relpath(path))  # a socket's name may have a hundred characters


def _unreadable(path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    path.touch(0)


ODD: dict[str, tuple[Callable[[Path], object], str]] = {
    "a folder": (Path.mkdir, "Is a directory"),
    "a pipe": (os.mkfifo, "a pipe, not a regular file; save its content to a file, and"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "a character device, not a regular"),
    "a socket": (_socket, "a socket, not a regular file;"),
    "links in a loop": (_loop, "Too many levels of symbolic links;"),
    "a link to nothing": (lambda path: path.symlink_to("nowhere"), "No such file or directory;"),
    "not readable": (_unreadable, "Permission denied;"),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_no_regular_file_is_refused_at_once(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "input"
    make, expected = ODD[name]
    make(path)
    begin = time.monotonic()
    with pytest.raises(InputError) as caught:
        read_input(path, "MAX_BYTES", "a drive file")
    assert time.monotonic() - begin < PATIENCE
    assert str(caught.value).startswith(f"{path}: error: {expected}")
    assert caught.value.fault.startswith(expected)
    assert caught.value.fault.endswith("give a drive file")


@pytest.mark.parametrize(
    ("name", "reason"),
    [("a\0b", "embedded null"), ("a" * 300, "File name too long"), ("\ud800", "surrogates")],
)
def test_a_name_that_no_file_has_is_refused(name: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        read_input(name, "MAX_BYTES", "a drive file")


def test_a_pipe_put_in_a_file_s_place_is_refused_by_the_open_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if somebody exchanged them between the look at the name and the opening."""
    os.mkfifo(tmp_path / "input")
    before = Path(__file__).stat()
    with monkeypatch.context() as patch:
        patch.setattr("rpctl.files.caps.os.stat", lambda path: before)
        with pytest.raises(InputError, match="a pipe, not a regular file"):
            open_input(tmp_path / "input", "MAX_BYTES", "a drive file")


def test_a_file_is_read_up_to_its_cap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "input"
    monkeypatch.setenv("RPCTL_MAX_BYTES", "5")
    path.write_bytes(b"12345")
    assert read_input(path, "MAX_BYTES", "a drive file") == b"12345"
    path.write_bytes(b"123456")
    with pytest.raises(InputError, match=r"over 5 bytes; to allow it, set RPCTL_MAX_BYTES"):
        read_input(path, "MAX_BYTES", "a drive file")


def test_a_file_longer_than_it_claims_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Files of /proc claim no bytes, and a file may grow while it is read."""
    path = Path("/proc/self/maps")
    assert path.stat().st_size == 0
    assert len(read_input(path, "MAX_BYTES", "a drive file")) > 1000
    monkeypatch.setenv("RPCTL_MAX_BYTES", "1000")
    with pytest.raises(InputError, match="over 1000 bytes"):
        read_input(path, "MAX_BYTES", "a drive file")


def test_no_descriptor_stays_open(tmp_path: Path) -> None:
    path = tmp_path / "input"
    path.write_bytes(b"1" * 10)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(5):
        read_input(path, "MAX_BYTES", "a drive file")
        with pytest.raises(InputError):
            read_input(tmp_path, "MAX_BYTES", "a drive file")
    assert len(list(Path("/proc/self/fd").iterdir())) == before
