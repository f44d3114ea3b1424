"""Damping and friction of a robot's joints, from its description alone."""

from __future__ import annotations

import math

import numpy as np

from rpctl import Robot
from rpctl.arrays import Array

CREEP = {"prismatic": 1e-3, "revolute": 1e-2, "continuous": 1e-2}  # m/s, rad/s


def joint_losses(robot: Robot, v: Array) -> Array:
    """Return the generalised force (nv,) that opposes v (nv,), joint by joint."""
    force = np.zeros(robot.nv)
    for name in robot.moving_joint_names:
        joint, index = robot.description.joint[name], robot.velocity_index(name)
        rate = float(v[index])
        force[index] = -joint.damping * rate
        force[index] -= joint.friction * rate / math.hypot(rate, CREEP[joint.kind])
    return force
