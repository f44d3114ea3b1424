"""Standard output and error of a command: what becomes of them never ends the command."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
from typing import Any, TextIO

from rpctl.errors import printable
from rpctl.files.writing import json_escape, to_json

BEYOND_ASCII = re.compile(r"[^\x00-\x7f]")


class Outlet(io.FileIO):
    """A descriptor that takes everything: what it cannot write is dropped, and so is the rest.

    Attributes:
        fault: Why the first of it could not be written, or None.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number, "wb", closefd=False)
        self.fault: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write bytes, or drop them."""
        try:
            return super().write(data)
        except OSError as error:
            self.fault = error
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            return len(memoryview(data))


def say(text: str, *, err: bool = False) -> None:
    """Print a text of any origin, a line or several, on stdout or stderr, and at once.

    What reads a pipe may wait for it, as for the address of a page.
    """
    print(printable(text, keep="\n"), file=sys.stderr if err else sys.stdout, flush=True)


def print_json(value: object) -> None:
    """Print a value as JSON on stdout, in ASCII where its encoding is none of Unicode's."""
    text = to_json(value)
    print(text if _is_unicode() else BEYOND_ASCII.sub(lambda sign: json_escape(sign[0]), text))


def print_document(text: str, *, xml: bool = False) -> None:
    """Print what is to become a file, as it is; on a terminal, what would not be seen is escaped.

    Args:
        text: The text.
        xml: Whether it is XML, whose references stand for signs that the encoding of stdout lacks.
    """
    out = sys.stdout
    if out is None:
        return
    if out.isatty():
        text = printable(text, keep="\n\t")
    elif xml and not _is_unicode():
        text = text.encode("ascii", "xmlcharrefreplace").decode()
    out.write(text)


def _is_unicode() -> bool:
    return (getattr(sys.stdout, "encoding", None) or "utf-8").lower().startswith("utf")


class Streams:
    """Standard output and error, guarded; signs that an encoding lacks become ``\\u03bd``."""

    def __init__(self) -> None:
        for number in range(3):
            _open_closed(number)
        self._outlets = [Outlet(1), Outlet(2)]
        sys.stdout = _text(self._outlets[0], sys.stdout)
        sys.stderr = _text(self._outlets[1], sys.stderr)

    def close(self) -> OSError | None:
        """Write what is left; return why output was lost, or None.

        A pipe whose reader has enough, as ``head``, has lost nothing.
        """
        sys.stdout.flush()
        sys.stderr.flush()
        fault = self._outlets[0].fault
        return None if fault is None or fault.errno == errno.EPIPE else fault


def _open_closed(number: int) -> None:
    """Open a closed descriptor on nothing, else the next file gets its number and is printed to."""
    try:
        os.fstat(number)
    except OSError:
        os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free


def _text(outlet: Outlet, before: TextIO | None) -> io.TextIOWrapper:
    """Return what takes text for an outlet, as another stream took it."""
    if before is not None:
        before.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(outlet),
        encoding=getattr(before, "encoding", "utf-8"),
        errors="backslashreplace",
        line_buffering=outlet.isatty() or outlet.fileno() == 2,
        write_through=getattr(before, "write_through", False),
    )
