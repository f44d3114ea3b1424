"""One closed loop as machine code, with its log: what `close_loop` does, chunk by chunk."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError
from rpctl.kernels.program import Rows, RowStream
from rpctl.reference.motion import Reference
from rpctl.reference.table import ReferenceTable, tabulate
from rpctl.simulation.compiled.build import compiled_loop
from rpctl.simulation.compiled.lanes import CHUNK, Lanes, same_inputs
from rpctl.simulation.compiled.laws.fragment import LimitNames
from rpctl.simulation.compiled.loop import FAR, LAW_FAILED, CompiledLoop
from rpctl.simulation.config import Config
from rpctl.simulation.loop.closed_loop import (
    DIVERGED_SPEED,
    LoopRecord,
    diverged_at,
    rest_at_start,
)
from rpctl.simulation.loop.recorder import Recorder, Samples

TROUBLES = {
    LAW_FAILED: "a law had no answer at a sample",
    FAR: "the base got far from its reference, and needed a way up to it",
}


class NeedsPython(Exception):
    """A loop came to a sample that only Python's can go on from.

    Args:
        reason: Why, a clause.
        samples: How many samples were recorded before.
    """

    def __init__(self, reason: str, samples: int) -> None:
        super().__init__(reason)
        self.reason, self.samples = reason, samples


def close_compiled_loop(
    dynamics: ReducedDynamics,
    config: Config,
    reference: Reference,
    steps: int,
    recorder: Recorder | None,
    record: LoopRecord,
    progress: Callable[[int, int], object] | None = None,
) -> None:
    """Close the loop for a number of control periods, as :func:`close_loop` does.

    Args:
        dynamics: Of the simulated robot, without what the plant adds.
        config: Laws, circumstances and plant; none that ``refusal`` has something against.
        reference: What is tracked.
        steps: Number of control periods.
        recorder: Gets every sample; None keeps no log.
        record: Filled when the loop ends, early or not.
        progress: Called with the samples done and their total.

    Raises:
        DiffersError: The loop's numbers are not Python's.
        DivergedError: The motion left the finite numbers.
        NeedsPython: A sample came that only Python's loop can go on from.
    """
    robot = dynamics.robot
    simulated = config.plant.simulated_dynamics(dynamics)
    known = config.plant.known_dynamics(dynamics)
    rest = rest_at_start(simulated, config, reference)
    compiled, period = compiled_loop(known, simulated, config), config.run.control_period
    began = time.perf_counter()
    try:
        inputs = same_inputs(compiled, known, config, rest)
        lane = Lanes(compiled, known, config, reference, inputs)
        (stage,) = lane.stages
        if stage is not None:
            record.approaches = stage.approaches
        record.backend = "compiled"
        for first in range(0, steps + 1, CHUNK):
            times = period * np.arange(first, min(first + CHUNK, steps + 1), dtype=float)
            table = tabulate(robot, reference, times)
            log = {
                s: Rows(np.empty((len(times), s.width, 1))) for s in compiled.program.log.values()
            }
            lane.advance(first, times, table.rows(), log)
            _record(compiled, log, table, first, recorder)
            record.wall_time = time.perf_counter() - began
            if progress is not None:
                progress(first + len(times) - 1, steps)
    except NeedsPython:
        record.backend = "pinocchio"
        raise
    finally:
        record.wall_time = time.perf_counter() - began


def _record(
    compiled: CompiledLoop,
    rows: Mapping[RowStream, Rows],
    table: ReferenceTable,
    first: int,
    recorder: Recorder | None,
) -> None:
    """Record the samples of a chunk, up to the first that no loop or only Python's goes on from.

    Args:
        compiled: The loop.
        rows: What was logged.
        table: The reference.
        first: Number of the first sample.
        recorder: Gets them.

    Raises:
        DivergedError: The motion left the finite numbers.
        NeedsPython: There is such a sample.
    """
    streams = compiled.program.log
    log = {name: rows[stream].values[:, :, 0] for name, stream in streams.items()}
    with np.errstate(invalid="ignore"):
        slow = np.abs(log["nu"]).max(axis=1) < DIVERGED_SPEED
    trouble = log["trouble"][:, 0]
    ends = np.flatnonzero(~slow | (trouble != 0.0))
    sound = int(ends[0]) if len(ends) else len(trouble)
    whole = np.isfinite(np.hstack([log["q"][sound:][:1], log["nu"][sound:][:1]])).all()
    diverged = bool(len(ends)) and not slow[sound]
    if recorder is not None:
        kept = sound + (diverged and bool(whole))
        add_samples(recorder, compiled.program.law.limit_names, log, table, kept)
    if diverged:
        raise DivergedError(diverged_at(table.t[sound]))
    if len(ends):
        raise NeedsPython(TROUBLES[float(trouble[sound])], first + sound)


def add_samples(
    recorder: Recorder,
    names: LimitNames,
    log: Mapping[str, Array],
    table: ReferenceTable,
    count: int,
) -> None:
    """Give a recorder the first samples of a log, whose columns are (K, ...), and its reference."""
    if not count:
        return
    rows = slice(count)
    sets, which = _distinct(log["limits"][rows])
    work, lost = log["energy"][rows].T
    samples = Samples(
        t=table.t[rows],
        work=work,
        lost=lost,
        limits=which,
        q=log["q"][rows],
        nu=log["nu"][rows],
        tau=log["tau"][rows],
        nu_d=log["nu_d"][rows],
        nu_cmd=np.empty((count, 0)),
        pose=table.pose[rows],
        twist=table.twist[rows],
        twist_dot=table.twist_dot[rows],
        joints=table.joints[rows],
        joint_rates=table.joint_rates[rows],
        direction=table.direction[rows].reshape(count, -1),
    )
    recorder.add_batch(samples, [names(row) for row in sets])


def _distinct(rows: Array) -> tuple[list[Array], Array]:
    """Return the distinct ones of rows (K, n), K > 0, and the number (K,) of each row's.

    Most rows are the one before.
    """
    changes = (rows[1:] != rows[:-1]).any(axis=1)
    starts = np.concatenate([[0], 1 + np.flatnonzero(changes)])
    known: dict[bytes, int] = {}
    numbers = [known.setdefault(rows[k].tobytes(), len(known)) for k in starts]
    lasting = np.diff(np.append(starts, len(rows)))
    distinct = [np.frombuffer(row, dtype=float) for row in known]
    return distinct, np.repeat(np.array(numbers, dtype=float), lasting)
