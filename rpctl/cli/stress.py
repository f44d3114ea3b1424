"""The battery of stresses: ``rpctl stress``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import join, quote
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, split_names, tell
from rpctl.cli.results import writable_folder, write_results
from rpctl.cli.terminal import console, escape, kept_told, new_table, progress_bar, say
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from rpctl.errors import EngineMissing, require_known, require_positive
from rpctl.libraries import library
from rpctl.reference.sizing import robot_length
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.simulation.plants.plant import SIMULATED
from rpctl.study.cells import CONTACT, REFUSED
from rpctl.study.compare import LawPair, controllers
from rpctl.study.executor import executor_for
from rpctl.study.stress_battery import (
    DURATION,
    STRESSES,
    Battery,
    default_pair,
    default_pairs,
    run_battery,
    stresses_by_name,
)
from rpctl.study.stress_report import (
    DEGRADE,
    FAIL,
    PASS,
    TOLERANCE_RATIO,
    VERDICTS,
    StressReport,
    StressRow,
    error_text,
    report_csv,
    report_of,
    rule,
    write_worst,
)
from rpctl.study.study_result import replay_command

FILES = ("stress.json", "stress.csv", "envelope.png", "stress.html")
COMBINATIONS, QUICK_COMBINATIONS = 10, 2
WIDTH = 100  # characters
WHY_WIDTH = 40  # characters of a line that says why
MARKS = {PASS: "✓", DEGRADE: "~", FAIL: "✗", REFUSED: "-"}
STYLES = {PASS: "green", DEGRADE: "yellow", FAIL: "bold red", REFUSED: "dim"}
DEFAULT = "default"  # as a law: what the robot gets if nobody names others


@dataclass(frozen=True)
class BatteryOptions:
    """The options that choose the runs."""

    plants: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Plants: {', '.join(SIMULATED)}; default: all that are installed.",
        ),
    ] = ""
    laws: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"{DEFAULT}, or pairs such as unified+integral. The exit code judges the first. "
            "Default: the robot's own laws, the paper's and Kanayama's.",
        ),
    ] = ""
    stresses: Annotated[
        str,
        typer.Option(metavar="NAME,...", help=f"Stresses: {', '.join(STRESSES)}; default: all."),
    ] = ""
    combinations: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Runs of each law on each plant with two stresses at once, at random levels; "
            f"default: {COMBINATIONS}.",
        ),
    ] = None
    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="Reference, as for `rpctl track`.")
    ] = "eight"
    duration: Annotated[float, typer.Option(metavar="S", help="Duration of each run, s.")] = (
        DURATION
    )
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and combinations.")] = 0
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Try the extreme levels only, on the rolling plant, with the robot's own laws "
            f"and the paper's, and {QUICK_COMBINATIONS} combinations; other options still "
            "apply.",
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
    require_known("plant", names, SIMULATED)
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


@dataclass(frozen=True)
class StressOptions:
    """How a battery is judged and run, and what is written where."""

    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Largest tracking error of a run that passes, m; default: "
            f"{100 * TOLERANCE_RATIO:g} % of the robot's length.",
        ),
    ] = None
    workers: Annotated[
        int, typer.Option(min=1, help="Number of processes; default: one for each processor.")
    ] = os.cpu_count() or 1
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Keep the runs that the folder holds, and do the others."),
    ] = False
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default: runs/ROBOT-stress."),
    ] = None


def stress_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    selection: BatteryOptions,
    settings: StressOptions,
    as_json: JsonOption = False,
) -> None:
    """Find how much payload, delay, noise, slip and other stress laws bear before they fail.

    Runs each law on each plant at each level of each stress, and with some pairs of stresses. The
    table gives a verdict on each run, by the rule printed above it. The folder holds all verdicts,
    a page of them, a picture of each law's envelope, and its worst case as a file that
    `rpctl track --config` replays. Exit 1 if the first law fails without stress.
    """
    loaded = options.load(robot)
    battery, bound = selection.battery(loaded), settings.tolerance
    bound = TOLERANCE_RATIO * robot_length(loaded) if bound is None else bound
    require_positive("--tolerance", bound)
    folder = writable_folder(settings.out, loaded.name, "stress", FILES)
    words = [robot, *options.words()]
    with (
        executor_for(settings.workers) as executor,
        kept_told(folder, _again(words, selection, settings.tolerance, folder)),
        progress_bar("stress", f"{len(battery.cells)} runs") as advance,
    ):
        figures = run_battery(battery, folder, executor, advance, settings.resume)
    report = report_of(battery, figures, bound)
    picture = library("rpctl.view.plots.stress").stress_figure(report)  # imports Matplotlib
    worst = write_worst(report, folder)
    track = join(["rpctl", "track", *words])
    commands = [(path.name, replay_command(track, path)) for path in worst]
    page = library("rpctl.view.pages.stress").stress_page(report, commands)
    write_results(folder, FILES, report.to_dict(), picture, report_csv(report), page)
    held = report.nominal_failure is None
    tell(as_json, report.to_dict, lambda: show_stress(report, worst, commands[0][1]), held)


def _again(
    words: list[str], selection: BatteryOptions, tolerance: float | None, folder: Path
) -> str:
    """Return the command line that goes on with a battery of a robot, which ``words`` name."""
    given = {**vars(selection), "tolerance": tolerance}
    defaults = {**vars(BatteryOptions()), "tolerance": None}
    more = []
    for name, value in given.items():
        if value != defaults[name]:
            more += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    return join(["rpctl", "stress", *words, *more, "--out", str(folder), "--resume"])


def show_stress(report: StressReport, worst: Sequence[Path], replay: str) -> None:
    """Print what a battery found.

    Args:
        report: It.
        worst: Configurations of the worst cases, in the report's order.
        replay: The command that replays the first of them.
    """
    out = console()
    out.width = min(out.width, WIDTH)
    battery = report.battery
    out.print(f"[bold]{escape(battery.robot.name)}[/]: {len(report.rows)} runs of "
              f"{battery.run.duration:g} s on {escape(battery.run.reference)}, seed "
              f"{battery.seed}; errors in mm, the larger of base and end effector")  # fmt: skip
    out.print(f"[dim]{escape(rule(report.tolerance))}[/]")
    for plant in battery.plants:
        out.print()
        out.print(_table(report, plant))
        _show_left_out(out, report, plant)
    out.print()
    _show_worst(out, report, worst, replay)
    failure = report.nominal_failure
    if failure is not None:
        out.print(f"[bold red]{escape(str(failure.cell))}[/]: {escape(failure.verdict.reason)}")


def _table(report: StressReport, plant: str) -> Table:
    """Return the ladders of one plant: a block a stress, a line a pair of laws."""
    battery = report.battery
    stresses = battery.stresses_on(plant)
    most = max((len(stress.levels) for stress in stresses), default=1)
    table = new_table(f"[bold]{plant}[/]", *[">"] * most)
    table.padding = (0, 1, 0, 0)
    for stress in stresses:
        label = f"{stress.name} {stress.unit}".rstrip()
        table.add_row(f"[dim]{label}[/]", *(f"[dim]{stress.text(x)}  [/]" for x in stress.levels))
        for law in battery.laws:
            rows = [report.row(plant, law, stress, level) for level in stress.levels]
            table.add_row(f"  {law}", *map(cell_text, rows))
    if battery.combinations and len(stresses) > 1:
        table.add_row("[dim]two at once[/]", *(f"[dim]{name}  [/]" for name in VERDICTS[:most]))
        for law in battery.laws:
            ended = Counter(row.verdict.name for row in report.combined(plant, law))
            marks = (f"[{STYLES[x]}]{ended[x]} {MARKS[x]}[/]" for x in VERDICTS[:most])
            table.add_row(f"  {law}", *marks)
    return table


def cell_text(row: StressRow) -> str:
    """Return the verdict on a run and its error in mm, as markup: ``3.1 ✓``."""
    name = row.verdict.name
    return f"[{STYLES[name]}]{f'{error_text(row.figures.late_error)} {MARKS[name]}'.strip()}[/]"


def _show_left_out(out: Console, report: StressReport, plant: str) -> None:
    """Print what a plant leaves out, where wheels hang, and why runs were refused, once each."""
    left = [
        f"{stress} ({reason})"
        for (of, stress), reason in report.battery.left_out.items()
        if of == plant
    ]
    if left:
        out.print(f"[dim]left out: {escape(', '.join(left))}[/]")
    for sentence in report.hanging(plant):
        out.print(f"[yellow]{escape(sentence)}[/]")
    refused = (r for r in report.rows if r.cell.plant == plant and r.verdict.name == REFUSED)
    for law, reason in dict.fromkeys((str(row.cell.law), row.verdict.reason) for row in refused):
        out.print(f"[dim]{law}: did not run: {escape(reason)}[/]")


def _show_worst(out: Console, report: StressReport, worst: Sequence[Path], replay: str) -> None:
    """Print the worst case of each pair of laws on each plant, and how to replay one."""
    table = new_table("worst case", "plant", "law", "", "stressed", "why")
    table.columns[-1].max_width = WHY_WIDTH
    for row, path in zip(report.worst(), worst, strict=True):
        name = row.verdict.name
        table.add_row(
            path.name,
            row.cell.plant,
            str(row.cell.law),
            f"[{STYLES[name]}]{name}[/]",
            row.cell.words,
            escape(row.verdict.reason),
        )
    out.print(table)
    view = f"rpctl view {quote(str(worst[0].with_suffix('')))}"
    out.print("to replay one and look at it:")
    out.print(f"  [bold]{escape(f'{replay}; {view}')}[/]", soft_wrap=True)
    out.print(f"wrote [bold]{escape(str(worst[0].parent))}[/]: {', '.join(FILES)} "
              f"and {len(worst)} worst cases")  # fmt: skip
