"""Many runs as machine code: block by block, as many side by side as there are lanes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.cache import cached
from rpctl.kernels.machine_code import native_lanes
from rpctl.kernels.program import Rows
from rpctl.reference.motion import Reference, tabulate
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.build import MOST_KEPT, build_loop, loop_key, require_equal, shape_of
from rpctl.simulation.compiled.lanes import CHUNK, LaneInputs, Lanes, fill
from rpctl.simulation.compiled.loop import CompiledLoop, LoopShape
from rpctl.simulation.compiled.merit_fold import FIRST, MeritFold
from rpctl.simulation.config import Config
from rpctl.simulation.merits.measures import spans_of

_kept: dict[tuple[bytes, str], tuple[CompiledLoop, Any]] = {}  # by key, and numbers of the laws


class LaneResults(NamedTuple):
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
        dynamics: Of the simulated robot, with parameters of what is varied.
        config: What all runs have in common.
        scattered: Paths of the settings that differ from run to run.
        reference: What they track.
        count: Number of samples of a run.

    Attributes:
        holding: Of :func:`holding`, for many runs at a time.

    Raises:
        DiffersError: The loop's numbers are not Python's.
    """

    def __init__(
        self,
        known: Robot,
        dynamics: SymbolicDynamics,
        config: Config,
        scattered: Iterable[str],
        reference: Reference,
        count: int,
    ) -> None:
        self._known, self._config, self._reference = ReducedDynamics(known), config, reference
        self._lanes = native_lanes()
        shape = shape_of(self._known, config, scattered, folded=True)
        self._loop, self.holding = _loop_and_holding(self._known, dynamics, config, shape)
        self._times = config.run.control_period * np.arange(count, dtype=float)
        table = tabulate(known, reference, self._times)
        self._rows, self._tips = table.rows, table.end_effector

    def run(
        self, inputs: LaneInputs, stride: int, progress: Callable[[int, int], object] | None = None
    ) -> LaneResults:
        """Return what became of some runs; none depends on those beside it.

        Args:
            inputs: What they begin with.
            stride: Each so-many-th sample is measured over time.
            progress: Called with the runs done and their number.
        """
        total, blocks, lanes = len(inputs), [], np.arange(self._lanes)
        for first in range(0, total, self._lanes):
            rows = np.minimum(first + lanes, total - 1)  # the last one fills up
            blocks.append(self._block(inputs.rows(rows), stride))
            if progress is not None:
                progress(min(first + self._lanes, total), total)
        columns = zip(*blocks, strict=True)
        return LaneResults(*(np.concatenate(column)[:total] for column in columns))

    def _block(self, inputs: LaneInputs, stride: int) -> LaneResults:
        """Return what became of as many runs as there are lanes."""
        program, count = self._loop.program, len(self._times)
        fold: MeritFold | None = program.fold
        assert fold is not None  # its shape says so
        lanes = Lanes(self._loop, self._known, self._config, self._reference, inputs)
        fill(lanes.workspace, {fold.totals: FIRST[:, None], fold.spans: spans_of(count)[:, None]})
        measures = np.zeros((-(-count // stride), fold.measures.size, self._lanes))
        chunk = -(-CHUNK // stride) * stride
        for first in range(0, count, chunk):
            part = slice(first, first + chunk)
            more = {program.log["measures"]: Rows(measures[first // stride :], stride)}
            if fold.tip is not None:
                more[fold.tip] = Rows(self._tips[part])
            lanes.advance(first, self._times[part], self._rows[part], more)
        at = lanes.workspace
        trouble, trouble_at = at[program.trouble].copy()
        energy = at[program.energy_before].T.copy()
        shown = np.moveaxis(measures, 2, 0)
        return LaneResults(at[fold.totals].T.copy(), energy, shown, trouble, trouble_at)


def _loop_and_holding(
    known: ReducedDynamics, dynamics: SymbolicDynamics, config: Config, shape: LoopShape
) -> tuple[CompiledLoop, Any]:
    """Return a checked loop and what holds its robots; a graph is built if neither ever was."""
    laws: tuple[Any, Any] = config.kinematic, config.dynamic
    robots, lanes = (known.robot, dynamics.robot), native_lanes()
    key = loop_key(robots, dynamics.varied, laws, shape, lanes)
    checked = key, repr(laws)
    if checked not in _kept:
        loop = build_loop(known.robot, dynamics, config, shape, lanes)
        require_equal(loop, known, ReducedDynamics(dynamics.robot), config)
        hold = cached(
            hashlib.sha256(key + b"holding").digest(),
            lambda: holding(dynamics).serialize().encode(),
        )
        while len(_kept) >= MOST_KEPT:
            del _kept[next(iter(_kept))]
        _kept[checked] = loop, casadi.Function.deserialize(hold.decode())
    return _kept[checked]


def holding(dynamics: SymbolicDynamics) -> Any:
    """Return the ``casadi.Function`` of q and p that gives the efforts (n_act, 1) at a stand."""
    q = casadi.SX.sym("q", dynamics.robot.nq)
    force = dynamics.bias(q, casadi.SX(dynamics.robot.dof, 1))
    efforts = casadi.densify(casadi.SX(dynamics.efforts(q, force)))
    return casadi.Function("holding", [q, dynamics.p], [efforts])
