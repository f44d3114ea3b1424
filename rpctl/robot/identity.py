"""What tells a robot from another: its file, how it was loaded, and its model's numbers."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from rpctl.robot.model import Robot


def robot_identity(robot: Robot) -> dict[str, Any]:
    """Return what tells a robot from another: its file, how it was loaded, its model's numbers."""
    return {
        "name": robot.name,
        "urdf": robot.description.sha256,
        "locked": dict(robot.locked),
        "home": dict(zip(robot.joint_names, robot.home.tolist(), strict=True)),
        "end_effector": robot.end_effector,
        "drive": _digest(repr(robot.drive).encode()),
        "model": model_digest(robot),
    }


def model_digest(robot: Robot) -> str:
    """Return a digest of all numbers of a robot's model: inertias, places, limits, losses."""
    model, described = robot.model, robot.description.joint
    moving = [described[name] for name in robot.moving_joint_names]
    parts = [
        *(inertia.toDynamicParameters() for inertia in model.inertias),
        *(place.homogeneous for place in model.jointPlacements),
        model.armature,
        robot.effort_limits,
        robot.velocity_limits,
        [(j.lower, j.upper, j.velocity, j.effort) for j in moving],
    ]
    if model.gravity.linear[:2].any():  # level ground is what all others are on
        parts.append(model.gravity.linear)
    if robot.losses is not None:
        parts += [robot.losses.damping, robot.losses.friction]
    return _digest(b"".join(np.ascontiguousarray(part, float).tobytes() for part in parts))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
