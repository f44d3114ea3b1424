"""One closed loop as machine code, with its log: what `close_loop` does, chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach import RETRY_S, ApproachStage
from rpctl.control.law import Command, Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.table import ReferenceTable, tabulate
from rpctl.simulation.compiled.build import CompiledLoop
from rpctl.simulation.compiled.law_fragment import LimitNames
from rpctl.simulation.compiled.loop import FAR, LAW_FAILED
from rpctl.simulation.compiled.program import Buffer, Rows, RowStream
from rpctl.simulation.config import Config
from rpctl.simulation.noise import NoiseStream, Sensors
from rpctl.simulation.periods import delay_periods
from rpctl.simulation.recorder import Recorder

DIVERGED_SPEED = 1e6
CHUNK = 1024  # samples that are computed at a time
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


@dataclass(frozen=True, eq=False)
class LoopStart:
    """Where and with what a loop begins.

    Attributes:
        q: Configuration (nq,).
        rest: Efforts (n_act,) that hold the robot there.
        settings: Values of the laws' settings (n_s,).
        p: Parameters of the simulated robot (n_p,).
        stage: Finds ways up to the reference; None: the base needs none.
    """

    q: Array
    rest: Rest
    settings: Array
    p: Array
    stage: ApproachStage | None


def close_compiled_loop(
    compiled: CompiledLoop,
    dynamics: ReducedDynamics,
    known: ReducedDynamics,
    config: Config,
    reference: Reference,
    begin: LoopStart,
    steps: int,
    recorder: Recorder | None,
    progress: Callable[[int, int], object] | None = None,
) -> None:
    """Close the loop for a number of control periods.

    Args:
        compiled: The loop, of one lane.
        dynamics: Of the simulated robot, without what the plant adds.
        known: As the controller knows it.
        config: Laws, circumstances and plant.
        reference: What is tracked.
        begin: Where it begins.
        steps: Number of control periods.
        recorder: Gets every sample; None keeps no log.
        progress: Called with the samples done and their total.

    Raises:
        DivergedError: The motion left the finite numbers.
        NeedsPython: A sample came that only Python's loop can go on from.
    """
    period = config.run.control_period
    workspace, fixed = prepared(compiled, config, begin, period)
    followed = reference
    if begin.stage is not None:
        still = np.zeros(dynamics.robot.dof)
        followed = begin.stage(known, reference, 0.0, begin.q, still)
    sensors = Sensors(dynamics.robot)
    deviations = sensors.deviations(config.plant.noise)
    stream = NoiseStream(sensors.width, config.plant.seed)
    loop = compiled.program
    for first in range(0, steps + 1, CHUNK):
        count = min(CHUNK, steps + 1 - first)
        times = period * np.arange(first, first + count)
        table = tabulate(dynamics.robot, reference, times)
        read = table if followed is reference else tabulate(dynamics.robot, followed, times)
        rows = {
            loop.reference: Rows(table.rows()),
            loop.followed: Rows(np.ascontiguousarray(read.rows()[:, :, None])),
        }
        if deviations.any():
            rows[loop.noise] = Rows(
                np.ascontiguousarray((stream.rows(count) * deviations)[..., None])
            )
        log = {s: Rows(np.empty((count, s.width, 1))) for s in loop.log.values()}
        given = {**fixed, **rows, **log}
        compiled.sample.run(first, count, workspace, {s: given[s] for s in loop.sample.streams})
        _record(compiled, log, table, first, recorder)
        if progress is not None:
            progress(first + count - 1, steps)


def prepared(
    compiled: CompiledLoop, config: Config, begin: LoopStart, period: float
) -> tuple[Mapping[Buffer, Array], dict[RowStream, Rows]]:
    """Return the workspace before the first sample, and the ring of efforts on their way.

    Args:
        compiled: The loop.
        config: Its plant.
        begin: Where it begins.
        period: Control period, s.
    """
    loop, robot = compiled.program, compiled.robot
    law, late = loop.law, delay_periods(config.plant.delay, period)
    first = compiled.start.workspace()
    for buffer, values in (
        (law.q, begin.q),
        (law.tau, begin.rest.tau),
        (law.settings, begin.settings),
    ):
        if buffer in first:
            first[buffer][:] = values[:, None]
    compiled.start.run(0, 1, first, {})
    workspace = compiled.sample.workspace()
    for buffer in law.memory:
        workspace[buffer][:] = first[buffer]
    values = {
        loop.plant.q: begin.q,
        loop.plant.p: begin.p,
        law.settings: begin.settings,
        law.elapsed: np.array([period]),
        loop.bias: config.plant.bias(robot),
        loop.back: np.array([float(late)]),
        loop.search_from: np.array([_search_from(begin.stage, period)]),
    }
    for buffer, numbers in values.items():
        if buffer in workspace:
            workspace[buffer][:] = numbers[:, None]
    ring = np.broadcast_to(begin.rest.tau[None, :, None], (late + 1, len(robot.actuators), 1))
    return workspace, {loop.ring: Rows(np.ascontiguousarray(ring), ring=True)}


def _search_from(stage: ApproachStage | None, period: float) -> float:
    """Return the number of the sample from which on a way up may be looked for."""
    if stage is None or stage.approaches == 0:
        return 0.0
    return float(np.ceil(RETRY_S / period - 1e-9))


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
        raise DivergedError(
            f"the motion diverged at t = {table.t[sound]:g} s; shorten the control period or "
            "lengthen the horizons"
        )
    if len(ends):
        raise NeedsPython(TROUBLES[float(trouble[sound])], first + sound)


def add_samples(
    recorder: Recorder,
    names: LimitNames,
    log: Mapping[str, Array],
    table: ReferenceTable,
    count: int,
) -> None:
    """Give a recorder samples of a log.

    Args:
        recorder: Gets them.
        names: Makes limits of a row of the log.
        log: Its columns by name, (K, ...).
        table: The reference at its samples.
        count: How many of them.
    """
    sets, which = np.unique(log["limits"][:count], axis=0, return_inverse=True)
    bound = [names(row) for row in sets]
    still, none = np.zeros(0), np.empty(0)
    for k in range(count):
        direction = table.direction[k]
        state = ReferenceState(
            table.pose[k], table.twist[k], table.twist_dot[k], table.joints[k],
            table.joint_rates[k], table.joint_accelerations[k],
            None if np.isnan(direction[0, 0]) else direction,
        )  # fmt: skip
        work, lost = log["energy"][k].tolist()
        recorder.add(
            table.t[k], log["q"][k], log["nu"][k], log["tau"][k], log["e"][k], state,
            Command(log["nu_d"][k], still), work, bound[which[k]], lost, none,
        )  # fmt: skip
