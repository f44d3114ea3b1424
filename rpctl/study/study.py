"""A study: runs of one robot that differ in some settings, kept on disk as they end."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from shlex import quote
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, OneOf, Range, Record, Setting
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.simulation.loop.track import require_affordable
from rpctl.simulation.merits.outcome import ON_PATH_M, TRACKED
from rpctl.study.executor import Executor
from rpctl.study.experiment import (
    DESIGNS,
    Design,
    Experiment,
    Progress,
    RunTable,
    extra,
    join_tables,
    whole,
)
from rpctl.study.merits import MERITS, merits_for
from rpctl.study.runner import Runner, run_rows
from rpctl.study.scatter import Scatter, settings_at
from rpctl.study.statistics import worst_rows
from rpctl.study.store import (
    RUNS_FILE,
    Journal,
    identity,
    read_runs,
    record_of,
    table_of,
    write_runs,
)

STUDY_FILE, JOURNAL_FILE = "study.toml", "runs.jsonl"
STATISTICS = ("mean", "quantile", "worst")
METHODS = ("differential-evolution",)
MERIT = "rms_base_error"  # that runs are compared by, unless the study names another


@dataclass(frozen=True)
class StudySettings(Record):
    """The table ``[study]`` of a file."""

    design: Annotated[str, OneOf(tuple(DESIGNS)), Setting(help=", ".join(DESIGNS))] = "monte-carlo"
    count: Annotated[
        int,
        whole(1),
        Setting(help="number of runs, at most, if the design needs a particular number"),
    ] = 100
    seed: Annotated[int, whole(0), Setting(help="seed of all random numbers")] = 0
    duration: Annotated[
        float | None, POSITIVE, Setting("s", help="duration of each run; default: that of [run]")
    ] = None
    samples: Annotated[
        int, whole(2), Setting(help="largest number of points of the curves over time")
    ] = 200
    chunk: Annotated[int | None, whole(1), Setting(help="runs in a chunk")] = None
    merit: Annotated[str, Setting(help="figure of merit that ranks runs, the worst first")] = MERIT
    worst: Annotated[
        int, whole(0), Setting(help="number of the worst runs to write for replay")
    ] = 3
    tolerance: Annotated[
        float,
        POSITIVE,
        Setting("m", help="largest error of a run that succeeds, on average over its last quarter"),
    ] = ON_PATH_M


@dataclass(frozen=True)
class Optimisation(Record):
    """The table ``[optimize]`` of a file, but for the settings and their ranges.

    The cost is the statistic of the merit over the runs that have it, plus ``failure_weight`` times
    the share of runs that did not succeed.
    """

    merit: Annotated[str, Setting(help="figure of merit to minimise")] = MERIT
    statistic: Annotated[
        str, OneOf(STATISTICS), Setting(help=f"statistic over the scatter: {', '.join(STATISTICS)}")
    ] = "mean"
    level: Annotated[
        float, Range(1e-6, 1.0 - 1e-6, "one between 0 and 1"), Setting(help="level of the quantile")
    ] = 0.95
    failure_weight: Annotated[
        float, NOT_NEGATIVE, Setting(help="cost of the fraction of runs that fail")
    ] = 1.0
    evaluations: Annotated[int, whole(1), Setting(help="number of sets of settings to try")] = 200
    runs: Annotated[
        int, whole(1), Setting(help="runs of each set, with the same scatter and noise for all")
    ] = 32
    validation: Annotated[
        int, whole(2), Setting(help="fresh runs with the settings found, and with the file's")
    ] = 200
    method: Annotated[str, OneOf(METHODS)] = METHODS[0]

    def population(self, settings: int) -> int:
        """Return how many sets of so many settings are tried at a time.

        Raises:
            RpctlError: Two generations do not fit the budget.
        """
        if not settings:
            raise RpctlError("there is nothing to optimise; write settings and their ranges under "
                             "[optimize.parameters]")  # fmt: skip
        population = max(8, 4 * settings)
        if self.evaluations < 2 * population:
            raise RpctlError(f"evaluations is {self.evaluations}; give {2 * population} or more")
        return population

    def cost(self, merit: Array, success: NDArray[np.bool_]) -> float:
        """Return what a set of settings costs.

        Args:
            merit: Of each run (N,); inf where a run has none.
            success: Which runs (N,) succeeded.
        """
        known = merit[np.isfinite(merit)]
        if not len(known):
            return float(np.inf)
        return self.figure(known) + self.failure_weight * (1.0 - float(np.mean(success)))

    def figure(self, known: Array) -> float:
        """Return the statistic of merits (K,), all finite."""
        if self.statistic == "mean":
            return float(np.mean(np.sort(known)))
        level = 1.0 if self.statistic == "worst" else self.level
        return float(np.quantile(known, level, method="inverted_cdf"))


@dataclass(frozen=True)
class Study:
    """What is run, and how it is judged.

    Attributes:
        experiment: What all runs have in common; its names are those of the scatter.
        scatter: What differs.
        settings: How often, and what runs are compared by.
        success: The largest merit that a run that succeeds may have, by name; none: it tracked
            within the experiment's tolerance and broke no limit.
        ranges: Settings to be found: paths, each with a distribution whose ends are its range.
        optimisation: What they are judged by; None: nothing is to be found.
        text: The study's file.
        command: What tracks the robot on the command line; empty: ``rpctl track`` with its source.
    """

    experiment: Experiment
    scatter: Scatter = field(default_factory=Scatter)
    settings: StudySettings = field(default_factory=StudySettings)
    success: Mapping[str, float] = field(default_factory=dict)
    ranges: Scatter = field(default_factory=Scatter)
    optimisation: Optimisation | None = None
    text: str = ""
    command: str = ""

    @property
    def design(self) -> Design:
        """At which points of the scatter runs are done."""
        return Design(self.settings.design, self.settings.count, self.settings.seed)

    @cached_property
    def values(self) -> Array:
        """Settings of all runs (N, n)."""
        return settings_at(self.scatter, self.design.points(len(self.scatter.names)))

    def config_of(self, run: int) -> Config:
        """Return the configuration of a run, which ``rpctl track --config`` replays."""
        return self.experiment.config_of(self.values[run], run)


def run_study(
    robot: Robot,
    study: Study,
    out: Path,
    executor: Executor | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> Path:
    """Run a study, and write its runs to ``runs.parquet``, which is returned.

    Its rows do not depend on the executor, nor on chunks and their order. What ends it early leaves
    the chunks that are done in the folder ``out``; to resume goes on with them. ``progress`` is
    called with the runs done and their number.

    Raises:
        RpctlError: The study does not fit the robot, or the folder holds something else.
    """
    merits_for(robot, (study.settings.merit, *study.success))
    extra("pyarrow.parquet")  # a library that is missing is told before anything is written
    config = study.experiment.config
    known = config.limits.apply(robot)
    reference = study.experiment.reference or config.run.load_reference(known)
    require_affordable(known, config, reference)
    design = vars(study.design)
    if study.design.kind == "monte-carlo":  # of which more runs extend a study
        design = {name: value for name, value in design.items() if name != "count"}
    follows_from = identity(robot, study.experiment, study.scatter, study.design)
    follows_from["design"] = design
    journal = Journal(out / JOURNAL_FILE, follows_from, "a study")
    tables = _kept(journal, resume)
    if study.text:
        write_atomically(out / STUDY_FILE, study.text.encode(), follow_links=False)
    total, notify = len(study.values), progress or (lambda done, total: None)
    rows = np.setdiff1d(np.arange(total), [row for table in tables for row in table.index])
    count = total - len(rows)
    notify(count, total)
    runner, worker = Runner(robot, study.experiment), executor or Executor()
    for table in run_rows(runner, rows, rows, study.values, worker, study.settings.chunk):
        journal.add(record_of(table))
        tables.append(table)
        count += len(table)
        notify(count, total)
    runs = join_tables(tables, total)
    units = {name: merit.unit for name, merit in MERITS.items()}
    details = {
        "identity": journal.identity,
        "source": robot.source,
        "count": study.design.count,
        "merit": study.settings.merit,
        "worst": study.settings.worst,
        "success": dict(study.success),
        "study": study.text,
        "command": study.command or f"rpctl track {quote(robot.source)}",
    }
    success = succeeded(runs.merits, runs.outcomes, study.success)
    write_runs(out / RUNS_FILE, runs, success, details, units)
    journal.rewrite([])
    _write_worst(study, out, runs)
    return out / RUNS_FILE


def _kept(journal: Journal, resume: bool) -> list[RunTable]:
    """Return the runs that a folder holds, of its journal and of a study that has ended.

    Raises:
        RpctlError: They are not to be gone on with, or of something else.
    """
    tables = [table_of(each) for each in journal.begin(resume)]
    path = journal.path.parent / RUNS_FILE
    if path.exists():
        finished, details = read_runs(path)
        journal.require_same(details["identity"], resume)
        tables.append(finished)
    return tables


def _write_worst(study: Study, out: Path, runs: RunTable) -> None:
    """Write the configurations of the worst runs, in the place of any before."""
    for left in out.glob(worst_file("*")):
        left.unlink(missing_ok=True)
    rows = worst_rows(runs.merits[study.settings.merit], study.settings.worst)
    for k, row in enumerate(rows.tolist(), start=1):
        with suppress(RpctlError):  # a run that was refused for its settings has no configuration
            write_config(study.config_of(int(runs.index[row])), out / worst_file(k))


def worst_file(k: object) -> str:
    """Return the name of the configuration of the k-th worst run."""
    return f"worst-{k}.toml"


def succeeded(
    merits: Mapping[str, Array], outcomes: tuple[str, ...], success: Mapping[str, float]
) -> NDArray[np.bool_]:
    """Return which runs (K,) succeeded.

    Args:
        merits: By name, (K,) each.
        outcomes: In a word, K of them.
        success: The largest merits, by name; none: the outcome decides.
    """
    if not success:
        return np.array([each == TRACKED for each in outcomes], bool)
    kept = [merits[name] <= largest for name, largest in success.items()]
    return np.asarray(np.all(kept, axis=0))
