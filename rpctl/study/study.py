"""A study: runs of one robot that differ in some settings, kept on disk as they end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError, require_positive, require_within
from rpctl.files.writing import write_atomically
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.simulation.merits.outcome import ON_PATH_M, TRACKED
from rpctl.study.design import Design, extra
from rpctl.study.executor import Executor
from rpctl.study.experiment import Experiment, Progress, RunTable, join_tables
from rpctl.study.journal import Journal
from rpctl.study.merits import MERITS, merits_for
from rpctl.study.provenance import code_identity, experiment_identity
from rpctl.study.runner import RunChunk, Runner
from rpctl.study.scatter import Scatter, settings_at
from rpctl.study.statistics import worst_rows
from rpctl.study.store import RUNS_FILE, read_runs, record_of, table_of, write_runs

STUDY_FILE, JOURNAL_FILE = "study.toml", "runs.jsonl"
LARGEST_CHUNK = 256  # runs
CHUNKS_EACH = 8  # for each worker, where the study is large enough
LANES = 8  # chunks are whole numbers of them: the most that any processor runs side by side
STATISTICS = ("mean", "quantile", "worst")
METHODS = ("differential-evolution",)
MERIT = "rms_base_error"  # that runs are compared by, unless the study names another


@dataclass(frozen=True)
class StudySettings:
    """The table ``[study]`` of a file.

    Attributes:
        design: ``monte-carlo``, ``grid``, ``latin-hypercube``, ``sobol`` or ``morris``.
        count: The most runs.
        seed: Of all that is drawn.
        duration: Of each run, s; None: as ``[run]`` says, or as long as the reference moves.
        samples: The most points of a series over time.
        chunk: Runs that are done at a time; None: as many as suits the workers.
        merit: That runs are compared by, the worst first; larger is worse.
        worst: How many of the worst runs are written as configurations.
        tolerance: How far from its reference a run that succeeds may end, m.
    """

    design: str = "monte-carlo"
    count: int = 100
    seed: int = 0
    duration: float | None = None
    samples: int = 200
    chunk: int | None = None
    merit: str = MERIT
    worst: int = 3
    tolerance: float = ON_PATH_M

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        Design(self.design, self.count, self.seed)
        if self.duration is not None:
            require_positive("duration", self.duration)
        require_positive("tolerance", self.tolerance)
        fewest = {"samples": 2, "chunk": 1, "worst": 0}
        for name, least in fewest.items():
            value = getattr(self, name)
            if value is not None and value < least:
                raise RpctlError(f"{name} is {value}; give a whole number, {least} or more")


@dataclass(frozen=True)
class Optimisation:
    """The table ``[optimize]`` of a file, but for the settings and their ranges.

    The cost is the statistic of the merit over the runs that have it, plus ``failure_weight`` times
    the share of runs that did not succeed.

    Attributes:
        merit: That is to be small.
        statistic: Of the merit over the scatter: one of :data:`STATISTICS`.
        level: Of the quantile.
        failure_weight: What the share of runs that fail costs, in the merit's unit.
        evaluations: The most sets of settings that are tried.
        runs: Of each set of settings, the same scattered plants and noise for all.
        validation: Fresh runs with the settings that were found, and with those of the file.
        method: One of :data:`METHODS`.
    """

    merit: str = MERIT
    statistic: str = "mean"
    level: float = 0.95
    failure_weight: float = 1.0
    evaluations: int = 200
    runs: int = 32
    validation: int = 200
    method: str = METHODS[0]

    def __post_init__(self) -> None:
        """Refuse what cannot be optimised."""
        if self.statistic not in STATISTICS:
            raise UnknownNameError("statistic", self.statistic, STATISTICS)
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if not 0.0 < self.level < 1.0:
            raise RpctlError(f"level is {self.level:g}; give one between 0 and 1")
        if self.failure_weight < 0.0:
            raise RpctlError(f"failure_weight is {self.failure_weight:g}; give 0 or more")
        require_within("failure_weight", [self.failure_weight])
        for name, least in {"runs": 1, "validation": 2}.items():
            if getattr(self, name) < least:
                raise RpctlError(f"{name} is {getattr(self, name)}; give {least} or more")

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
        known = np.sort(merit[np.isfinite(merit)])
        if not len(known):
            return float(np.inf)
        return self.figure(known) + self.failure_weight * (1.0 - float(np.mean(success)))

    def figure(self, known: Array) -> float:
        """Return the statistic of merits (K,), all finite."""
        if self.statistic == "mean":
            return float(np.mean(known))
        if self.statistic == "worst":
            return float(np.max(known))
        return float(np.quantile(known, self.level, method="inverted_cdf"))


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
    def points(self) -> Array:
        """Points of the design (N, n), each entry in [0, 1]."""
        return self.design.points(len(self.scatter.names))

    @cached_property
    def values(self) -> Array:
        """Settings of all runs (N, n)."""
        return settings_at(self.scatter, self.points)

    def config_of(self, run: int) -> Config:
        """Return the configuration of a run, which ``rpctl track --config`` replays."""
        return self.experiment.config_of(self.values[run], run)

    def succeeded(self, runs: RunTable) -> NDArray[np.bool_]:
        """Return which runs (K,) succeeded."""
        return succeeded(runs.merits, runs.outcomes, self.success)


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
    the chunks that are done; to resume goes on with them.

    Args:
        robot: The robot, as it was loaded.
        study: The study.
        out: The folder to write to.
        executor: What runs the chunks; None: this process.
        progress: Called with the runs done and their number.
        resume: Whether to go on with what the folder holds.

    Raises:
        RpctlError: The study does not fit the robot, or the folder holds something else.
    """
    merits_for(robot, (study.settings.merit, *study.success))
    extra("pyarrow.parquet")  # a library that is missing is told before anything is written
    worker, notify = executor or Executor(), progress or (lambda done, total: None)
    total, path = len(study.points), out / RUNS_FILE
    journal = Journal(out / JOURNAL_FILE, _identity(robot, study), "a study")
    tables = [table_of(each) for each in journal.begin(resume)]
    if path.exists():
        finished, details = read_runs(path)
        journal.require_same(details["identity"], resume)
        tables.append(finished)
    if study.text:
        write_atomically(out / STUDY_FILE, study.text.encode(), follow_links=False)
    done = np.unique(np.concatenate([np.zeros(0, np.int64), *(each.index for each in tables)]))
    missing = np.setdiff1d(np.arange(total), done)
    count = total - len(missing)
    notify(count, total)
    runner = Runner(robot, study.experiment)
    for _, table in worker.map_chunks(runner, [*_chunks(study, missing, worker.workers)]):
        journal.add(record_of(table))
        tables.append(table)
        count += len(table)
        notify(count, total)
    runs = join_tables(tables, total)
    units = {name: merit.unit for name, merit in MERITS.items()}
    details = {"identity": journal.identity, **_details(robot, study)}
    write_runs(path, runs, study.succeeded(runs), details, units)
    journal.rewrite([])
    _write_worst(study, out, runs)
    return path


def _identity(robot: Robot, study: Study) -> dict[str, object]:
    """Return what the runs of a study follow from."""
    design: dict[str, object] = {"kind": study.design.kind, "seed": study.design.seed}
    if study.design.kind != "monte-carlo":  # of which more runs extend a study
        design["count"] = study.design.count
    return {
        "robot": robot_identity(robot),
        "design": design,
        "experiment": experiment_identity(study.experiment, study.scatter),
        "versions": code_identity(study.design),
    }


def _details(robot: Robot, study: Study) -> dict[str, object]:
    """Return what else the file of the runs tells of itself."""
    return {
        "source": robot.source,
        "count": study.design.count,
        "merit": study.settings.merit,
        "worst": study.settings.worst,
        "success": dict(study.success),
        "study": study.text,
        "command": study.command or f"rpctl track {quote(robot.source)}",
    }


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


def _chunks(study: Study, missing: NDArray[np.int64], workers: int) -> Iterator[RunChunk]:
    """Yield the runs that lack in chunks of runs that follow each other."""
    size = study.settings.chunk or chunk_size(len(missing), workers)
    for stretch in np.split(missing, np.flatnonzero(np.diff(missing) != 1) + 1):
        for first in range(0, len(stretch), size):
            rows = stretch[first : first + size]
            yield RunChunk(rows, rows, study.values[rows])


def chunk_size(rows: int, workers: int) -> int:
    """Return how many of some rows are done at a time."""
    share = max(1, min(LARGEST_CHUNK, rows // (CHUNKS_EACH * workers)))
    return share if share < LANES else share - share % LANES


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
