"""What all commands print with: the console, tables, progress bars, JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from rpctl.files.writing import to_json

PIPED_WIDTH = 140  # characters of a line that no terminal breaks


def console(stderr: bool = False) -> Console:
    """Return a console that neither colours paths nor breaks lines of piped text."""
    out = Console(stderr=stderr, highlight=False)
    return out if out.is_terminal else Console(stderr=stderr, highlight=False, width=PIPED_WIDTH)


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal's stderr, nothing when piped; yields ``advance(done, total)``."""
    columns = TextColumn("{task.description:>9}"), BarColumn(), TimeElapsedColumn()
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


def print_json(value: object) -> None:
    """Print a value as JSON on stdout."""
    typer.echo(to_json(value))
