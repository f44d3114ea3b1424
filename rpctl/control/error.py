"""The tracking error e, reference minus actual, in the robot's frame; its leash; a twist."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

BASE_ERRORS = 3  # x1, x2, x3: longitudinal, lateral, heading
SERIES_RADIUS = 1e-2  # of u: below it the series of g(u) is exact to rounding, its quotient is not


class Tracking(NamedTuple):
    """A reference, and the tracking error with its rate."""

    state: ReferenceState
    e: Array  # (3 + n_joints,) x1, x2 (m), x3 (rad), then the joints' errors (rad or m)
    e_dot: Array  # (3 + n_joints,)


def observe(dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array) -> Tracking:
    """Return the tracking error of a robot, and its rate."""
    e = tracking_error(dynamics.robot, state, q)
    rates = nu[dynamics.robot.dof - len(dynamics.robot.joints) :]
    return Tracking(state, e, error_rate(e, state, dynamics.twist(q, nu), rates))


def tracking_error(robot: Robot, state: ReferenceState, q: Array) -> Array:
    """Return e (3 + n_joints,): x1, x2 (m), x3 (rad), then the joints' errors (rad or m).

    [MS21, Eq. 6-10]: the base's error in the axes of the robot, its heading wrapped into (−π, π];
    so are the errors of unlimited joints.
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


@dataclass(frozen=True)
class Leash(Record):
    """A smooth bound of the base's error, with its exact rate.

    v_d of a kinematic law contains x2 ω_d, which grows with the square of the error: far from its
    reference a robot is asked for speeds that it has not. With p = (x1, x2) and u = |p|/L the law
    is given

        p' = p tanh(u)/u,    x3' = T tanh(x3/T)

    and their derivatives along the motion, so that ν̇_d stays analytic:

        ṗ' = ṗ tanh(u)/u + p (p·ṗ) g(u)/L²,    g(u) = (sech² u − tanh(u)/u)/u²,
        ẋ3' = ẋ3 sech²(x3/T)

    The direction of p stays. Errors much smaller than the leash pass as they are, to third order:
    the law near its reference is what it was.
    """

    distance: Annotated[
        float,
        POSITIVE,
        Setting("m", "", "L: the position error that a law is given stays below it."),
    ] = 0.3
    heading: Annotated[
        float, POSITIVE, Setting("rad", "", "T: the heading error that a law is given, likewise.")
    ] = 1.0

    def __call__(self, tracking: Tracking) -> Tracking:
        """Return a tracking error on the leash, and its rate; joints' errors pass as they are."""
        state, e, e_dot = tracking
        position, position_rate = self.position(e[:2], e_dot[:2])
        turn = math.tanh(e[2] / self.heading)
        angle, angle_rate = self.heading * turn, (1.0 - turn**2) * e_dot[2]
        rest = slice(BASE_ERRORS, None)
        return Tracking(
            state,
            np.concatenate([position, [angle], e[rest]]),
            np.concatenate([position_rate, [angle_rate], e_dot[rest]]),
        )

    def position(self, p: Array, p_dot: Array) -> tuple[Array, Array]:
        """Return a position error (2,), m, on the leash, and its rate (2,), m/s.

        Args:
            p: Position error (2,), m.
            p_dot: Its rate (2,), m/s.
        """
        u = math.hypot(p[0], p[1]) / self.distance
        if u < SERIES_RADIUS:
            scale, bend = 1.0 - u**2 / 3.0 + 2.0 * u**4 / 15.0, -2.0 / 3.0 + 8.0 * u**2 / 15.0
        else:
            scale = math.tanh(u) / u
            bend = (1.0 - math.tanh(u) ** 2 - scale) / u**2
        along = float(p @ p_dot) / self.distance**2
        return scale * p, scale * p_dot + bend * along * p


class Twist(NamedTuple):
    """P's speed forward and to the left (m/s) and the turning rate (rad/s), and their rates."""

    value: Array  # (3,)
    rate: Array  # (3,)


def omnidirectional_twist(tracking: Tracking, horizon: float, leash: Leash | None = None) -> Twist:
    """Return the twist that drives x1, x2 and x3 to zero, each as ẋ = −x/h.

    It is the prediction of [MS21, Eq. 11-20] with the errors themselves as outputs: three inputs
    for three outputs. References that a base with an axle could follow have no speed to the left,
    others may have one.

    A leash bounds x, and with it the speeds, but not the heading error that the reference's speeds
    are turned by: x2 ω_d and −x1 ω_d only turn the position error, so its length and the heading
    error fall from anywhere.

    Args:
        horizon: Prediction time h, s.
        leash: Bounds the error; None: it does not.
    """
    state, actual, actual_dot = tracking
    _, x, x_dot = tracking if leash is None else leash(tracking)
    vx_r, vy_r, omega_r = state.twist
    ax_r, ay_r, alpha_r = state.twist_dot
    cos, sin, turn = math.cos(actual[2]), math.sin(actual[2]), actual_dot[2]
    omega_d, alpha_d = omega_r + x[2] / horizon, alpha_r + x_dot[2] / horizon
    ahead, left = vx_r * cos - vy_r * sin, vx_r * sin + vy_r * cos
    ahead_rate = ax_r * cos - ay_r * sin - left * turn
    left_rate = ax_r * sin + ay_r * cos + ahead * turn
    vx_d = ahead + x[1] * omega_d + x[0] / horizon
    vy_d = left - x[0] * omega_d + x[1] / horizon
    ax_d = ahead_rate + x_dot[1] * omega_d + x[1] * alpha_d + x_dot[0] / horizon
    ay_d = left_rate - x_dot[0] * omega_d - x[0] * alpha_d + x_dot[1] / horizon
    return Twist(np.array([vx_d, vy_d, omega_d]), np.array([ax_d, ay_d, alpha_d]))
