"""A compiled loop before its first sample: the robot at rest, and what the laws know of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
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


def prepared(
    compiled: CompiledLoop,
    config: Config,
    rest: Rest,
    settings: Array,
    stage: ApproachStage | None = None,
) -> tuple[Mapping[Buffer, Array], Rows]:
    """Return the workspace before the first sample, and the ring of efforts on their way.

    Args:
        compiled: The loop.
        config: Its plant.
        rest: Where the simulated robot stands.
        settings: Values of the laws' settings (n_s,).
        stage: Finds ways up to the reference; None: the base needs none.
    """
    loop, period = compiled.program, config.run.control_period
    law, late = loop.law, delay_periods(config.plant.delay, period)
    begins = compiled.start.workspace()
    at_rest = {law.q: rest.q, loop.plant.q: rest.q, loop.plant.p: compiled.p}
    fill(begins, {**at_rest, law.tau: rest.tau, law.settings: settings})
    compiled.start.run(0, 1, begins, {})
    workspace = compiled.sample.workspace()
    fill(workspace, {buffer: begins[buffer] for buffer in loop.memory})
    values = {
        loop.plant.q: rest.q,
        loop.plant.p: compiled.p,
        law.settings: settings,
        law.elapsed: [period],
        loop.bias: config.plant.bias(compiled.robot),
        loop.back: [float(late)],
        loop.search_from: [search_from(stage, period)],
    }
    fill(workspace, values)
    ring = np.empty((late + 1, len(rest.tau), compiled.sample.lanes))
    ring[:] = rest.tau[:, None]
    return workspace, Rows(ring, ring=True)


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
