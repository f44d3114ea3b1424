"""The battery of stresses: ``rpctl stress``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from shlex import join
from typing import Annotated

import typer

from rpctl.cli.options import (
    CHECK_FAILED,
    JsonOption,
    LoadOptions,
    RobotArgument,
    default_folder,
    split_names,
)
from rpctl.cli.streams import print_json, say
from rpctl.cli.stress_summary import show_stress
from rpctl.cli.terminal import kept_told, progress_bar
from rpctl.engines.engine import EngineMissing
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.errors import UnknownNameError, require_positive
from rpctl.files.writing import require_writable, to_json, write_together
from rpctl.libraries import library
from rpctl.reference.sizing import robot_length
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.simulation.plants.plant import SIMULATED
from rpctl.study.compare import LawPair, controllers
from rpctl.study.executor import executor_for
from rpctl.study.stress_battery import (
    CONTACT,
    DURATION,
    STRESSES,
    Battery,
    default_pair,
    default_pairs,
    run_battery,
    stresses_by_name,
)
from rpctl.study.stress_report import (
    TOLERANCE_RATIO,
    StressReport,
    report_csv,
    report_of,
    write_worst,
)

FILES = ("stress.json", "stress.csv", "envelope.png")
PICTURE = "rpctl.view.plots.stress"
COMBINATIONS, QUICK_COMBINATIONS = 10, 2
DEFAULT = "default"  # as a law: what the robot gets if nobody names others


@dataclass(frozen=True)
class BatteryOptions:
    """The options that choose the runs."""

    plants: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Of {', '.join(SIMULATED)}; all that are installed if not given.",
        ),
    ] = ""
    laws: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"{DEFAULT}, or pairs as unified+integral; the robot's own, the paper's and "
            "Kanayama's if not given. The first is the one that is judged.",
        ),
    ] = ""
    stresses: Annotated[
        str,
        typer.Option(metavar="NAME,...", help=f"Of {', '.join(STRESSES)}; all if not given."),
    ] = ""
    combinations: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Runs of each law on each plant with two stresses at once, at levels drawn within "
            f"their ranges; {COMBINATIONS} if not given.",
        ),
    ] = None
    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="What is tracked, as track takes it.")
    ] = "eight"
    duration: Annotated[float, typer.Option(metavar="S", help="Of each run, s.")] = DURATION
    seed: Annotated[int, typer.Option(min=0, help="Of noise and combinations.")] = 0
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Only the ends of each ladder, on the rolling plant, with the robot's own laws "
            f"and the paper's, and {QUICK_COMBINATIONS} combinations; what is named stays.",
        ),
    ] = False

    def battery(self, robot: Robot) -> Battery:
        """Return the battery that is asked for.

        Raises:
            RpctlError: There is no such plant, law or stress, or a number is out of range.
        """
        own = default_pairs(robot)
        stresses = stresses_by_name(split_names(self.stresses))
        combinations = QUICK_COMBINATIONS if self.quick else COMBINATIONS
        return Battery(
            robot,
            _laws(robot, split_names(self.laws)) or (own[:2] if self.quick else own),
            _plants(split_names(self.plants)) or _default_plants(robot, self.quick),
            tuple(each.extremes() for each in stresses) if self.quick else stresses,
            RunSettings(self.reference, self.duration),
            self.seed,
            combinations if self.combinations is None else self.combinations,
        )


def _laws(robot: Robot, names: list[str]) -> tuple[LawPair, ...]:
    found: list[LawPair] = []
    for name in names:
        found += [default_pair(robot)] if name == DEFAULT else controllers([name])
    return tuple(dict.fromkeys(found))


def _plants(names: list[str]) -> tuple[str, ...]:
    """Return the plants that are named.

    Raises:
        RpctlError: There is no such plant, or what simulates it is not installed.
    """
    for name in names:
        if name not in SIMULATED:
            raise UnknownNameError("plant", name, SIMULATED)
    if CONTACT in names:
        mujoco_library()
    return tuple(dict.fromkeys(names))


def _default_plants(robot: Robot, quick: bool) -> tuple[str, ...]:
    """Return the plants of a battery if nobody names them, and say what is left out for want of it.

    Args:
        robot: The robot; a fixed base neither rolls nor slips.
        quick: Whether the fastest is enough.
    """
    if quick or not robot.drive.base_speeds:
        return SIMULATED[:1]
    try:
        return _plants([*SIMULATED])
    except EngineMissing as error:
        say(f"the plant {CONTACT} is left out: {error}", err=True)
        return tuple(kind for kind in SIMULATED if kind != CONTACT)


def stress_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    selection: BatteryOptions,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="How far from its reference a run that passes may be, m; "
            f"{100 * TOLERANCE_RATIO:g} % of the robot's length if not given.",
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes; as many as there are processors.")
    ] = os.cpu_count() or 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with what the folder holds.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-stress if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find how far laws hold as payload, grip, delay, wheels, sensors, efforts, ground worsen.

    Each level of each stress is a run of each law on each plant; so are some with two stresses at
    once. The table gives a verdict on each by the rule that it prints; the folder holds all of it,
    a picture of each law's envelope, and its worst case as a file that `rpctl track --config`
    replays. Exit 1 if the first of the laws fails where nothing is stressed.
    """
    loaded = options.load(robot)
    battery = selection.battery(loaded)
    bound = TOLERANCE_RATIO * robot_length(loaded) if tolerance is None else tolerance
    require_positive("--tolerance", bound)
    folder = out or default_folder(loaded.name, "stress")
    for name in FILES:
        require_writable(folder / name, makes_folder=True)
    words = [robot, *options.words()]
    with (
        executor_for(workers) as executor,
        kept_told(folder, _again(words, selection, tolerance, folder)),
        progress_bar("stress", f"{len(battery.cells)} runs") as advance,
    ):
        figures = run_battery(battery, folder, executor, advance, resume)
    report = report_of(battery, figures, bound)
    worst = write_files(report, folder)
    if as_json:
        print_json(report.to_dict())
    else:
        show_stress(report, worst, join(["rpctl", "track", *words]))
    if report.nominal_failure is not None:
        raise typer.Exit(CHECK_FAILED)


def _again(
    words: list[str], selection: BatteryOptions, tolerance: float | None, folder: Path
) -> str:
    """Return the command line that goes on with a battery.

    Args:
        words: The robot and how it is loaded.
        selection: Which runs.
        tolerance: As it was given.
        folder: Where they are kept.
    """
    given = {**vars(selection), "tolerance": tolerance}
    defaults = {**vars(BatteryOptions()), "tolerance": None}
    more = []
    for name, value in given.items():
        if value != defaults[name]:
            more += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    return join(["rpctl", "stress", *words, *more, "--out", str(folder), "--resume"])


def write_files(report: StressReport, folder: Path) -> list[Path]:
    """Write the report, its table, its picture and the worst cases.

    Args:
        report: The report.
        folder: Where.

    Returns:
        The configurations of the worst cases, in the report's order.
    """
    picture = library(PICTURE)  # imports Matplotlib
    contents = (
        (to_json(report.to_dict()) + "\n").encode(),
        report_csv(report).encode("utf-8", "backslashreplace"),
        picture.stress_image(report),
    )
    write_together(folder, dict(zip(FILES, contents, strict=True)))
    return write_worst(report, folder)
