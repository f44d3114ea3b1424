"""Runs of a compiled loop, one a lane: what each begins with, and its samples chunk by chunk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.approach import RETRY_S, ApproachStage, WayToReference
from rpctl.control.fragment import settings_of
from rpctl.control.law import Rest, as_law
from rpctl.control.safeguards import EFFORT_RATE
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.kernels.program import Buffer, Rows, RowStream
from rpctl.reference.motion import Reference, tabulate
from rpctl.simulation.compiled.loop import CompiledLoop
from rpctl.simulation.config import Config, delay_periods
from rpctl.simulation.plants.sensors import Sensors, random_stream

CHUNK = 1024  # samples that are computed at a time


@dataclass(frozen=True, eq=False)
class LaneInputs:
    """K runs of one robot, a row each; all start at rest.

    Attributes:
        q: Configurations at the start (K, nq).
        rest: Efforts that hold the robot there (K, n_act), N·m or N, less the bias.
        bias: Efforts that push besides the controller's (K, n_act), N·m or N.
        p: Parameters of the simulated robot (K, n_p).
        settings: Of the laws (K, n_s).
        most: Efforts at which the true actuators saturate (K, n_act), N·m or N.
        back: By how many control periods efforts are late (K,).
        deviations: Of the noise (K, n_noise), see :class:`rpctl.simulation.plants.sensors.Sensors`.
        offsets: Constant errors of what is measured (K, n_noise).
        seeds: Of the plants (K,), from which the noise follows.
    """

    q: Array
    rest: Array
    bias: Array
    p: Array
    settings: Array
    most: Array
    back: NDArray[np.int64]
    deviations: Array
    offsets: Array
    seeds: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.q)

    def rows(self, chosen: slice | NDArray[np.intp]) -> LaneInputs:
        """Return some of the runs."""
        arrays = {name: value[chosen] for name, value in vars(self).items() if name != "seeds"}
        numbers = np.arange(len(self))[chosen].tolist()
        return LaneInputs(**arrays, seeds=tuple(self.seeds[k] for k in numbers))


def same_inputs(
    compiled: CompiledLoop, known: ReducedDynamics, config: Config, rest: Rest
) -> LaneInputs:
    """Return a run of a configuration in every lane of a loop, from where its robot rests."""
    plant, period, lanes = config.plant, config.run.control_period, compiled.sample.lanes
    sensors = Sensors(known.robot)
    kinematic: Any = as_law(config.kinematic)
    dynamic: Any = as_law(config.dynamic)
    columns: dict[str, Any] = {
        "q": rest.q,
        "rest": rest.tau,
        "bias": plant.bias(compiled.robot),
        "p": compiled.p,
        "settings": settings_of(kinematic, dynamic, known, period),
        "most": plant.saturation(compiled.robot),
        "back": delay_periods(plant.delay, period),
        "deviations": sensors.row(plant.noise),
        "offsets": sensors.row(plant.sensor_bias),
    }
    rows = {name: np.stack([np.asarray(value)] * lanes) for name, value in columns.items()}
    return LaneInputs(**rows, seeds=(plant.seed,) * lanes)


class Lanes:
    """A run in each lane of a compiled loop.

    Args:
        compiled: The loop.
        known: The robot's dynamics as its controllers know them.
        config: What all runs have in common.
        reference: What they track.
        inputs: What each begins with.

    Attributes:
        stages: Which found the lanes' ways up to the reference; None where a base needs none.
        workspace: The loop's buffers.
    """

    def __init__(
        self,
        compiled: CompiledLoop,
        known: ReducedDynamics,
        config: Config,
        reference: Reference,
        inputs: LaneInputs,
    ) -> None:
        self._compiled, self._robot, law = compiled, known.robot, as_law(config.kinematic)
        sensors = Sensors(known.robot)
        self._noise = _LaneNoise(inputs, sensors)
        approach: Any = getattr(law, "approach", None)
        self.stages: list[ApproachStage | None] = [
            None if approach is None else approach.stage(known) for _ in inputs.seeds
        ]
        self._ways: dict[int, WayToReference] = {}
        for lane, stage in enumerate(self.stages):
            if stage is not None:
                still, noise = np.zeros(known.robot.dof), self._noise.peek()[:, lane]
                way = stage(known, reference, 0.0, *sensors.measured(inputs.q[lane], still, noise))
                if isinstance(way, WayToReference):
                    self._ways[lane] = way
        self.workspace = self._started(inputs, config)
        ring = np.empty((int(inputs.back.max()) + 1, inputs.rest.shape[1], len(inputs)))
        ring[:] = inputs.rest.T
        self._ring = Rows(ring, ring=True)

    def _started(self, inputs: LaneInputs, config: Config) -> Mapping[Buffer, Array]:
        """Return the workspace before the first sample: the robot at rest, as the laws know it."""
        loop, law = self._compiled.program, self._compiled.program.law
        period, rate = config.run.control_period, config.guards.effort_rate
        leap = (rate or EFFORT_RATE) * period * self._robot.effort_limits
        common = {loop.plant.q: inputs.q.T, loop.plant.p: inputs.p.T}
        common[law.settings] = inputs.settings.T
        begins = self._compiled.start.workspace()
        fill(begins, {**common, law.q: inputs.q.T, law.tau: inputs.rest.T})
        self._compiled.start.run(0, 1, begins, {})
        workspace = self._compiled.sample.workspace()
        values = {
            **{buffer: begins[buffer] for buffer in loop.memory},
            **common,
            law.elapsed: period,
            loop.bias: inputs.bias.T,
            loop.most: inputs.most.T,
            loop.sent: inputs.rest.T if rate else np.nan,
            loop.leap: leap[:, None],
            loop.back: inputs.back,
            loop.search_from: [_search_from(stage, period) for stage in self.stages],
        }
        fill(workspace, values)
        return workspace

    def advance(
        self, first: int, times: Array, rows: Array, more: Mapping[RowStream, Rows]
    ) -> None:
        """Compute some samples.

        Args:
            first: Number of the first.
            times: Of them (K,), s.
            rows: Of the reference's table (K, width).
            more: Rows of the other streams.
        """
        loop = self._compiled.program
        streams = {loop.reference: Rows(rows), loop.ring: self._ring, **more}
        if loop.followed in loop.sample.streams:
            streams[loop.followed] = Rows(self._followed(times, rows))
        if loop.noise in loop.sample.streams:
            streams[loop.noise] = Rows(self._noise.rows(len(times)))
        self._compiled.sample.run(first, len(times), self.workspace, streams)

    def _followed(self, times: Array, rows: Array) -> Array:
        """Return what the laws are given (K, width, lanes): the reference, or ways up to it."""
        followed = np.repeat(rows[:, :, None], len(self.stages), axis=2)
        for lane, way in self._ways.items():
            before = times < way.plan.joins_at
            followed[before, :, lane] = tabulate(self._robot, way, times[before]).rows
        return followed


class _LaneNoise:
    """The noise of what is measured, lane by lane."""

    def __init__(self, inputs: LaneInputs, sensors: Sensors) -> None:
        self._streams = [random_stream(seed) for seed in inputs.seeds]
        self._deviations, self._offsets = inputs.deviations, inputs.offsets
        self._drawn = np.empty((0, sensors.width, len(inputs)))

    def peek(self) -> Array:
        """Return the row (width, lanes) of the next sample, which stays the next."""
        if not len(self._drawn):
            self._drawn = self._draw(1)
        return self._drawn[0]

    def rows(self, count: int) -> Array:
        """Return the next rows (count, width, lanes)."""
        drawn = np.concatenate([self._drawn, self._draw(count - len(self._drawn))])
        self._drawn = drawn[count:]
        return drawn

    def _draw(self, count: int) -> Array:
        lanes = zip(self._streams, self._deviations, self._offsets, strict=True)
        rows = [
            stream.standard_normal((count, len(deviations))) * deviations + offsets
            for stream, deviations, offsets in lanes
        ]
        return np.stack(rows, axis=2)


def fill(workspace: Mapping[Buffer, Array], values: Mapping[Buffer, Any]) -> None:
    """Set those buffers that there are."""
    for buffer, numbers in values.items():
        if buffer in workspace:
            workspace[buffer][:] = numbers


def _search_from(stage: ApproachStage | None, period: float) -> float:
    """Return the number of the sample from which on a way up may be looked for."""
    if stage is None or stage.searched_at < 0.0:
        return 0.0
    return float(math.ceil(RETRY_S / period - 1e-9))
