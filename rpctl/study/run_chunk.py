"""The unit of work of a study: a chunk of runs, as any process on any machine does it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.facts import RobotFacts, robot_facts
from rpctl.simulation.reload import load_robot
from rpctl.study.experiment import Experiment, RolloutTable
from rpctl.study.identity import model_digest
from rpctl.study.merits import SUCCESS
from rpctl.study.rollout import run_rows
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
    """

    robot: RobotFacts
    model: str
    experiment: Experiment


def task_of(robot: Robot, experiment: Experiment) -> RunTask:
    """Return what a process needs to run an experiment.

    Args:
        robot: The robot, as it was loaded.
        experiment: The experiment.
    """
    return RunTask(robot_facts(robot), model_digest(robot), experiment)


def run_chunk(task: RunTask, chunk: RunChunk) -> RunTable:
    """Run a chunk: a pure function, whose rows depend on the chunk's settings and numbers only.

    Args:
        task: The robot and the experiment.
        chunk: The runs.

    Raises:
        RpctlError: The robot cannot be loaded here, or is another one here.
    """
    found = run_rows(_loaded(_RobotKey(task)), task.experiment, chunk.values, chunk.indices)
    return _table(task.experiment, chunk, found)


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
