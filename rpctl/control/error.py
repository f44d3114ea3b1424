"""The tracking error e: reference minus actual, in the robot's frame."""

from __future__ import annotations

import math

import numpy as np

from rpctl.description.records import Array
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

BASE_ERRORS = 3  # x1, x2, x3: longitudinal, lateral, heading


def tracking_error(robot: Robot, reference: ReferenceState, q: Array) -> Array:
    """Return e (3 + n_joints,): x1, x2 (m), x3 (rad), then the joints' errors (rad or m).

    [MS21, Eq. 6-10]: the base's error in the axes of the robot, its heading wrapped into (−π, π];
    so are the errors of unlimited joints.
    """
    pose = robot.base_pose(q)
    dx, dy = reference.pose[0] - pose[0], reference.pose[1] - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    base = (cos * dx + sin * dy, cos * dy - sin * dx, wrap(reference.pose[2] - pose[2]))
    joints = reference.joints - robot.joint_positions(q)
    for index, joint in enumerate(robot.joints):
        if joint.kind == "continuous":
            joints[index] = wrap(joints[index])
    return np.concatenate([base, joints])


def error_rate(e: Array, reference: ReferenceState, nu: Array) -> Array:
    """Return ė (3 + n_joints,) when the robot moves with ν; [MS21, Eq. 10].

    ẋ1 = v_r cos x3 − v + x2 ω, ẋ2 = v_r sin x3 − x1 ω, ẋ3 = ω_r − ω for a base with an axle; a
    holonomic one adds its and the reference's speed to the left. A joint's is the difference of
    rates. A fixed base has no base error.
    """
    joints = len(e) - BASE_ERRORS
    rate = np.zeros(len(e))
    if len(nu) > joints:
        cos, sin = math.cos(e[2]), math.sin(e[2])
        vx, vy, omega = base_velocity(nu, joints)
        vx_r, vy_r, omega_r = base_velocity(reference.nu, joints)
        rate[0] = vx_r * cos - vy_r * sin - vx + e[1] * omega
        rate[1] = vx_r * sin + vy_r * cos - vy - e[0] * omega
        rate[2] = omega_r - omega
    rate[BASE_ERRORS:] = (reference.nu - nu)[len(nu) - joints :]
    return rate


def base_velocity(nu: Array, joints: int) -> tuple[float, float, float]:
    """Return the base's speed forward and left (m/s) and its turning rate (rad/s) out of ν."""
    if len(nu) == joints + 2:
        return float(nu[0]), 0.0, float(nu[1])
    return float(nu[0]), float(nu[1]), float(nu[2])


def wrap(angle: float) -> float:
    """Return an angle (rad) wrapped into (−π, π]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)
