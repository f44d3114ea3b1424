"""One closed loop as machine code, with its log: what `close_loop` does, chunk by chunk."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach import ApproachStage
from rpctl.control.law import Rest, as_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError
from rpctl.reference.motion import Reference
from rpctl.reference.table import ReferenceTable, tabulate
from rpctl.robot.model import Robot
from rpctl.simulation.closed_loop import (
    DIVERGED_SPEED,
    LoopRecord,
    diverged_at,
    rest_at_start,
)
from rpctl.simulation.compiled.build import compiled_loop
from rpctl.simulation.compiled.laws.law_fragment import LimitNames
from rpctl.simulation.compiled.laws.law_settings import settings_of
from rpctl.simulation.compiled.loop import FAR, LAW_FAILED, CompiledLoop
from rpctl.simulation.compiled.machine.program import Rows, RowStream
from rpctl.simulation.compiled.starting import followed_rows, prepared
from rpctl.simulation.config import Config
from rpctl.simulation.noise import NoiseStream, Sensors
from rpctl.simulation.recorder import Recorder
from rpctl.simulation.samples import Samples

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
    compiled = compiled_loop(known, simulated, config)
    if recorder is not None:
        recorder.defer()  # what the log derives of the states takes longer than the loop
    began = time.perf_counter()
    try:
        run = _LoopRun(compiled, robot, config, reference)
        run.begin(known, rest)
        if run.stage is not None:
            record.approaches = run.stage.approaches
        record.backend = "compiled"
        for first in range(0, steps + 1, CHUNK):
            count = min(CHUNK, steps + 1 - first)
            run.advance(first, count, recorder)
            record.wall_time = time.perf_counter() - began
            if progress is not None:
                progress(first + count - 1, steps)
    except NeedsPython:
        record.backend = "pinocchio"
        raise
    finally:
        record.wall_time = time.perf_counter() - began


class _LoopRun:
    """One run of a compiled loop.

    Args:
        compiled: The loop, of one lane.
        robot: The robot without what the plant adds.
        config: Laws, circumstances and plant.
        reference: What is tracked.
    """

    def __init__(
        self, compiled: CompiledLoop, robot: Robot, config: Config, reference: Reference
    ) -> None:
        self._compiled, self._robot, self._config = compiled, robot, config
        self._reference = self._followed = reference
        self._sensors = Sensors(robot)
        self._deviations = self._sensors.deviations(config.plant.noise)
        self._errors = self._sensors.errors(config.plant.sensor_bias)
        self._stream = NoiseStream(self._sensors.width, config.plant.seed)
        self._noise = np.empty((0, self._sensors.width))  # drawn, and not used yet
        self.stage: ApproachStage | None = None

    def begin(self, known: ReducedDynamics, rest: Rest) -> None:
        """Start at rest.

        Args:
            known: The dynamics as the controller knows them.
            rest: State of the simulated robot.
        """
        config, period = self._config, self._config.run.control_period
        law: Any = as_law(config.kinematic)
        dynamic: Any = as_law(config.dynamic)
        self.stage = None if law.approach is None else law.approach.stage(known)
        if self.stage is not None:
            still = np.zeros(known.robot.dof)
            self._noise = self._stream.rows(1) * self._deviations + self._errors
            q, nu = self._sensors.measured(rest.q, still, self._noise[0])
            self._followed = self.stage(known, self._reference, 0.0, q, nu)
        settings = settings_of(law, dynamic, known, period)[1]
        self._workspace, self._ring = prepared(self._compiled, config, rest, settings, self.stage)

    def advance(self, first: int, count: int, recorder: Recorder | None) -> None:
        """Compute and record some samples.

        Args:
            first: Number of the first.
            count: How many.
            recorder: Gets them.
        """
        loop = self._compiled.program
        times = self._config.run.control_period * np.arange(first, first + count, dtype=float)
        table = tabulate(self._robot, self._reference, times)
        rows = {loop.reference: Rows(table.rows()), loop.ring: self._ring}
        if loop.followed in loop.sample.streams:
            read = followed_rows(self._robot, self._followed, table)
            rows[loop.followed] = Rows(read[:, :, None].copy())
        if loop.noise in loop.sample.streams:
            drawn = self._stream.rows(count - len(self._noise)) * self._deviations + self._errors
            rows[loop.noise] = Rows(np.vstack([self._noise, drawn])[:, :, None].copy())
            self._noise = drawn[:0]
        log = {stream: Rows(np.empty((count, stream.width, 1))) for stream in loop.log.values()}
        given = {stream: {**rows, **log}[stream] for stream in loop.sample.streams}
        self._compiled.sample.run(first, count, self._workspace, given)
        _record(self._compiled, log, table, first, recorder)


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
    """Give a recorder samples of a log.

    Args:
        recorder: Gets them.
        names: Makes limits of a row of the log.
        log: Its columns by name, (K, ...).
        table: The reference at its samples.
        count: How many of them.
    """
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
        e=log["e"][rows],
        pose=table.pose[rows],
        twist=table.twist[rows],
        twist_dot=table.twist_dot[rows],
        joints=table.joints[rows],
        joint_rates=table.joint_rates[rows],
        direction=table.direction[rows].reshape(count, -1),
        felt=np.empty((count, 0)),
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
