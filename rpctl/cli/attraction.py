"""The region of attraction: ``rpctl attraction``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from rpctl.cli.options import (
    JsonOption,
    LoadOptions,
    RobotArgument,
    default_folder,
    split_names,
)
from rpctl.cli.streams import print_json
from rpctl.cli.terminal import console, escape, new_table, progress_bar
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, dynamic_by_name, kinematic_by_name
from rpctl.errors import RpctlError, require_positive
from rpctl.files.writing import require_writable, to_json, write_together
from rpctl.study.attraction import (
    DURATION,
    PERIOD,
    REACH_M,
    Attraction,
    Ending,
    Fraction,
    Start,
    fractions,
    start_errors,
)
from rpctl.study.cells import run_cells
from rpctl.study.executor import executor_for

DPI = 200
FILES = ("attraction.json", "attraction.png", "attraction.pdf")


@dataclass(frozen=True)
class AttractionOptions:
    """Which laws start where, and where the result goes."""

    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE,...", help="References, as track takes them.")
    ] = "eight"
    kinematic: Annotated[
        str, typer.Option(metavar="NAME,...", help=f"Laws, of {', '.join(KINEMATIC_LAWS)}.")
    ] = "unified"
    dynamic: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(DYNAMIC_LAWS), help="Dynamic law; the robot's own if not given."
        ),
    ] = None
    starts: Annotated[
        int,
        typer.Option(
            min=16,
            metavar="N",
            help=f"About so many starts, in ±{REACH_M:g} m and all round, for each law on each "
            "reference.",
        ),
    ] = 200
    duration: Annotated[float, typer.Option(metavar="S", help="Of each run, s.")] = DURATION
    jobs: Annotated[
        int, typer.Option(min=1, help="Processes; as many as there are processors.")
    ] = os.cpu_count() or 1
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-attraction if not given."),
    ] = None


def attraction_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: AttractionOptions,
    as_json: JsonOption = False,
) -> None:
    """Draw from which starts a law brings a robot to its reference, and how soon.

    Each start is a run at 100 Hz within the robot's limits. It has converged if the base stays
    within 5 cm of its reference from some time on, no limit is broken, and the outcome is that of a
    run that tracks.
    """
    require_positive("--duration", settings.duration)
    laws, references = split_names(settings.kinematic), split_names(settings.reference)
    for law in laws:
        kinematic_by_name(law)
    if settings.dynamic is not None:
        dynamic_by_name(settings.dynamic)
    loaded = options.load(robot)
    if not loaded.drive.base_speeds:
        raise RpctlError(f"{loaded.name} has a fixed base: it starts where it is")
    folder = settings.out or default_folder(loaded.name, "attraction")
    for name in FILES:
        require_writable(folder / name, makes_folder=True)
    asked = [
        Start(law, name, e)
        for law in laws
        for name in references
        for e in start_errors(settings.starts)
    ]
    study = Attraction(loaded, settings.dynamic, settings.duration)
    with (
        executor_for(min(settings.jobs, len(asked))) as executor,
        progress_bar("attraction") as advance,
    ):
        endings = run_cells(study, asked, executor, advance)
    if all(ending.outcome is None for ending in endings):
        raise RpctlError(f"nothing ran: {endings[0].sentence}")
    summary = _summary(study, endings)
    _write(folder, summary, endings, loaded.name)
    if as_json:
        print_json(summary)
    else:
        _show(fractions(endings), endings, folder)


def _summary(study: Attraction, endings: Sequence[Ending]) -> dict[str, Any]:
    """Return all that is known, as JSON says it."""
    return {
        "robot": study.robot.name,
        "drive": str(study.robot.drive.type),
        "dynamic": study.dynamic,
        "duration": study.duration,
        "control_period": PERIOD,
        "reach": REACH_M,
        "fractions": [
            {**each._asdict(), "undecided": each.undecided} for each in fractions(endings)
        ],
        "starts": [ending.to_dict() for ending in endings],
    }


def _write(folder: Path, summary: dict[str, Any], endings: Sequence[Ending], name: str) -> None:
    """Write the endings as JSON, and the picture as PNG and PDF, all of one study."""
    from rpctl.view.plots.attraction import attraction_figure
    from rpctl.view.plots.figures import to_pdf, to_png

    figure = attraction_figure(endings, f"{name}: region of attraction")
    contents = (to_json(summary) + "\n").encode(), to_png(figure, DPI), to_pdf(figure)
    write_together(folder, dict(zip(FILES, contents, strict=True)))


def _show(found: Sequence[Fraction], endings: Sequence[Ending], folder: Path) -> None:
    """Print a row for each law on each reference, the worst of those that failed, and the folder.

    Args:
        found: The rows.
        endings: Of all starts.
        folder: Where the files lie.
    """
    out = console()
    table = new_table("law", "reference", ">starts", ">converged", ">on the way", ">failed",
                      ">slowest\ns")  # fmt: skip
    for each in found:
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
    for sentence in dict.fromkeys(each.sentence for each in endings if each.outcome is None):
        out.print(f"[dim]did not run:[/] {escape(sentence)}")
    out.print(f"wrote [bold]{escape(str(folder))}[/]: {', '.join(FILES)}")
