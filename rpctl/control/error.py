"""The tracking error e: reference minus actual, in the robot's frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

BASE_ERRORS = 3  # x1, x2, x3: longitudinal, lateral, heading


class Tracking(NamedTuple):
    """A reference, and the tracking error with its rate."""

    state: ReferenceState
    e: Array  # (3 + n_joints,) x1, x2 (m), x3 (rad), then the joints' errors (rad or m)
    e_dot: Array  # (3 + n_joints,)


def observe(dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array) -> Tracking:
    """Return the tracking error of a robot, and its rate.

    Args:
        dynamics: The robot's dynamics.
        state: The reference.
        q: Configuration (nq,).
        nu: Quasi-velocities of the robot (dof,).
    """
    e = tracking_error(dynamics.robot, state, q)
    rates = nu[dynamics.robot.dof - len(dynamics.robot.joints) :]
    return Tracking(state, e, error_rate(e, state, dynamics.twist(q, nu), rates))


def tracking_error(robot: Robot, state: ReferenceState, q: Array) -> Array:
    """Return e (3 + n_joints,): x1, x2 (m), x3 (rad), then the joints' errors (rad or m).

    [MS21, Eq. 6-10]: the base's error in the axes of the robot, its heading wrapped into (−π, π];
    so are the errors of unlimited joints.

    Args:
        robot: The robot.
        state: The reference.
        q: Configuration (nq,).
    """
    pose = robot.base_pose(q)
    dx, dy = state.pose[0] - pose[0], state.pose[1] - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    base = (cos * dx + sin * dy, cos * dy - sin * dx, wrap(state.pose[2] - pose[2]))
    joints = state.joints - robot.joint_positions(q)
    for index, joint in enumerate(robot.joints):
        if joint.kind == "continuous":
            joints[index] = wrap(joints[index])
    return np.concatenate([base, joints])


def error_rate(e: Array, state: ReferenceState, twist: Array, joint_rates: Array) -> Array:
    """Return ė (3 + n_joints,) of a robot that moves.

    [MS21, Eq. 10]: ẋ1 = v_r cos x3 − v + x2 ω, ẋ2 = v_r sin x3 − x1 ω, ẋ3 = ω_r − ω. Speeds to the
    left, where base or reference have them, enter in the same way.

    Args:
        e: Tracking error (3 + n_joints,).
        state: The reference.
        twist: The robot's twist (3,): P's speed forward and to the left (m/s), turning rate.
        joint_rates: Rates of its joints (n_joints,), rad/s or m/s.
    """
    cos, sin = math.cos(e[2]), math.sin(e[2])
    vx, vy, omega = twist
    vx_r, vy_r, omega_r = state.twist
    base = (
        vx_r * cos - vy_r * sin - vx + e[1] * omega,
        vx_r * sin + vy_r * cos - vy - e[0] * omega,
        omega_r - omega,
    )
    return np.concatenate([base, state.joint_rates - joint_rates])


def wrap(angle: float) -> float:
    """Return an angle (rad) wrapped into (−π, π]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)
