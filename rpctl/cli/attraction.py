"""The region of attraction: ``rpctl attraction``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, split_names, tell
from rpctl.cli.results import run_shown, writable_folder, write_results
from rpctl.cli.terminal import console, escape, new_table
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, read_law
from rpctl.errors import RpctlError, require_positive
from rpctl.study.attraction import DURATION, REACH_M, RUN, Start, fractions, row_dict, start_errors
from rpctl.study.cells import REFUSED, CellRunner, References, Row

FILES = ("attraction.json", "attraction.png", "attraction.pdf")


@dataclass(frozen=True)
class AttractionOptions:
    """Which laws start where, and where the result goes."""

    references: Annotated[
        str, typer.Option(metavar="NAME|FILE,...", help="References, as for `rpctl track`.")
    ] = "eight"
    laws: Annotated[
        str, typer.Option(metavar="NAME,...", help=f"Kinematic laws: {', '.join(KINEMATIC_LAWS)}.")
    ] = "unified"
    dynamic: Annotated[
        str | None,
        typer.Option(metavar="|".join(DYNAMIC_LAWS), help="Dynamic law; default: the robot's own."),
    ] = None
    starts: Annotated[
        int,
        typer.Option(
            min=16,
            metavar="N",
            help=f"Starts for each law on each reference, about; they cover ±{REACH_M:g} m and "
            "all headings.",
        ),
    ] = 200
    duration: Annotated[float, typer.Option(metavar="S", help="Duration of each run, s.")] = (
        DURATION
    )
    workers: Annotated[
        int, typer.Option(min=1, help="Number of processes; default: one for each processor.")
    ] = os.cpu_count() or 1
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default: runs/ROBOT-attraction."),
    ] = None

    def cells(self) -> list[Start]:
        """Return the starts of each law on each reference.

        Raises:
            UnknownNameError: There is no such law.
        """
        laws, references = split_names(self.laws), split_names(self.references)
        for law in laws:
            read_law("kinematic", law)
        if self.dynamic is not None:
            read_law("dynamic", self.dynamic)
        run, errors = replace(RUN, duration=self.duration), start_errors(self.starts)
        return [
            Start(law, self.dynamic, replace(run, reference=name, initial_error=error))
            for law, name, error in product(laws, references, errors)
        ]


def attraction_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: AttractionOptions,
    as_json: JsonOption = False,
) -> None:
    """Plot from which initial errors a law brings a robot to its reference, and how soon.

    Each start is a run at 100 Hz within the robot's limits. It converges if the base comes within
    5 cm of its reference and stays there, breaks no limit, and the outcome is `tracked` or `late`,
    or `slips` or `tips`, as its wheels roll in any case.
    """
    require_positive("--duration", settings.duration)
    cells = settings.cells()
    loaded = options.load(robot)
    if not loaded.drive.base_speeds:
        raise RpctlError(
            f"{loaded.name} has a fixed base, which has no region of attraction; "
            "give a robot that drives"
        )
    folder = writable_folder(settings.out, loaded.name, "attraction", FILES)
    rows = run_shown("attraction", CellRunner(References(loaded)), cells, settings.workers)
    summary = {
        "robot": loaded.name,
        "drive": str(loaded.drive.type),
        "dynamic": settings.dynamic,
        "duration": settings.duration,
        "control_period": RUN.control_period,
        "reach": REACH_M,
        "fractions": [{**each._asdict(), "undecided": each.undecided} for each in fractions(rows)],
        "starts": [row_dict(row) for row in rows],
    }
    from rpctl.view.plots.attraction import attraction_figure  # imports Matplotlib

    figure = attraction_figure(rows, f"{loaded.name}: region of attraction")
    write_results(folder, FILES, summary, figure)
    tell(as_json, lambda: summary, lambda: _show(rows, folder))


def _show(rows: Sequence[Row[Start]], folder: Path) -> None:
    """Print a row for each law on each reference, why others did not run, and the folder."""
    out = console()
    table = new_table("law", "reference", ">starts", ">converged", ">undecided", ">failed",
                      ">slowest\ns")  # fmt: skip
    for each in fractions(rows):
        style = "green" if each.converged == each.starts else "yellow"
        table.add_row(
            each.kinematic,
            escape(Path(each.reference).name),
            str(each.starts),
            f"[{style}]{100.0 * each.converged / each.starts:.0f} %[/]",
            str(each.undecided),
            str(each.failed),
            "-" if each.slowest is None else f"{each.slowest:.1f}",
        )
    out.print(table)
    refused = (row.figures.sentence for row in rows if row.figures.outcome == REFUSED)
    for sentence in dict.fromkeys(refused):
        out.print(f"[dim]did not run:[/] {escape(sentence)}")
    out.print(f"wrote [bold]{escape(str(folder))}[/]: {', '.join(FILES)}")
