"""One closed loop as machine code, with its log: what `close_loop` does, chunk by chunk."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.control.safeguards import Watchdog
from rpctl.errors import DivergedError
from rpctl.kernels.program import Rows, RowStream
from rpctl.reference.motion import ReferenceTable, tabulate
from rpctl.simulation.compiled.build import compiled_loop
from rpctl.simulation.compiled.lanes import CHUNK, Lanes, same_inputs
from rpctl.simulation.compiled.loop import FAR, LAW_FAILED, CompiledLoop
from rpctl.simulation.loop.closed_loop import (
    DIVERGED_SPEED,
    Loop,
    diverged_at,
    rest_at_start,
)
from rpctl.simulation.loop.recorder import Recorder, Samples

TROUBLES = {
    LAW_FAILED: "a law had no answer at a sample",
    FAR: "the base got far from its reference, and needed a way up to it",
}
LOST = "the robot is lost, and its controller brakes it"


class NeedsPython(Exception):
    """A loop came to a sample that only Python's can go on from.

    Args:
        reason: Why, a clause.
        samples: How many samples were recorded before.
    """

    def __init__(self, reason: str, samples: int) -> None:
        super().__init__(reason)
        self.reason, self.samples = reason, samples


def close_compiled_loop(loop: Loop, recorder: Recorder) -> None:
    """Close a loop as :func:`close_loop` does: none that ``refusal`` has something against.

    Raises:
        DiffersError: The loop's numbers are not Python's.
        DivergedError: The motion left the finite numbers.
        NeedsPython: A sample came that only Python's loop can go on from.
    """
    dynamics, config, reference = loop.dynamics, loop.config, loop.reference
    robot = dynamics.robot
    simulated = config.plant.simulated_dynamics(dynamics)
    known = config.plant.known_dynamics(dynamics)
    rest, steps = rest_at_start(simulated, config, reference), loop.steps
    compiled, period = compiled_loop(known, simulated, config), config.run.control_period
    began = time.perf_counter()
    try:
        inputs = same_inputs(compiled, known, config, rest)
        lane = Lanes(compiled, known, config, reference, inputs)
        watchdog = Watchdog(config.guards.lost_after)
        (stage,) = lane.stages
        if stage is not None:
            loop.approaches = stage.approaches
        loop.backend = "compiled"
        for first in range(0, steps + 1, CHUNK):
            times = period * np.arange(first, min(first + CHUNK, steps + 1), dtype=float)
            table = tabulate(robot, reference, times)
            log = {
                s: Rows(np.empty((len(times), s.width, 1))) for s in compiled.program.log.values()
            }
            lane.advance(first, times, table.rows, log)
            _record(compiled, log, table, first, recorder, watchdog)
            loop.wall_time = time.perf_counter() - began
            if loop.progress is not None:
                loop.progress(first + len(times) - 1, steps)
    except NeedsPython:
        loop.backend = "pinocchio"
        raise
    finally:
        loop.wall_time = time.perf_counter() - began


def _record(
    compiled: CompiledLoop,
    logged: Mapping[RowStream, Rows],
    table: ReferenceTable,
    first: int,
    recorder: Recorder,
    watchdog: Watchdog,
) -> None:
    """Record the samples of a chunk, up to the first that no loop or only Python's goes on from.

    Args:
        logged: What was logged.
        table: The reference.
        first: Number of the first sample.
        recorder: Gets them.
        watchdog: Of the robot.

    Raises:
        DivergedError: The motion left the finite numbers.
        NeedsPython: There is such a sample.
    """
    streams = compiled.program.log
    log = {name: logged[stream].values[:, :, 0] for name, stream in streams.items()}
    with np.errstate(invalid="ignore"):
        slow = np.abs(log["nu"]).max(axis=1) < DIVERGED_SPEED
    trouble = log["trouble"][:, 0]
    ends = np.flatnonzero(~slow | (trouble != 0.0))
    sound = int(ends[0]) if len(ends) else len(trouble)
    whole = np.isfinite(np.hstack([log["q"][sound:][:1], log["nu"][sound:][:1]])).all()
    diverged = bool(len(ends)) and not slow[sound]
    labels = compiled.program.law.limit_names.labels
    efforts = [k for k, limit in enumerate(labels) if limit.kind == "effort"]
    at_limit = (log["limits"][:sound, efforts] != 0.0).any(axis=1)
    lost = watchdog.first_lost(table.t[:sound], at_limit, log["e"][:sound])
    if lost is None:
        _add(compiled, log, table, sound + (diverged and bool(whole)), recorder)
    else:
        _add(compiled, log, table, lost, recorder)
        raise NeedsPython(LOST, first + lost)
    if diverged:
        raise DivergedError(diverged_at(table.t[sound]))
    if len(ends):
        raise NeedsPython(TROUBLES[float(trouble[sound])], first + sound)


def _add(
    compiled: CompiledLoop,
    log: Mapping[str, Array],
    table: ReferenceTable,
    count: int,
    recorder: Recorder,
) -> None:
    """Record the first samples of a chunk."""
    if not count:
        return
    sets, which = np.unique(log["limits"][:count], axis=0, return_inverse=True)
    columns = {name: log[name][:count] for name in ("q", "nu", "tau", "nu_d")}
    columns["nu_cmd"] = np.empty((count, 0))
    columns["work"], columns["lost"] = log["energy"][:count].T
    names = compiled.program.law.limit_names
    samples = Samples(table.at(slice(count)), columns, which.ravel().astype(float))
    recorder.add_batch(samples, [names(row) for row in sets])
