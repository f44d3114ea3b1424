"""The twist that a kinematic law asks of the base, and that of a base that moves any way."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import Tracking
from rpctl.control.leash import Leash


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
        tracking: Reference and error.
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
