"""What all commands print with: streams that never end them, the console, tables, progress bars."""

from __future__ import annotations

import errno
import io
import math
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from rpctl.errors import printable
from rpctl.files.writing import json_escape, to_json

BAR_WIDTH = 20  # characters: with times and details a bar fits into a line of 80
PIPED_WIDTH = 140  # characters of a line that no terminal breaks
TAG = re.compile(r"(\\*)(?=\[[a-z#/@])|(\\+)\Z")  # where markup may begin, or a text ends


def console(stderr: bool = False) -> Console:
    """Return a console that neither colours paths nor breaks lines of piped text."""
    out = Console(stderr=stderr, highlight=False, emoji=False)
    if not out.is_terminal:
        out.width = PIPED_WIDTH
    return out


def escape(text: str) -> str:
    """Return a text of others as markup that shows it: no tag begins in it, and nothing is hidden.

    Rich's own function leaves a bracket that nothing in the text closes; what is printed behind
    the text may.
    """
    return TAG.sub(_doubled, printable(text))


def _doubled(found: re.Match[str]) -> str:
    """Return backslashes that show as these, and one that makes the bracket behind them a sign."""
    return 2 * found[2] if found[2] else f"{2 * found[1]}\\"


@contextmanager
def progress_bar(label: str, details: str = "") -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal's stderr, nothing when piped; yields ``advance(done, total)``.

    Args:
        label: What is done.
        details: What it will take, behind the time that is left.
    """
    columns: list[ProgressColumn] = [
        TextColumn("{task.description:>9}"),
        BarColumn(BAR_WIDTH),
        TimeElapsedColumn(),
    ]
    if details:
        columns += [TextColumn("[dim]left[/]"), TimeRemainingColumn(), TextColumn(details)]
    out = Console(stderr=True)
    with Progress(*columns, console=out, transient=True, disable=not out.is_terminal) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def new_table(*headings: str) -> Table:
    """Return an empty table without lines; a column whose heading begins with ``>`` is flush right.

    Args:
        headings: One for each column.
    """
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in headings:
        table.add_column(
            heading.removeprefix(">"), justify="right" if heading.startswith(">") else "left"
        )
    return table


def format_limit(value: float, unit: str) -> str:
    """Return a limit with its unit, or a dash where there is none."""
    return f"{value:.4g} {unit}".rstrip() if math.isfinite(value) else "-"


@contextmanager
def kept_told(folder: Path, again: str) -> Iterator[None]:
    """Say how to go on where a Ctrl-C ends the runs of the ``with`` block early.

    Args:
        folder: Where the runs that have ended are kept.
        again: The command line that goes on.
    """
    try:
        yield
    except KeyboardInterrupt:
        out = console(stderr=True)
        out.print(f"the runs so far are kept in [bold]{escape(str(folder))}[/]; to continue, run")
        out.print(f"  {escape(again)}", soft_wrap=True)
        raise


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
    """Print a value as JSON on stdout and at once, in ASCII if its encoding is not Unicode's."""
    text = to_json(value)
    print(
        text if _is_unicode() else BEYOND_ASCII.sub(lambda sign: json_escape(sign[0]), text),
        flush=True,
    )


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
