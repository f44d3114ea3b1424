"""Many runs with scattered settings, and robust settings: ``rpctl study``."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import join
from typing import Annotated, Any

import typer
from rich.console import Console

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, default_folder, tell
from rpctl.cli.terminal import (
    console,
    escape,
    kept_told,
    new_table,
    print_document,
    print_json,
    progress_bar,
    say,
)
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable, to_json, write_atomically
from rpctl.libraries import library
from rpctl.robot.model import Robot
from rpctl.simulation.loop.backend import BACKENDS
from rpctl.study.cluster import DaskExecutor
from rpctl.study.executor import Executor, executor_for
from rpctl.study.experiment import extra
from rpctl.study.merits import (
    REFUSED,
    Unit,
    grouped,
    merit_unit,
    merit_words,
    number,
    parameter_words,
    percent,
    share_span,
    unit_of,
)
from rpctl.study.optimise import BETTER, optimise, optimum_sentence, statistic_words
from rpctl.study.statistics import Interval, Sensitivity, importances
from rpctl.study.store import RUNS_FILE
from rpctl.study.study import Study, run_study
from rpctl.study.study_file import read_study, study_template
from rpctl.study.study_result import StudyResult, read_result, replay_command

SUMMARY_FILE = "study.json"
SHOWN = 5  # parameters that are named for a merit
MEASURES = {  # of a sensitivity: what is shown
    "sobol": "share of variance",
    "morris": "mean change",
    "rank-correlation": "rank correlation",
}
NAME_WIDTH = 40  # characters of a parameter's name in one line


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run, and what is written."""

    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default: runs/ROBOT-FILE."),
    ] = None
    workers: Annotated[
        int, typer.Option(min=1, help="Number of processes; default: one for each processor.")
    ] = os.cpu_count() or 1
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Keep the runs that the folder holds, and do the others; a "
            "monte-carlo study can grow.",
        ),
    ] = False
    optimize: Annotated[
        bool,
        typer.Option(
            "--optimize",
            help="Search for the best values of the settings under [optimize] in FILE.",
        ),
    ] = False
    backend: Annotated[
        str,
        typer.Option(metavar="|".join(BACKENDS), help="Code that simulates, as for `rpctl track`."),
    ] = "auto"
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address of a Dask scheduler, such as tcp://10.0.0.1:8786, to use more machines.",
        ),
    ] = None
    html: Annotated[bool, typer.Option(help="Write a report as a page.")] = True

    def executor(self) -> Executor:
        """Return what runs the chunks."""
        if self.scheduler is not None:
            return DaskExecutor(self.scheduler, tell=lambda text: say(text, err=True))
        return executor_for(self.workers)


def study_command(
    *,
    robot: RobotArgument,
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="The study (TOML); see --template.")
    ] = None,
    options: LoadOptions,
    settings: StudyOptions,
    template: Annotated[
        bool, typer.Option("--template", help="Print a study file for the robot, and stop.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a robot many times with varied settings; report outcomes and what causes them.

    FILE says what varies (masses, friction, delay, noise, the start, gains) and how many runs there
    are. Writes all runs to runs.parquet, statistics to study.json, and the worst runs to files that
    `rpctl track --config` replays. With --optimize, searches for settings that are good over the
    whole scatter, compares them with those of FILE on fresh runs, and writes optimized.toml.
    """
    loaded = options.load(robot)
    if template:
        tell(
            as_json,
            lambda: {"text": study_template(loaded)},
            lambda: print_document(study_template(loaded)),
        )
        return
    if file is None:
        raise RpctlError("no study file is given; `rpctl study ROBOT --template` prints one")
    extra("pyarrow.parquet")  # told before any run
    words = [robot, *options.words()]
    study = read_study(file, loaded, settings.backend)
    study = replace(study, command=join(["rpctl", "track", *words]))
    if study.design.kind in ("sobol", "morris"):
        extra("SALib.util")
    folder = settings.out or default_folder(loaded.name, file.stem)
    again = join(["rpctl", "study", *words, str(file), "--out", str(folder), "--resume"])
    again += " --optimize" * settings.optimize
    require_writable(folder / SUMMARY_FILE, makes_folder=True)
    run = _optimise if settings.optimize else _run
    with settings.executor() as executor, kept_told(folder, again):
        run(loaded, study, folder, settings, executor, as_json)


def _run(
    robot: Robot,
    study: Study,
    folder: Path,
    settings: StudyOptions,
    executor: Executor,
    as_json: bool,
) -> None:
    """Run the design, write what it found, and print it."""
    with progress_bar("study", f"{len(study.values)} runs") as advance:
        run_study(robot, study, folder, executor, advance, settings.resume)
    result = read_result(folder)
    if {*result.runs.outcomes} == {REFUSED}:
        raise RpctlError(f"none of the runs could start: {result.runs.reasons[0]}")
    content = result.to_dict()
    files = [RUNS_FILE, SUMMARY_FILE]
    write_atomically(folder / SUMMARY_FILE, (to_json(content) + "\n").encode(), follow_links=False)
    if settings.html:
        page = library("rpctl.view.pages.study")  # imports Matplotlib and the scene
        files += [page.write_study_report(folder, robot).name, page.PICTURE_FILE]
    if as_json:
        print_json(content)
        return
    show_study(result)
    console().print(f"wrote [bold]{escape(str(folder))}[/]: {', '.join(files)}")


def _optimise(
    robot: Robot,
    study: Study,
    folder: Path,
    settings: StudyOptions,
    executor: Executor,
    as_json: bool,
) -> None:
    """Find settings, write them, and print them."""
    asked = study.optimisation
    details = "" if asked is None else f"{asked.evaluations} settings of {asked.runs} runs"
    with progress_bar("optimize", details) as advance:
        found = optimise(robot, study, folder, executor, advance, settings.resume)
    tell(as_json, lambda: found, lambda: show_optimum(found, study.command))


def show_study(result: StudyResult) -> None:
    """Print what a study found."""
    out = console()
    out.print(f"[bold]{escape(result.robot)}[/]: {grouped(len(result.runs))} runs, "
              f"{result.design.kind} design of {len(result.scatter)} parameters, "
              f"seed {result.design.seed}")  # fmt: skip
    style = "green" if result.success.value == 1.0 else "yellow"
    success = f"{percent(result.success.value)} (95 % interval {share_span(result.success)})"
    counts = Counter(result.runs.outcomes).most_common()
    outcomes = ", ".join(f"{grouped(count)} {escape(word)}" for word, count in counts)
    out.print(f"[{style}]success[/] {success}   {outcomes}")
    out.print()
    _show_statistics(out, result)
    found = result.sensitivity_of(result.merit)
    if found is not None:
        out.print()
        _show_sensitivity(out, result, found)
    if result.worst:
        out.print()
        _show_worst(out, result)


def _show_statistics(out: Console, result: StudyResult) -> None:
    table = new_table("merit", ">median", ">5 to 95 % of runs", ">worst", "unit")
    for each in result.statistics:
        at = {level: found.value for level, found in each.quantiles.items()}
        unit = unit_of(result.units.get(each.name, ""), each.largest)
        table.add_row(
            merit_words(each.name),
            number(at[0.5], Unit(unit.factor, "")),
            _span(at[0.05], at[0.95], unit.factor),
            number(math.inf if each.missing else each.largest, Unit(unit.factor, "")),
            unit.name,
            style="bold" if each.name == result.merit else "",
        )
    out.print(table)
    if any(each.missing for each in result.statistics):
        out.print("[dim]∞: some runs have no such figure, as they ended early[/]")


def _show_sensitivity(out: Console, result: StudyResult, found: Sensitivity) -> None:
    bars, unit = importances(found, SHOWN), Unit(1.0, "")
    if found.method == "morris":
        unit = unit_of(result.units.get(found.merit, ""), max(abs(each.value) for each in bars))
    head = MEASURES[found.method] + (f" ({unit.name})" if unit.name else "")
    told = found.method == "rank-correlation"
    table = new_table(f"what matters to {merit_words(found.merit)}", f">{head}", ">95 % interval",
                      *["way"] * told)  # fmt: skip
    table.columns[0].max_width = NAME_WIDTH
    for each in bars:
        table.add_row(
            escape(parameter_words(each.name).name),
            number(each.value, Unit(unit.factor, "")),
            _span(each.low, each.high, unit.factor),
            *[each.way] * told,
        )
    out.print(table)


def _show_worst(out: Console, result: StudyResult) -> None:
    out.print(f"worst by {merit_words(result.merit)}:")
    unit = unit_of(result.units.get(result.merit, ""), max(each.value for each in result.worst))
    for each in result.worst:
        value = number(each.value, unit)
        out.print(f"  run {each.run}: {value}, {escape(each.outcome)}: {escape(each.reason)}")
        if each.command:
            out.print(f"    [dim]{escape(each.command)}[/]", soft_wrap=True)


def show_optimum(found: Mapping[str, Any], command: str) -> None:
    """Print what a search found, as ``optimum.json`` holds it, and how to track with it."""
    out = console()
    table = new_table("setting", ">in the file", ">found", ">range", "unit")
    for name, each in found["settings"].items():
        before = "–" if each["before"] is None else number(each["before"])
        table.add_row(
            escape(parameter_words(name).name), before, number(each["after"]),
            _span(*each["range"]), parameter_words(name).unit,
        )  # fmt: skip
    out.print(table)
    out.print()
    checked = found["validation"]
    table = new_table(f"{checked['runs']} fresh runs", ">success", f">{statistic_words(found)}",
                      ">95 % interval")  # fmt: skip
    unit = unit_of(merit_unit(found["merit"]), checked["before"]["statistic"]["value"])
    for name, words in (("before", "as in the file"), ("after", "found")):
        each = checked[name]
        value = Interval(**each["statistic"])
        table.add_row(words, percent(each["success"]["value"]), number(value.value, unit),
                      _span(value.low, value.high, unit.factor))  # fmt: skip
    out.print(table)
    out.print()
    verdict, text = optimum_sentence(found)
    style = {BETTER: "green"}.get(verdict, "yellow")
    out.print(f"[{style}]{verdict}[/]{escape(text.removeprefix(verdict))}", soft_wrap=True)
    share = Interval(**checked["better"])
    out.print(f"smaller in {percent(share.value)} of the runs ({share_span(share)}), each with the "
              f"same scatter; {found['evaluations']} sets of settings were tried")  # fmt: skip
    if verdict != BETTER:
        out.print(
            "too few runs to decide: raise runs under [optimize], or keep the file's settings"
        )
    kind = "the settings found" if verdict == BETTER else "what was found"
    replay = replay_command(command, Path(found["config"]))
    out.print(f"use {kind}: [bold]{escape(replay)}[/]", soft_wrap=True)


def _span(low: float, high: float, factor: float = 1.0) -> str:
    unit = Unit(factor, "")
    return f"{number(low, unit)} to {number(high, unit)}"
