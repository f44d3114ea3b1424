"""Caps that keep time and memory bounded, and the one way to open an input within them.

An input is a regular file, and nothing that makes rpctl wait.
"""

from __future__ import annotations

import codecs
import os
import stat
from pathlib import Path
from typing import BinaryIO

from rpctl.errors import InputError, RpctlError, fault_at

A_URDF = "a URDF file or a name listed by `rpctl robots`"
CHUNK = 2**20  # bytes that one read asks for: a file's size is only what it was when asked
# Non-blocking, so that neither a pipe nobody writes to nor a locked file can hold the process.
FLAGS = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY
SPECIAL = {
    stat.S_IFIFO: "a pipe, not a regular file; save its content to a file, and",
    stat.S_IFCHR: "a character device, not a regular file;",
    stat.S_IFBLK: "a block device, not a regular file;",
    stat.S_IFSOCK: "a socket, not a regular file;",
}


def open_input(path: str | Path, cap_name: str, kind: str) -> BinaryIO:
    """Open a regular file for reading, whoever may have exchanged it meanwhile.

    Args:
        path: The file.
        cap_name: Of the cap on its bytes, in :mod:`rpctl.files.caps`.
        kind: What to give instead, in words: ``"a drive file"``.

    Raises:
        InputError: There is no such file, it is too long, or it is none that ends.
    """
    try:
        # Before it is opened, for opening a device can act on it; the open file decides.
        _require_regular(os.stat(path), path, kind)  # noqa: PTH116 - as the next: any path
        file = os.fdopen(os.open(path, FLAGS), "rb")
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise unreadable(path, error, kind) from None
    try:
        found = os.fstat(file.fileno())
        _require_regular(found, path, kind)
        _require_within(found.st_size, cap_name, path)
    except BaseException:
        file.close()
        raise
    return file


def read_input(path: str | Path, cap_name: str, kind: str) -> bytes:
    """Return a regular file's bytes.

    Args:
        path: The file.
        cap_name: Of the cap on its bytes, in :mod:`rpctl.files.caps`; it holds for what is read,
            whatever size the file claims and however it grows.
        kind: What to give instead, in words: ``"a drive file"``.

    Raises:
        InputError: There is no such file, it cannot be read, is too long, or is none that ends.
    """
    data = bytearray()
    with open_input(path, cap_name, kind) as file:
        try:
            while piece := file.read(CHUNK):
                data += piece
                _require_within(len(data), cap_name, path)
        except OSError as error:
            raise unreadable(path, error, kind) from None
    if piece is None:  # a file of /proc or /sys that would make us wait
        raise InputError(path, f"has no data yet; save it to a file, and give {kind}")
    return bytes(data)


def read_text(path: str | Path, cap_name: str, kind: str) -> str:
    """Return a regular file's text: UTF-8, with or without a byte-order mark.

    Args:
        path: The file.
        cap_name: Of the cap on its bytes, in :mod:`rpctl.files.caps`.
        kind: What to give instead, in words: ``"a drive file"``.

    Raises:
        DescriptionError: As of :func:`read_input`; or it is not UTF-8, which its line is named of.
    """
    data = read_input(path, cap_name, kind)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise InputError(path, "UTF-16, not UTF-8; save it as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise fault_at(path, line, f"not UTF-8 ({error.reason}); save it as UTF-8") from None


def read_source(path: Path) -> bytes:
    """Return the bytes of a robot's description.

    Raises:
        InputError: There is no such file, it is too long, or it is none that ends.
    """
    return read_input(path, "MAX_BYTES", A_URDF)


def is_file(path: str | Path) -> bool:
    """Return whether there is a regular file of a name, whatever name it is."""
    return os.path.isfile(path)  # noqa: PTH113 - pathlib's raises, as of a name that is too long


def is_folder(path: str | Path) -> bool:
    """Return whether there is a folder of a name, whatever name it is."""
    return os.path.isdir(path)  # noqa: PTH112 - as above


def at_home(path: str | Path) -> Path:
    """Return a path whose ``~`` stands for a home; one of nobody stays as it is."""
    return Path(os.path.expanduser(path))  # noqa: PTH111 - pathlib's raises


def unreadable(path: str | Path, error: Exception, kind: str) -> InputError:
    """Return the refusal of a file that the system does not let be read.

    Args:
        path: The file.
        error: What opening or reading it raised.
        kind: What to give instead, in words.
    """
    reason = getattr(error, "strerror", None) or str(error)
    return InputError(path, f"{reason}; give {kind}")


def _require_regular(found: os.stat_result, path: str | Path, kind: str) -> None:
    if not stat.S_ISREG(found.st_mode):
        fault = SPECIAL.get(stat.S_IFMT(found.st_mode), "Is a directory;")
        raise InputError(path, f"{fault} give {kind}")


def _require_within(size: int, cap_name: str, path: str | Path) -> None:
    most = cap(cap_name)
    if size > most:
        raise InputError(path, f"the file is over {most} bytes; {how_to_raise(cap_name)}")


MAX_BYTES = 32 * 2**20  # of a URDF; the largest public ones are near 1 MB
MAX_TOML_BYTES = 2**20  # of a file in TOML; a thousand waypoints have 50 kB, each MB takes 2 s
MAX_PARAMETER_BYTES = 2**17  # of a file of ROS parameters; the largest public ones have a tenth
MAX_ELEMENTS = 100_000  # of XML; the largest public URDFs have a tenth, and each takes 30 µs
MAX_ATTRIBUTES = 1_000_000  # of XML; each takes 300 bytes
MAX_LINKS = 2000  # Pinocchio's time grows with the square of the links
MAX_MOVING_JOINTS = 150  # Pinocchio's Data grows with their cube: .3 GB at 150, 2 GB at 300
MAX_MESH_BYTES = 256 * 2**20  # no robot's part is larger
MAX_STATES = 100_000  # that one certificate draws; TIAGo's take an hour
MAX_PICTURES = 20_000  # of one film: eleven minutes at 30 a second, which take an hour to draw
MAX_RUN_SECONDS = 86_400  # of computing that a run takes at least; an hour of TIAGo takes half
MAX_RUN_BYTES = 4 * 2**30  # of a run's samples; an hour of TIAGo at 2 ms is half of it
MAX_MESH_TRIANGLES = 1_000_000  # of one mesh file; the largest public ones have 400 000
MAX_MESH_PARTS = 5000  # pieces that one mesh file shows; a part shown twice is two
MAX_MESH_SECONDS = 40  # that one mesh may take; a million triangles take 4 of a free core
MAX_MESH_MEMORY = 2 * 2**30  # bytes that the process that reads meshes may take
MAX_XACRO_SECONDS = 30  # that a .xacro may take to expand; the largest public ones take 2
MAX_XACRO_MEMORY = 2**30  # bytes that its expansion may take
MAX_FOLDERS = 20_000  # that one search for packages looks into; 80 public repositories have 4300
MAX_ROWS = 100_000  # of a table of poses; 1 kHz for 100 s
MAX_SHOWN_BYTES = 2**31  # of a file in a run's folder whose mark is looked for, or digest taken
MAX_COLUMNS = 200  # of a table of poses; more than a robot has moving joints
MAX_REFERENCE_SECONDS = 86_400  # that a file's reference takes; a day
MAX_WAYPOINTS = 1000  # of a path: at half a metre a second it takes half an hour and more


def cap(name: str) -> int:
    """Return a cap: the environment's ``RPCTL_<name>``, else this module's constant.

    Raises:
        RpctlError: The environment's value is no positive integer.
    """
    text = os.environ.get(f"RPCTL_{name}")
    if text is None:
        return int(globals()[name])
    if not (text.isascii() and text.isdigit() and 0 < len(text) <= 18 and int(text) > 0):
        raise RpctlError(
            f"RPCTL_{name}={text[:40]!r} is not a positive integer; correct or unset it"
        )
    return int(text)


def how_to_raise(name: str) -> str:
    """Return how to raise a cap, as the end of a message."""
    return f"to allow it, set RPCTL_{name} in the environment (rpctl.files.caps.{name})"
