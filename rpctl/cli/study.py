"""Many runs with scattered settings, and robust settings: ``rpctl study``."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import join
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, default_folder
from rpctl.cli.streams import print_document, print_json, say
from rpctl.cli.study_summary import show_optimum, show_study
from rpctl.cli.terminal import console, escape, kept_told, progress_bar
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable, to_json, write_atomically
from rpctl.libraries import library
from rpctl.robot.model import Robot
from rpctl.simulation.loop.backend import BACKENDS
from rpctl.study.cluster import DaskExecutor
from rpctl.study.design import extra
from rpctl.study.executor import Executor, executor_for
from rpctl.study.merits import REFUSED
from rpctl.study.optimise import optimise
from rpctl.study.store import RUNS_FILE
from rpctl.study.study import Study, run_study
from rpctl.study.study_file import read_study, study_template
from rpctl.study.study_result import read_result

SUMMARY_FILE = "study.json"
PAGE = "rpctl.view.pages.study"


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run, and what is written."""

    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-FILE if not given."),
    ] = None
    workers: Annotated[
        int, typer.Option(min=1, help="Processes; as many as there are processors.")
    ] = os.cpu_count() or 1
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with what the folder holds; more runs extend monte-carlo."
        ),
    ] = False
    optimize: Annotated[
        bool,
        typer.Option(
            "--optimize", help="Find the settings under [optimize] that are best over the scatter."
        ),
    ] = False
    backend: Annotated[str, typer.Option(metavar="|".join(BACKENDS), help="What simulates.")] = (
        "auto"
    )
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Of a Dask scheduler, as tcp://10.0.0.1:8786, for more machines.",
        ),
    ] = None
    html: Annotated[bool, typer.Option(help="Write a report to look at.")] = True

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
        bool, typer.Option("--template", help="Print a study file that fits the robot, and end.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run a robot many times with settings that differ, and tell what became of it and why.

    What differs (masses, friction, delay, noise, the start, gains) and how often is said in FILE.
    All runs go to runs.parquet, figures to study.json, the worst runs to files that `rpctl track
    --config` replays. With --optimize it finds settings that are good over all the scatter instead,
    compares them with those of FILE on a fresh one, and writes optimized.toml.
    """
    loaded = options.load(robot)
    if template:
        print_document(study_template(loaded))
        return
    if file is None:
        raise RpctlError("give a study file; `rpctl study ROBOT --template` prints one")
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
    with settings.executor() as executor, kept_told(folder, again):
        if settings.optimize:
            _optimise(loaded, study, folder, settings, executor, as_json)
        else:
            _run(loaded, study, folder, settings, executor, as_json)


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
        raise RpctlError(f"no run could be made: {result.runs.reasons[0]}")
    content = result.to_dict()
    files = [RUNS_FILE, SUMMARY_FILE]
    write_atomically(folder / SUMMARY_FILE, (to_json(content) + "\n").encode(), follow_links=False)
    if settings.html:
        files += _write_report(folder, robot)
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
    if as_json:
        print_json(found)
    else:
        show_optimum(found, study.command)


def _write_report(folder: Path, robot: Robot) -> list[str]:
    """Write the report and the picture; return their names."""
    page = library(PAGE)  # imports Matplotlib and the scene
    return [page.write_study_report(folder, robot).name, page.PICTURE_FILE]
