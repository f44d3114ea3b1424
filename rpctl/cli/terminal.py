"""What all commands print with: the console, tables, progress bars, how to go on."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

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
        out.print(f"what is done is kept in [bold]{escape(str(folder))}[/]; go on with")
        out.print(f"  {escape(again)}", soft_wrap=True)
        raise
