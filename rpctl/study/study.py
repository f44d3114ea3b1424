"""A study: runs of one robot that differ in some settings, kept on disk as they end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.writing import write_atomically
from rpctl.robot.identity import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.simulation.outcome import TRACKED
from rpctl.study.design import Design
from rpctl.study.executor import Executor, SerialExecutor
from rpctl.study.experiment import Experiment
from rpctl.study.identity import code_identity, experiment_identity
from rpctl.study.merits import MERITS, merits_for
from rpctl.study.optimisation import Optimisation
from rpctl.study.run_chunk import RunChunk, run_chunk, task_of
from rpctl.study.scatter import Scatter, settings_at
from rpctl.study.statistics import worst_rows
from rpctl.study.store import RunTable, Store, chunks_of, read_runs

STUDY_FILE, OPTIMUM_FILE = "study.toml", "optimum.json"
LARGEST_CHUNK = 256  # runs
CHUNKS_EACH = 8  # for each worker, where the study is large enough
LANES = 8  # chunks are whole numbers of them: the most that any processor runs side by side
MERIT = "rms_base_error"  # that runs are compared by, unless the study names another

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Study:
    """What is run, and how it is judged.

    Attributes:
        experiment: What all runs have in common; its names are those of the scatter.
        scatter: What differs.
        design: At which points.
        merit: That runs are compared by; larger is worse.
        worst: How many of the worst runs are written as configurations.
        success: The largest merit that a run that succeeds may have, by name; none: it tracked
            within the experiment's tolerance and broke no limit.
        chunk: Runs that are done at a time; None: as many as suits the workers.
        optimisation: Settings to be found; None: none.
        text: The study's file.
        command: What tracks the robot on the command line; empty: ``rpctl track`` with its source.
    """

    experiment: Experiment
    scatter: Scatter = field(default_factory=Scatter)
    design: Design = field(default_factory=Design)
    merit: str = MERIT
    worst: int = 3
    success: Mapping[str, float] = field(default_factory=dict)
    chunk: int | None = None
    optimisation: Optimisation | None = None
    text: str = ""
    command: str = ""

    @cached_property
    def points(self) -> Array:
        """Points of the design (N, n), each entry in [0, 1]."""
        return self.design.points(len(self.scatter.names))

    @cached_property
    def values(self) -> Array:
        """Settings of all runs (N, n)."""
        return settings_at(self.scatter, self.points)

    def config_of(self, run: int) -> Config:
        """Return the configuration of a run, which ``rpctl track --config`` replays.

        Args:
            run: Its number.
        """
        return self.experiment.config_of(self.values[run], run)


def run_study(
    robot: Robot,
    study: Study,
    out: Path,
    executor: Executor | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> Path:
    """Run a study, and write its runs to ``runs.parquet``.

    Its rows do not depend on the executor, nor on chunks and their order. What ends it early leaves
    the chunks that are done; to resume goes on with them.

    Args:
        robot: The robot, as it was loaded.
        study: The study.
        out: The folder to write to.
        executor: What runs the chunks; None: this process.
        progress: Called with the runs done and their number.
        resume: Whether to go on with what the folder holds.

    Returns:
        The file.

    Raises:
        RpctlError: The study does not fit the robot, or the folder holds something else.
    """
    merits_for(robot, (study.merit, *study.success))
    worker, notify = executor or SerialExecutor(), progress or (lambda done, total: None)
    total = len(study.points)  # a library that is missing is told before anything is written
    store = open_store(robot, study, out, resume)
    done = store.done()
    count = int((done < total).sum())
    notify(count, total)
    missing = np.setdiff1d(np.arange(total), done)
    chunks = _chunks(study, missing, worker.workers)
    task = task_of(robot, study.experiment)
    for _, rows in worker.map_chunks(partial(run_chunk, task), chunks):
        store.write(rows)
        count += len(rows)
        notify(count, total)
    path = store.merge(total, partial(succeeded, success=study.success))
    write_worst(study, out, read_runs(path)[0])
    return path


def write_worst(study: Study, out: Path, runs: RunTable) -> None:
    """Write the configurations of the worst runs, in the place of any before.

    Args:
        study: The study.
        out: Its folder.
        runs: All of its runs.
    """
    for left in out.glob(worst_file("*")):
        left.unlink(missing_ok=True)
    rows = worst_rows(runs.merits[study.merit], study.worst)
    for k, row in enumerate(rows.tolist(), start=1):
        with suppress(RpctlError):  # a run that was refused for its settings has no configuration
            write_config(study.config_of(int(runs.index[row])), out / worst_file(k))


def worst_file(k: object) -> str:
    """Return the name of the configuration of the k-th worst run."""
    return f"worst-{k}.toml"


def open_store(robot: Robot, study: Study, out: Path, resume: bool) -> Store:
    """Return the folder of a study's runs, made or found fit to go on with.

    Args:
        robot: The robot.
        study: The study.
        out: The folder.
        resume: Whether to go on with what it holds.

    Raises:
        RpctlError: It holds a study and is not to be resumed, or another study's runs.
    """
    design = {"kind": study.design.kind, "seed": study.design.seed}
    if study.design.kind != "monte-carlo":  # of which more runs extend a study
        design["count"] = study.design.count
    identity = {
        "robot": robot_identity(robot),
        "design": design,
        "experiment": experiment_identity(study.experiment, study.scatter),
        "versions": code_identity(study.design),
    }
    details = {
        "source": robot.source,
        "count": study.design.count,
        "merit": study.merit,
        "worst": study.worst,
        "success": dict(study.success),
        "study": study.text,
        "command": study.command or f"rpctl track {quote(robot.source)}",
    }
    units = {name: merit.unit for name, merit in MERITS.items()}
    store = Store(out, identity, details, units)
    store.prepare(resume)
    if study.text:
        write_atomically(out / STUDY_FILE, study.text.encode(), follow_links=False)
    return store


def _chunks(study: Study, missing: NDArray[np.int64], workers: int) -> Iterator[RunChunk]:
    size = study.chunk or chunk_size(len(missing), workers)
    for rows in chunks_of(missing, size):
        yield RunChunk(rows, rows, study.values[rows])


def chunk_size(rows: int, workers: int) -> int:
    """Return how many runs are done at a time.

    Args:
        rows: How many there are.
        workers: How many chunks run at a time.
    """
    even = max(1, min(LARGEST_CHUNK, rows // (CHUNKS_EACH * workers)))
    return even if even < LANES else even - even % LANES


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
        return np.array([each == TRACKED for each in outcomes])
    kept = [merits[name] <= largest for name, largest in success.items()]
    return np.asarray(np.all(kept, axis=0))
