"""The unit of work of a study: a chunk of runs, as any process on any machine does it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.opening import read_input
from rpctl.robot.identity import model_digest
from rpctl.robot.model import Robot
from rpctl.simulation.facts import RobotFacts, robot_facts
from rpctl.simulation.reload import load_robot
from rpctl.study.experiment import Experiment, RolloutTable
from rpctl.study.merits import SUCCESS
from rpctl.study.run_rows import run_rows
from rpctl.study.store import RunTable


@dataclass(frozen=True)
class RunChunk:
    """Runs that are done together.

    Attributes:
        rows: Their rows (K,) among all that is asked.
        indices: Numbers (K,) from which their random numbers follow.
        values: Their settings (K, n).
    """

    rows: NDArray[np.int64]
    indices: NDArray[np.int64]
    values: Array

    def __str__(self) -> str:
        """Return ``runs 0 to 9``."""
        first, last = int(self.rows[0]), int(self.rows[-1])
        return f"run {first}" if first == last else f"runs {first} to {last}"


@dataclass(frozen=True)
class RunTask:
    """What a process needs to run chunks; it can be sent to another machine.

    Attributes:
        robot: How to load the robot.
        model: Digest of the model that this has to lead to.
        experiment: What all runs have in common.
        reference: Content of the reference's file, which other machines need not have; None where
            it is none.
    """

    robot: RobotFacts
    model: str
    experiment: Experiment
    reference: bytes | None = None


def task_of(robot: Robot, experiment: Experiment) -> RunTask:
    """Return what a process needs to run an experiment.

    Args:
        robot: The robot, as it was loaded.
        experiment: The experiment.
    """
    content = None if experiment.reference else _content(experiment.config.run.reference)
    return RunTask(robot_facts(robot), model_digest(robot), experiment, content)


def _content(name: str) -> bytes | None:
    """Return what is in a file; None if there is none of that name."""
    try:
        return read_input(name, "MAX_SHOWN_BYTES", "a reference")
    except RpctlError:
        return None


def run_chunk(task: RunTask, chunk: RunChunk) -> RunTable:
    """Run a chunk: a pure function, whose rows depend on the chunk's settings and numbers only.

    Args:
        task: The robot and the experiment.
        chunk: The runs.

    Raises:
        RpctlError: The robot cannot be loaded here, or is another one here.
    """
    robot, experiment = _loaded(_RobotKey(task)), _with_reference(_TaskKey(task))
    return _table(experiment, chunk, run_rows(robot, experiment, chunk.values, chunk.indices))


def _table(experiment: Experiment, chunk: RunChunk, found: RolloutTable) -> RunTable:
    columns = chunk.values.T
    return RunTable(
        index=chunk.rows,
        parameters=dict(zip(experiment.names, columns, strict=True)),
        merits={name: each for name, each in found.merits.items() if name != SUCCESS},
        series={name: each.astype(np.float32) for name, each in found.series.items()},
        t=found.t,
        outcomes=found.outcomes,
        reasons=found.reasons,
    )


class _RobotKey:
    """The robot of a task as the key of a cache."""

    def __init__(self, task: RunTask) -> None:
        self.known, self.model = task.robot, task.model

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _RobotKey):
            return NotImplemented
        return other.model == self.model and other.known == self.known

    def __hash__(self) -> int:
        return hash(self.model)


@lru_cache(maxsize=2)
def _loaded(key: _RobotKey) -> Robot:
    """Return the robot of a task, loaded once in a process."""
    known = key.known
    robot = load_robot(known, [path for path in known.package_dirs if Path(path).is_dir()])
    if model_digest(robot) != key.model:
        raise RpctlError(
            f"{robot.name}: the model loaded from its file is not the one of the study; a robot "
            "that was changed in Python cannot be sent: scatter its plant, or change its file"
        )
    return robot


class _TaskKey:
    """A task as the key of a cache: the same if it is one object."""

    def __init__(self, task: RunTask) -> None:
        self.task = task

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _TaskKey) and other.task is self.task

    def __hash__(self) -> int:
        return id(self.task)


@lru_cache(maxsize=2)
def _with_reference(key: _TaskKey) -> Experiment:
    """Return a task's experiment, with its reference where that is a file that is not here."""
    task, config = key.task, key.task.experiment.config
    name = config.run.reference
    if task.reference is None or _content(name) == task.reference:
        return task.experiment
    with TemporaryDirectory() as folder:
        path = Path(folder, Path(name).name)
        path.write_bytes(task.reference)
        settings = replace(config.run, reference=str(path))
        robot = config.limits.apply(_loaded(_RobotKey(task)))
        return replace(task.experiment, reference=settings.load_reference(robot))
