"""A compiled loop before its first sample: the robot at rest, and what the laws know of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach import RETRY_S, ApproachStage, WayToReference
from rpctl.control.law import Rest
from rpctl.reference.motion import Reference
from rpctl.reference.table import ReferenceTable, tabulate
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.loop import CompiledLoop
from rpctl.simulation.compiled.machine.program import Buffer, Rows
from rpctl.simulation.config import Config
from rpctl.simulation.periods import delay_periods


@dataclass(frozen=True, eq=False)
class LoopStart:
    """Where a loop begins, at rest: numbers (n,) that all lanes have, or (n, lanes).

    Attributes:
        q: Configuration (nq, ...).
        rest: Efforts (n_act, ...) that hold the robot there.
        p: Parameters of the simulated robot (n_p, ...).
        settings: Values of the laws' settings (n_s, ...).
        bias: Efforts (n_act, ...) that push besides the controller's.
        most: Efforts (n_act, ...) at which the true actuators saturate.
        back: By how many periods efforts are late (1, ...).
        search_from: Number of the sample from which on a way up is looked for (1, ...).
    """

    q: Array
    rest: Array
    p: Array
    settings: Array
    bias: Array
    most: Array
    back: Array
    search_from: Array


def started(
    compiled: CompiledLoop, begin: LoopStart, period: float
) -> tuple[Mapping[Buffer, Array], Rows]:
    """Return the workspace before the first sample, and the ring of efforts on their way.

    Args:
        compiled: The loop.
        begin: Where it begins.
        period: Control period, s.
    """
    loop, law = compiled.program, compiled.program.law
    begins = compiled.start.workspace()
    common = {loop.plant.q: begin.q, loop.plant.p: begin.p, law.settings: begin.settings}
    fill(begins, {**common, law.q: begin.q, law.tau: begin.rest})
    compiled.start.run(0, 1, begins, {})
    workspace = compiled.sample.workspace()
    fill(workspace, {buffer: begins[buffer] for buffer in loop.memory})
    values = {
        **common,
        law.elapsed: [period],
        loop.bias: begin.bias,
        loop.most: begin.most,
        loop.back: begin.back,
        loop.search_from: begin.search_from,
    }
    fill(workspace, values)
    ring = np.empty((int(begin.back.max()) + 1, len(begin.rest), compiled.sample.lanes))
    ring[:] = begin.rest if begin.rest.ndim > 1 else begin.rest[:, None]
    return workspace, Rows(ring, ring=True)


def prepared(
    compiled: CompiledLoop,
    config: Config,
    rest: Rest,
    settings: Array,
    stage: ApproachStage | None = None,
) -> tuple[Mapping[Buffer, Array], Rows]:
    """Return what :func:`started` does, of a run of a configuration in every lane.

    Args:
        compiled: The loop.
        config: Its plant.
        rest: Where the simulated robot stands.
        settings: Values of the laws' settings (n_s,).
        stage: Finds ways up to the reference; None: the base needs none.
    """
    period = config.run.control_period
    begin = LoopStart(
        q=rest.q,
        rest=rest.tau,
        p=compiled.p,
        settings=settings,
        bias=config.plant.bias(compiled.robot),
        most=config.plant.saturation(compiled.robot),
        back=np.array([float(delay_periods(config.plant.delay, period))]),
        search_from=np.array([search_from(stage, period)]),
    )
    return started(compiled, begin, period)


def fill(workspace: Mapping[Buffer, Array], values: Mapping[Buffer, Any]) -> None:
    """Set the same values in all lanes of those buffers that there are."""
    for buffer, numbers in values.items():
        if buffer in workspace:
            given = np.asarray(numbers, dtype=float)
            workspace[buffer][:] = given[:, None] if given.ndim == 1 else given


def search_from(stage: ApproachStage | None, period: float) -> float:
    """Return the number of the sample from which on a way up may be looked for."""
    if stage is None or stage.searched_at < 0.0:
        return 0.0
    return float(math.ceil(RETRY_S / period - 1e-9))


def followed_rows(robot: Robot, followed: Reference, table: ReferenceTable) -> Array:
    """Return the rows of what a law is given at the times of a reference's table.

    Args:
        robot: The robot.
        followed: The reference itself, or a way up to it.
        table: The reference's.
    """
    rows = table.rows()
    if isinstance(followed, WayToReference):
        before = table.t < followed.plan.joins_at
        rows[before] = tabulate(robot, followed, table.t[before]).rows()
    return rows
