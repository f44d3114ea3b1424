"""Marks: the digest of a run in each file that is made from it, wherever its format has room."""

from __future__ import annotations

import hashlib
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.files.opening import open_input

MARK = "rpctl-run"
JSON_KEY = "run_sha256"
FORMS = re.compile(rb'(?:rpctl-run[\0:]|rpctl-run" content="|"run_sha256": ")([0-9a-f]{64})')
ENDS = 2**16  # bytes at either end of a file that are searched for its mark
CHUNK = 2**20  # bytes that are digested at once
PNG_HEAD = 33  # bytes of a PNG up to the end of its first chunk, which has to be the first
GIF_END = b";"


def digest(path: Path) -> str:
    """Return the SHA-256 digest of a file, in hexadecimal digits.

    Raises:
        RpctlError: It cannot be read.
    """
    found = hashlib.sha256()
    with open_input(path, "MAX_SHOWN_BYTES", "a run.npz") as file:
        while piece := file.read(CHUNK):
            found.update(piece)
    return found.hexdigest()


def mark_of(path: Path) -> str | None:
    """Return the digest of the run that a file is made from; None where it does not say.

    Raises:
        RpctlError: It cannot be read.
    """
    with open_input(path, "MAX_SHOWN_BYTES", "a file of a run's folder") as file:
        head = file.read(ENDS)
        file.seek(max(file.seek(0, 2) - ENDS, 0))
        found = FORMS.search(head) or FORMS.search(file.read(ENDS))
    return found[1].decode() if found else None


def marked(data: bytes, suffix: str, run: str | None) -> bytes:
    """Return a picture, figure or film with the digest of its run in it.

    Args:
        data: The file's content.
        suffix: Of its name: .png, .pdf, .gif or .mp4.
        run: The digest; None leaves the content as it is.

    Raises:
        RpctlError: Files that are called so have no place for it.
    """
    if run is None:
        return data
    if suffix.lower() not in _WRITERS:
        raise RpctlError(f"a file called {suffix} does not keep which run it is of")
    return _WRITERS[suffix.lower()](data, run)


def _in_png(data: bytes, run: str) -> bytes:
    """Return a PNG with a chunk of text after its header."""
    text = b"tEXt" + MARK.encode() + b"\0" + run.encode()
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return data[:PNG_HEAD] + chunk + data[PNG_HEAD:]


def _in_pdf(data: bytes, run: str) -> bytes:
    """Return a PDF with a comment after its end, as its format allows."""
    return data.rstrip(b"\n") + f"\n%{MARK}:{run}\n".encode()


def _in_gif(data: bytes, run: str) -> bytes:
    """Return a GIF with a comment before its end."""
    text = f"{MARK}:{run}".encode()
    return data.removesuffix(GIF_END) + b"!\xfe" + bytes([len(text)]) + text + b"\0" + GIF_END


def _in_mp4(data: bytes, run: str) -> bytes:
    """Return an MP4 with a free box, which players skip, after its others."""
    text = f"{MARK}:{run}".encode()
    return data + struct.pack(">I", 8 + len(text)) + b"free" + text


_WRITERS: dict[str, Callable[[bytes, str], bytes]] = {
    ".png": _in_png,
    ".pdf": _in_pdf,
    ".gif": _in_gif,
    ".mp4": _in_mp4,
}
