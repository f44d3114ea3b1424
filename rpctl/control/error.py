"""The tracking error e, reference minus actual, in the robot's frame; its leash; what laws read."""

from __future__ import annotations

import math as numbers
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.kernels.sheet import Sheet
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

BASE_ERRORS = 3  # x1, x2, x3: longitudinal, lateral, heading
SERIES_RADIUS = 1e-2  # of u: below it the series of tanh(u)/u is exact to rounding


class Tracking(NamedTuple):
    """The inputs of a kinematic law, in scalars for a formula.

    Attributes:
        sheet: Names intermediate results and takes derivatives by time.
        twist: Twist of the reference (3,) in its own axes: speeds forward and to the left (m/s),
            turning rate (rad/s).
        twist_dot: Derivatives of these three numbers (3,), m/s² and rad/s².
        direction: Vector along the twist (3,) that does not vanish if the reference stands still.
        error: The error x1 ahead, x2 to the left (m) and x3 of the heading (rad, in (−π, π]),
            reference minus actual, in the robot's axes ([MS21, Eq. 6-8]).
        e: The error as the law's leash bounds it; the error itself without a leash.
        own_twist: Twist of P (3,) in the robot's axes, m/s and rad/s.
    """

    sheet: Sheet
    twist: Any
    twist_dot: Any
    direction: Sequence[Any]
    error: Sequence[Any]
    e: Sequence[Any]
    own_twist: Sequence[Any]


def tracking_error(robot: Robot, state: ReferenceState, q: Array) -> Array:
    """Return e (3 + n_joints,): x1, x2 (m), x3 (rad), then the joints' errors (rad or m)."""
    base = base_error(state.pose, robot.base_pose(q))
    return np.array([*base, *joint_errors(robot, state.joints, robot.joint_positions(q))])


def base_error(wanted: Any, pose: Any) -> list[Any]:
    """Return x1, x2, x3, the base's error in the axes of the robot; [MS21, Eq. 6-8].

    Args:
        wanted: Pose of P on the reference (3,), floats or scalars.
        pose: Pose of P (3,), likewise.
    """
    dx, dy = wanted[0] - pose[0], wanted[1] - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return [cos * dx + sin * dy, cos * dy - sin * dx, wrap(wanted[2] - pose[2])]


def base_error_rate(e: Any, wanted: Any, twist: Any) -> list[Any]:
    """Return the rates of x1, x2, x3 of a base that moves; [MS21, Eq. 10].

    ẋ1 = v_r cos x3 − v + x2 ω, ẋ2 = v_r sin x3 − x1 ω, ẋ3 = ω_r − ω. Speeds to the left, where base
    or reference have them, enter in the same way.

    Args:
        e: x1, x2, x3, floats or scalars.
        wanted: Twist of the reference (3,).
        twist: Twist of the robot (3,).
    """
    cos, sin = math.cos(e[2]), math.sin(e[2])
    return [
        wanted[0] * cos - wanted[1] * sin - twist[0] + e[1] * twist[2],
        wanted[0] * sin + wanted[1] * cos - twist[1] - e[0] * twist[2],
        wanted[2] - twist[2],
    ]


def joint_errors(robot: Robot, wanted: Any, positions: Any) -> list[Any]:
    """Return the errors of the arm's joints; those of unlimited ones the short way round."""
    gaps = [a - b for a, b in zip(wanted, positions, strict=True)]
    kinds = [joint.kind for joint in robot.joints]
    return [
        wrap(gap) if kind == "continuous" else gap for gap, kind in zip(gaps, kinds, strict=True)
    ]


def wrap(angle: Any) -> Any:
    """Return an angle (rad), a float or a scalar, wrapped into (−π, π]."""
    turn = 2.0 * numbers.pi
    rest = numbers.pi - angle
    return numbers.pi - (rest - turn * math.floor(rest / turn))


@dataclass(frozen=True)
class Leash(Record):
    """A smooth bound of the base's error.

    v_d of a kinematic law contains x2 ω_d, which grows with the square of the error, so a large
    error leads to speeds that no robot has. With p = (x1, x2) and u = |p|/L the law gets

        p' = p tanh(u)/u,    x3' = T tanh(x3/T)

    The direction of p is unchanged. For errors much smaller than L and T, p' and x3' differ from p
    and x3 in third order only, so the law near its reference is unchanged.
    """

    distance: Annotated[
        float,
        POSITIVE,
        Setting("m", "", "L: bound of the position error that enters a law."),
    ] = 0.3
    heading: Annotated[
        float, POSITIVE, Setting("rad", "", "T: bound of the heading error that enters a law.")
    ] = 1.0

    def __call__(self, sheet: Sheet, error: Sequence[Any]) -> list[Any]:
        """Return the base's error (3,) on the leash."""
        x1, x2, x3 = error
        square = sheet.named("u_square", (x1**2 + x2**2) / self.distance**2)
        near = square < SERIES_RADIUS**2
        u = sheet.named("u", math.sqrt(math.if_else(near, SERIES_RADIUS**2, square)))
        series = 1.0 - square / 3.0 + 2.0 * square**2 / 15.0
        scale = sheet.named("k", math.if_else(near, series, math.tanh(u) / u))
        leashed = scale * x1, scale * x2, self.heading * math.tanh(x3 / self.heading)
        return [sheet.named(f"y{i}", each) for i, each in enumerate(leashed, start=1)]


def omnidirectional_twist(at: Tracking, horizon: Any) -> list[Any]:
    """Return the twist (3,) that drives x1, x2 and x3 to zero, each as ẋ = −x/h.

    It is the prediction of [MS21, Eq. 11-20] with the errors themselves as outputs: three inputs
    for three outputs. References that a base with an axle could follow have no speed to the left,
    others may have one.

    A leash bounds x, and with it the speeds, but not the heading error that the reference's speeds
    are turned by: x2 ω_d and −x1 ω_d only turn the position error, so its length and the heading
    error fall from anywhere.

    Args:
        at: What the law reads.
        horizon: Prediction time h, s.
    """
    (vx_r, vy_r, omega_r), (x1, x2, x3) = at.twist, at.e
    cos, sin = math.cos(at.error[2]), math.sin(at.error[2])
    omega_d = at.sheet.named("omega_d", omega_r + x3 / horizon)
    return [
        at.sheet.named("v_d", vx_r * cos - vy_r * sin + x2 * omega_d + x1 / horizon),
        at.sheet.named("vl_d", vx_r * sin + vy_r * cos - x1 * omega_d + x2 / horizon),
        omega_d,
    ]
