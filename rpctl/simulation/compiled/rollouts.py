"""Many runs as machine code: block by block, as many side by side as there are lanes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach import ApproachStage
from rpctl.control.law import as_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference
from rpctl.reference.table import tabulate
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.build import build_loop, shape_of
from rpctl.simulation.compiled.check import require_equal
from rpctl.simulation.compiled.lane_inputs import LaneInputs
from rpctl.simulation.compiled.loop import LoopShape
from rpctl.simulation.compiled.machine.code import native_lanes
from rpctl.simulation.compiled.machine.program import Buffer, Rows
from rpctl.simulation.compiled.merit_fold import FIRST, MeritFold, spans_of
from rpctl.simulation.compiled.starting import LoopStart, fill, followed_rows, search_from, started
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.symbols.parameters import Varied
from rpctl.simulation.config import Config
from rpctl.simulation.noise import NoiseStream, Sensors

CHUNK = 1024  # samples for which noise is drawn at a time


@dataclass(frozen=True, eq=False)
class LaneResults:
    """What became of K runs.

    Attributes:
        totals: What was folded of the samples (K, n), in the order of ``merits.Totals``.
        energy: Work of the actuators, and what losses took, until the last sample (K, 2), J.
        measures: Of every so-many-th sample (K, T, n), in the order of ``merits.SampleMeasures``.
        trouble: Why a run did not go on (K,), see ``loop.py``; 0 of those that came to their end.
        trouble_at: Number of the sample (K,) at which that was.
    """

    totals: Array
    energy: Array
    measures: Array
    trouble: Array
    trouble_at: Array


class LaneRunner:
    """Runs of one robot along one reference, with settings and parameters of their own.

    Args:
        known: The robot as its controllers know it.
        simulated: The simulated robot, whose parameters may be varied.
        varied: Which.
        config: What all runs have in common.
        reference: What they track.
        count: Number of samples of a run.
        stride: Each so-many-th sample is measured over time.
        noisy: Whether any run's measurements are noisy, or have constant errors.
        delayed: Whether any run's efforts come late.
        saturated: Whether any run's actuators saturate early.

    Attributes:
        dynamics: Of the simulated robot, with parameters of what is varied.

    Raises:
        DiffersError: The loop's numbers are not Python's.
    """

    def __init__(
        self,
        known: Robot,
        simulated: Robot,
        varied: Varied,
        config: Config,
        reference: Reference,
        count: int,
        stride: int,
        noisy: bool,
        delayed: bool,
        saturated: bool = False,
    ) -> None:
        self._known, self._config, self._reference = ReducedDynamics(known), config, reference
        self._count, self._stride = count, stride
        far = shape_of(self._known, config).far
        run = config.run
        steps = run.control_period, run.plant_step
        shape = LoopShape(*steps, delayed, noisy, saturated, far, folded=True)
        laws = config.kinematic, config.dynamic
        self.dynamics = SymbolicDynamics(simulated, varied)
        self._lanes = native_lanes()
        self._loop = build_loop(known, self.dynamics, *laws, shape, self._lanes)
        require_equal(self._loop, self._known, ReducedDynamics(simulated), config)
        times = run.control_period * np.arange(count, dtype=float)
        self._table = tabulate(known, reference, times)
        self._rows, self._tips = self._table.rows(), self._table.end_effector
        self._sensors = Sensors(known)

    def run(
        self, inputs: LaneInputs, progress: Callable[[int, int], object] | None = None
    ) -> LaneResults:
        """Return what became of some runs; none depends on those beside it.

        Args:
            inputs: What they begin with.
            progress: Called with the runs done and their number.
        """
        total, blocks, lanes = len(inputs), [], np.arange(self._lanes)
        for first in range(0, total, self._lanes):
            rows = np.minimum(first + lanes, total - 1)  # the last one fills up
            blocks.append(self._block(inputs.rows(rows)))
            if progress is not None:
                progress(min(first + self._lanes, total), total)
        columns = zip(*blocks, strict=True)
        return LaneResults(*(np.concatenate(column)[:total] for column in columns))

    def _block(self, inputs: LaneInputs) -> tuple[Array, ...]:
        """Return the columns of :class:`LaneResults` of as many runs as there are lanes."""
        program, fold = self._loop.program, self._loop.program.fold
        if fold is None:
            raise ValueError("the loop of rollouts folds its samples")
        noise = _LaneNoise(inputs, self._sensors)
        stages = [self._stage() for _ in range(self._lanes)]
        followed = self._followed(inputs, stages, noise)
        workspace, ring = self._started(inputs, stages, fold)
        measures = np.zeros((-(-self._count // self._stride), fold.measures.size, self._lanes))
        chunk = -(-CHUNK // self._stride) * self._stride
        for first in range(0, self._count, chunk):
            count = min(chunk, self._count - first)
            rows = {
                program.reference: Rows(self._rows[first : first + count]),
                program.followed: Rows(followed[first : first + count]),
                program.ring: ring,
                program.log["measures"]: Rows(measures[first // self._stride :], self._stride),
            }
            if program.noise in program.sample.streams:
                rows[program.noise] = Rows(noise.rows(count))
            if fold.tip is not None:
                rows[fold.tip] = Rows(self._tips[first : first + count])
            given = {stream: rows[stream] for stream in program.sample.streams}
            self._loop.sample.run(first, count, workspace, given)
        trouble = workspace[program.trouble]
        return (
            workspace[fold.totals].T.copy(),
            workspace[program.energy_before].T.copy(),
            np.moveaxis(measures, 2, 0),
            trouble[0].copy(),
            trouble[1].copy(),
        )

    def _stage(self) -> ApproachStage | None:
        law: Any = as_law(self._config.kinematic)
        return None if law.approach is None else law.approach.stage(self._known)

    def _followed(
        self, inputs: LaneInputs, stages: Sequence[ApproachStage | None], noise: _LaneNoise
    ) -> Array:
        """Return what the laws are given (count, width, lanes): the reference, or ways up to it.

        Args:
            inputs: What the lanes begin with.
            stages: Which find the ways.
            noise: Of what is measured.
        """
        if self._loop.program.followed not in self._loop.program.sample.streams:
            return np.empty((self._count, 0, self._lanes))
        found = np.repeat(self._rows[:, :, None], self._lanes, axis=2)
        still = np.zeros(self._known.robot.dof)
        measured = noise.peek()
        for lane, stage in enumerate(stages):
            if stage is None:
                continue
            q, nu = self._sensors.measured(inputs.q[lane], still, measured[:, lane])
            way = stage(self._known, self._reference, 0.0, q, nu)
            if way is not self._reference:
                found[:, :, lane] = followed_rows(self._known.robot, way, self._table)
        return found

    def _started(
        self, inputs: LaneInputs, stages: Sequence[ApproachStage | None], fold: MeritFold
    ) -> tuple[Mapping[Buffer, Array], Rows]:
        """Return the workspace before the first sample, and the ring of efforts on their way.

        Args:
            inputs: What the lanes begin with.
            stages: Which looked for ways up to the reference.
            fold: What folds the samples.
        """
        period = self._config.run.control_period
        begin = LoopStart(
            q=inputs.q.T,
            rest=inputs.rest.T,
            p=inputs.p.T,
            settings=inputs.settings.T,
            bias=inputs.bias.T,
            most=inputs.most.T,
            back=inputs.back[None, :].astype(float),
            search_from=np.array([[search_from(stage, period) for stage in stages]]),
        )
        workspace, ring = started(self._loop, begin, period)
        fill(workspace, {fold.totals: FIRST, fold.spans: spans_of(self._count)})
        return workspace, ring


class _LaneNoise:
    """The noise of what is measured, lane by lane.

    Args:
        inputs: Seeds and deviations of the lanes.
        sensors: What is measured.
    """

    def __init__(self, inputs: LaneInputs, sensors: Sensors) -> None:
        self._streams = [NoiseStream(sensors.width, seed) for seed in inputs.seeds]
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
        return np.stack([stream.rows(count) * d + offset for stream, d, offset in lanes], axis=2)
