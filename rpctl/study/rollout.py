"""Rollouts: many closed loops of one robot, each with settings of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.defaults import default_laws
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.errors import DivergedError, RpctlError, UnknownNameError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.backend import pays, refusal
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import default_duration, simulate
from rpctl.simulation.merits import measures
from rpctl.simulation.outcome import DIVERGING, TRACKED
from rpctl.simulation.periods import whole_periods
from rpctl.simulation.run import Run
from rpctl.study.experiment import Experiment, RolloutTable
from rpctl.study.merits import REFUSED, RunVerdict, merits_for, of_failed, run_merits
from rpctl.study.scatter import Scatter, scatter_of

if TYPE_CHECKING:
    from rpctl.study.lane_rows import LaneRows

SERIES = ("base_error", "lateral_error", "end_effector_error")  # over time, m
STREAM = (0, 1)  # spawn key of the parameters' draws: the runs' own random numbers have keys (i,)
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
    series = SERIES if robot.end_effector is not None else SERIES[:2]
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
    if "plant.dropped" in experiment.names:
        return "samples are dropped"
    reason = refusal(robot, experiment.config)
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
    failed = {**of_failed(found.merits), "success": 0.0}
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
        for name, error in zip(table.series, (kept.base, kept.lateral, kept.tip), strict=False):
            shown = error[found.kept]
            table.series[name][row, : len(shown)] = shown

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
    table.merits["success"][row] = verdict.outcome == TRACKED
    return verdict


def draw(scatter: Scatter, count: int, seed: int) -> Array:
    """Return the settings (count, n) of runs; a row depends on the seed and its number only.

    Args:
        scatter: Their distributions.
        count: Number of runs.
        seed: Of the draws.
    """
    stream = np.random.SeedSequence(seed, spawn_key=STREAM)
    points = np.random.Generator(np.random.PCG64(stream)).random((count, len(scatter.names)))
    return scatter.values(points)


@dataclass(frozen=True, eq=False, repr=False)
class Rollouts:
    """The runs of a rollout.

    Attributes:
        experiment: What they have in common.
        names: Paths of the settings that differ.
        parameters: Their values (count, n).
        results: Merits, series and outcomes, a row each.
    """

    experiment: Experiment
    names: tuple[str, ...]
    parameters: Array
    results: RolloutTable = field(repr=False)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.parameters)

    def __repr__(self) -> str:
        share = float(self.success.mean())
        return f"Rollouts({len(self)} runs, {share:.1%} succeeded, {len(self.names)} settings)"

    @property
    def merits(self) -> Mapping[str, Array]:
        """The merits by name (count,); inf of runs that came to no end."""
        return self.results.merits

    @property
    def t(self) -> Array:
        """Times of the series (T,), s."""
        return self.results.t

    @property
    def base_error(self) -> Array:
        """Distance of P from its reference (count, T), m; NaN after a run has ended."""
        return self.results.series["base_error"]

    @property
    def lateral_error(self) -> Array:
        """Size of its lateral part (count, T), m."""
        return self.results.series["lateral_error"]

    @property
    def end_effector_error(self) -> Array:
        """Distance of the end effector from its reference (count, T), m.

        Raises:
            RpctlError: The robot has none.
        """
        if "end_effector_error" not in self.results.series:
            raise RpctlError("the robot has no arm, so no end effector")
        return self.results.series["end_effector_error"]

    @property
    def outcomes(self) -> tuple[str, ...]:
        """What became of each run, in a word of :data:`rpctl.study.merits.RUN_OUTCOMES`."""
        return self.results.outcomes

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs (count,) tracked within the tolerance and all limits."""
        return np.asarray(self.merits["success"] > 0.0)

    def quantile(self, merit: str, p: float) -> float:
        """Return the merit that a share p (0 to 1) of the runs do not exceed; runs that failed do.

        Args:
            merit: Its name.
            p: The share.

        Raises:
            UnknownNameError: There is no such merit.
        """
        if not 0.0 <= p <= 1.0:
            raise RpctlError(f"p is {p:g}; give a share from 0 to 1")
        return float(np.quantile(self._merit(merit), p, method="inverted_cdf"))

    def worst(self, merit: str, n: int = 1) -> NDArray[np.int64]:
        """Return the numbers (n,) of the runs with the largest merit, the worst first.

        Args:
            merit: Its name.
            n: How many.

        Raises:
            UnknownNameError: There is no such merit.
        """
        return np.argsort(-self._merit(merit), kind="stable")[:n]

    def config(self, i: int) -> Config:
        """Return the configuration of run i, which ``rpctl track --config`` replays.

        Args:
            i: Its number.
        """
        return self.experiment.config_of(self.parameters[i], int(self.results.indices[i]))

    def table(self) -> dict[str, Array]:
        """Return settings, merits and outcomes as columns (count,), by name."""
        columns: dict[str, Array] = {"run": np.asarray(self.results.indices)}
        columns |= dict(zip(self.names, self.parameters.T, strict=True))
        return {**columns, **self.merits, "outcome": np.array(self.outcomes)}

    def _merit(self, name: str) -> Array:
        if name not in self.merits:
            raise UnknownNameError("merit", name, self.merits)
        return self.merits[name]


def rollout(
    robot: Robot,
    reference: str | Reference = RunSettings.reference,
    scatter: Scatter | Mapping[str, Any] | None = None,
    count: int = 1000,
    duration: float | None = 10.0,
    seed: int = 0,
    *,
    kinematic: KinematicLaw | None = None,
    dynamic: DynamicLaw | None = None,
    control_period: float = RunSettings.control_period,
    plant_step: float = RunSettings.plant_step,
    merits: Sequence[str] | None = None,
    samples: int = 200,
    backend: str = "auto",
    progress: Callable[[int, int], object] | None = None,
) -> Rollouts:
    """Simulate a robot many times, each time with settings of its own, drawn at random.

    Run i depends on the seed and on i only: a larger count adds runs.

    Args:
        robot: The robot, as its controller knows it.
        reference: A reference, the name of one, or a file, as of :func:`rpctl.track`.
        scatter: Distributions by path of the setting, see :mod:`rpctl.study.scatter`:
            ``{"plant.masses.arm_*": Uniform(0.9, 1.1), "run.initial_error.y": Normal(0.0, 0.1)}``.
        count: Number of runs.
        duration: Of each, s; None: as long as the reference moves.
        seed: Of all that is random.
        kinematic: The kinematic law; None takes the default.
        dynamic: The dynamic law; None takes the default.
        control_period: s.
        plant_step: s.
        merits: Names of the merits that are wanted, see :mod:`rpctl.study.merits`; None: all.
        samples: How many samples over time are kept of a run, at most.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``: the first that can do it.
        progress: Called with the runs done and their number.

    Raises:
        UnknownNameError: There is no such setting or merit.
        RpctlError: A setting is out of range, or the reference does not fit the robot.
    """
    if count < 1:
        raise RpctlError(f"count is {count}; give a whole number, 1 or more")
    usual = default_laws(robot)
    named = isinstance(reference, str)
    run = RunSettings(
        reference=str(reference) if named else type(reference).__name__,
        duration=duration,
        control_period=control_period,
        plant_step=plant_step,
    )
    config = Config(kinematic=kinematic or usual[0], dynamic=dynamic or usual[1], run=run)
    settings = scatter_of(scatter, config)
    experiment = Experiment(
        config,
        settings.names,
        seed,
        None if merits is None else tuple(merits),
        samples,
        backend=backend,
        reference=None if isinstance(reference, str) else reference,
    )
    values = draw(settings, count, seed)
    results = run_rows(robot, experiment, values, np.arange(count), progress)
    return Rollouts(experiment, settings.names, values, results)
