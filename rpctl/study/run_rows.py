"""Some runs of an experiment, done by machine code or by Python; a row of a table each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.backend import pays, plant_refusal, refusal
from rpctl.simulation.loop import default_duration, simulate
from rpctl.simulation.merits import measures
from rpctl.simulation.outcome import DIVERGING, TRACKED
from rpctl.simulation.periods import whole_periods
from rpctl.simulation.run import Run
from rpctl.study.experiment import SERIES, Experiment, RolloutTable
from rpctl.study.merits import REFUSED, SUCCESS, RunVerdict, merits_for, of_failed, run_merits

if TYPE_CHECKING:
    from rpctl.study.lane_rows import LaneRows

RUNS = 10  # that a loop is built for, at least: whether it pays depends on no one's chunks
CHUNK = 256  # runs that are done at a time, and after which progress is told


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What is the same for all runs: found once."""

    robot: Robot
    reference: Reference
    merits: tuple[str, ...]
    series: tuple[str, ...]
    count: int  # samples of a run
    stride: int  # of those that are kept over time
    lanes: LaneRows | None  # machine code; None: Python does the runs

    @property
    def kept(self) -> slice:
        """Which samples are kept over time."""
        return slice(None, None, self.stride)


class _Key:
    """A robot and an experiment as the key of a cache: they are the same if they are one object."""

    def __init__(self, robot: Robot, experiment: Experiment) -> None:
        self.robot, self.experiment = robot, experiment

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, _Key)
            and self.robot is other.robot
            and self.experiment is other.experiment
        )

    def __hash__(self) -> int:
        return hash((id(self.robot), id(self.experiment)))


@lru_cache(maxsize=2)
def _prepared(key: _Key) -> _Prepared:
    robot, experiment = key.robot, key.experiment
    config = experiment.config
    reference = experiment.reference or config.run.load_reference(config.limits.apply(robot))
    duration = config.run.duration or default_duration(reference)
    count = whole_periods(duration, config.run.control_period) + 1
    placed = robot.end_effector is not None
    series = tuple(name for name, measure in SERIES.items() if placed or measure != "tip")
    names = merits_for(robot, experiment.merits)
    stride = -(-count // experiment.samples)
    lanes = _lanes(config.limits.apply(robot), experiment, reference, count, stride)
    return _Prepared(robot, reference, names, series, count, stride, lanes)


def why_not(robot: Robot, experiment: Experiment, count: int) -> str | None:
    """Return why an experiment's runs are not done by machine code, a clause; None if they are.

    Args:
        robot: The robot.
        experiment: What the runs have in common.
        count: Samples of a run.
    """
    if experiment.backend == "pinocchio":
        return "Pinocchio is asked for"
    reason = refusal(robot, experiment.config)
    reason = reason or plant_refusal(experiment.config.plant, experiment.names)
    if reason is None and experiment.backend == "auto" and not pays(robot, RUNS * count):
        return "runs are too short for that"
    return reason


def _lanes(
    robot: Robot, experiment: Experiment, reference: Reference, count: int, stride: int
) -> LaneRows | None:
    """Return what runs an experiment as machine code; None where Python does.

    Raises:
        RpctlError: Machine code is asked for and cannot do it.
    """
    reason = why_not(robot, experiment, count)
    if reason is None:
        from rpctl.simulation.compiled.check import DiffersError
        from rpctl.study.lane_rows import LaneRows

        try:
            return LaneRows(robot, experiment, reference, count, stride)
        except DiffersError as error:
            reason = str(error)
    if experiment.backend == "compiled":
        raise RpctlError(f'these runs cannot be compiled: {reason}; take backend "auto"')
    return None


def run_rows(
    robot: Robot,
    experiment: Experiment,
    values: Array,
    indices: NDArray[np.int64] | Sequence[int],
    progress: Callable[[int, int], object] | None = None,
) -> RolloutTable:
    """Simulate some runs of an experiment; each is the same whichever others run beside it.

    A run that diverges, or that is refused for its settings, is a row with that outcome.

    Args:
        robot: The robot, as its controller knows it.
        experiment: What all runs have in common. The same object for each call: what is found once
            is kept with it.
        values: Settings of each run (K, n), in the order of ``experiment.names``.
        indices: Numbers of the runs (K,), from which their random numbers follow.
        progress: Called with the runs done and their number.

    Raises:
        RpctlError: The experiment fits no run: its reference or a merit is not the robot's.
    """
    numbers = np.asarray(indices, dtype=np.int64)
    found = _prepared(_Key(robot, experiment))
    table = _empty_table(found, experiment, numbers)
    verdicts: dict[int, RunVerdict] = {}
    lanes = found.lanes
    for first in range(0, len(numbers), CHUNK):
        rows = slice(first, min(first + CHUNK, len(numbers)))

        def told(done: int, _: int, first: int = first) -> None:
            if progress is not None:
                progress(first + done, len(numbers))

        if lanes is not None:
            verdicts |= lanes.fill(table, rows, values[rows], told)
        for row in range(rows.start, rows.stop):
            if row not in verdicts:
                verdicts[row] = _run_row(found, experiment, table, row, values[row])
            if lanes is None:
                told(row + 1 - first, 0)
        told(rows.stop - first, 0)
    ordered = [verdicts[row] for row in range(len(numbers))]
    return replace(
        table,
        outcomes=tuple(verdict.outcome for verdict in ordered),
        reasons=tuple(verdict.reason for verdict in ordered),
    )


def _empty_table(
    found: _Prepared, experiment: Experiment, numbers: NDArray[np.int64]
) -> RolloutTable:
    """Return the table of runs that came to no end."""
    t: Array = (
        np.arange(found.count, dtype=float)[found.kept] * experiment.config.run.control_period
    )
    failed = {**of_failed(found.merits), SUCCESS: 0.0}
    return RolloutTable(
        indices=numbers,
        merits={name: np.full(len(numbers), value) for name, value in failed.items()},
        t=t,
        series={name: np.full((len(numbers), len(t)), np.nan) for name in found.series},
        outcomes=(),
        reasons=(),
    )


def _run_row(
    found: _Prepared,
    experiment: Experiment,
    table: RolloutTable,
    row: int,
    settings: Array,
) -> RunVerdict:
    """Simulate a run, fill its row, and return what became of it."""

    def keep(run: Run) -> None:
        kept = measures(run)
        for name, series in table.series.items():
            shown = getattr(kept, SERIES[name])[found.kept]
            series[row, : len(shown)] = shown

    try:
        config = experiment.config_of(settings, int(table.indices[row]))
        run = simulate(
            found.robot,
            config,
            found.reference,
            ended=keep,
            collisions=False,
            backend="pinocchio",
        )
    except DivergedError as error:
        return RunVerdict(DIVERGING, str(error))
    except RpctlError as error:
        return RunVerdict(REFUSED, str(error))
    keep(run)
    merits, verdict = run_merits(run, experiment.tolerance)
    for name in found.merits:
        table.merits[name][row] = merits[name]
    table.merits[SUCCESS][row] = verdict.outcome == TRACKED
    return verdict
