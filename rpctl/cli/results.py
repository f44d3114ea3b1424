"""What the commands of many runs share: how their cells are run, and how results are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rpctl.cli.options import default_folder
from rpctl.cli.terminal import progress_bar
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable, to_json, write_together
from rpctl.libraries import library
from rpctl.study.cells import AnyCell, CellRunner, Row, run_cells
from rpctl.study.executor import executor_for

DPI = 200


def run_shown(
    title: str, runner: CellRunner, cells: Sequence[AnyCell], workers: int
) -> list[Row[AnyCell]]:
    """Run cells in at most so many processes, showing how far they are.

    Raises:
        RpctlError: None of them could be run.
    """
    with executor_for(min(workers, len(cells))) as executor, progress_bar(title) as advance:
        rows = run_cells(runner, cells, executor, advance)
    if all(row.figures.failure is not None for row in rows):
        raise RpctlError(f"none of the runs could start: {rows[0].figures.failure}")
    return rows


def writable_folder(out: Path | None, robot: str, what: str, files: Sequence[str]) -> Path:
    """Return the folder of a command's results, in which these files can be written.

    Raises:
        RpctlError: One cannot.
    """
    folder = out or default_folder(robot, what, files[0])
    for name in files:
        require_writable(folder / name, makes_folder=True)
    return folder


def write_results(
    folder: Path,
    names: Sequence[str],
    summary: Mapping[str, Any],
    figure: Any,
    table: str = "",
    page: bytes = b"",
) -> None:
    """Write the results of one set, JSON first.

    Args:
        folder: Where.
        names: Of the files; their suffixes say what they hold.
        summary: All that is known, as JSON says it.
        figure: The picture, Matplotlib's.
        table: The rows as CSV.
        page: The page.
    """
    figures = library("rpctl.view.plots.figures")  # imports Matplotlib
    contents = {
        ".json": (to_json(summary) + "\n").encode(),
        ".csv": table.encode("utf-8", "backslashreplace"),
        ".html": page,
        ".png": figures.to_png(figure, DPI),
    }
    if any(name.endswith(".pdf") for name in names):
        contents[".pdf"] = figures.to_pdf(figure)
    write_together(folder, {name: contents[Path(name).suffix] for name in names})
