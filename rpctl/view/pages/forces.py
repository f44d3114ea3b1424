"""Efforts and ground reactions at each frame of the animation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.view.charts import BASE_SPEED_LABELS
from rpctl.view.pages.chart_data import packed


def overlay(robot: Robot | RpctlError, run: Run, times: Array) -> dict[str, Any]:
    """Return the efforts and, where they were logged, the ground's reactions at frames.

    Args:
        robot: The robot of the run, or why it cannot be had: efforts colour nothing then.
        run: The run.
        times: Times of the frames (n,), s, from 0.
    """
    frames = np.searchsorted(run.t - run.t[0], times)
    high, low = np.maximum.reduceat(run.tau, frames), np.minimum.reduceat(run.tau, frames)
    ratios = effort_ratios(run, np.maximum(high, -low))  # the largest up to the next frame
    return {
        "effort": {
            "joints": [
                0 if isinstance(robot, RpctlError) else robot.model.getJointId(name)
                for name in run.robot.actuators
            ],
            "share": packed(ratios),
        },
        "stance": _stance(run, frames),
    }


def effort_ratios(run: Run, size: Array) -> Array:
    """Return |τ| (n, n_act) over its limits; without a limit, over its maximum in the run."""
    most = np.maximum(run.tau.max(axis=0), -run.tau.min(axis=0))
    limits = np.array(run.robot.effort_limits)
    known = np.isfinite(limits) & (limits > 0.0)
    return np.asarray(size / np.where(known, limits, np.maximum(most, 1e-12)))


def contact_forces(run: Run, samples: Any = slice(None)) -> Array:
    """Return the force of the ground on each contact (n, n_contacts, 3), root link's axes, N.

    The lateral force of an axle is shared in proportion to its wheels' loads. Wheels that steer
    push in directions that the log does not hold: for them only the load is given.
    """
    loads, wheel_force = run.log.contact_load[samples], run.log.wheel_force[samples]
    force = np.zeros((*loads.shape, 3))
    force[:, :, 2] = loads
    if not set(run.robot.quasi_velocities) <= {*BASE_SPEED_LABELS, *run.robot.joint_names}:
        return force
    force[:, : wheel_force.shape[1], 0] = wheel_force
    for axle, lateral in zip(run.ground.axles, run.log.axle_force[samples].T, strict=True):
        load = np.maximum(loads[:, list(axle)], 0.0)
        load_fraction = load / np.maximum(load.sum(axis=1, keepdims=True), 1e-12)
        force[:, list(axle), 1] = load_fraction * lateral[:, None]
    heading = float(run.robot.drive.heading)
    forward = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    force[:, :, :2] = force[:, :, :1] * forward + force[:, :, 1:2] * left
    return force


def _stance(run: Run, frames: NDArray[np.int64]) -> dict[str, Any] | None:
    """Return contacts, forces, support polygon and zero-moment point in the root link's frame."""
    if not run.log.tip_margin.size:
        return None
    from scipy.spatial import ConvexHull

    points = np.array(run.ground.points)
    x, y, cos, sin = run.q[frames, :4].T
    dx, dy = run.log.zmp[frames, 0] - x, run.log.zmp[frames, 1] - y
    stance: dict[str, Any] = {
        "height": run.robot.drive.ground,
        "points": np.round(points, 4).tolist(),
        "polygon": ConvexHull(points).vertices.tolist(),
        "pose": packed(np.column_stack([x, y, np.unwrap(np.arctan2(sin, cos))])),
        "zmp": packed(np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])),
        "margin": packed(run.log.tip_margin[frames]),
    }
    if run.log.contact_load.size:
        stance["force"] = packed(contact_forces(run, frames))
        load = run.log.contact_load
        stance["largest"] = float(max(load.max(), -load.min()))
    return stance
