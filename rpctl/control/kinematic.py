"""The kinematic predictive law of [MS21]: from the tracking error to the speeds to ask for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import Tracking, Twist
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, POSITIVE_OR_NONE, WITHIN, Setting


@dataclass(frozen=True)
class PaperKinematic(BaseLaw):
    """The predictive law of [MS21, Eq. 11-20].

    The outputs z = (x1 − β s x2, x3, joint errors), predicted to first order over the horizon h,
    minimise J = ½ Σ wᵢ (zᵢ + h żᵢ)². Inputs and outputs are equal in number, so the minimum is
    zero, the weights cancel, and every output decays as ż = −z/h:

        ω_d = ω_r + x3/h
        v_d = v_r cos x3 + x2 ω_d − β s (v_r sin x3 − x1 ω_d) + (x1 − β s x2)/h
        q̇_d = q̇_r + (q_r − q)/h

    with s = sgn ω_r. On the output's zero the lateral error obeys ẋ2 = −β |ω_r| x2: a straight
    line leaves it as it is.
    """

    horizon: Annotated[
        float, POSITIVE, Setting("s", "Horizon h", "Prediction time h, also of the joints.")
    ] = 0.8
    beta: Annotated[
        float, WITHIN, Setting("", "β", "Weight of the lateral error in the longitudinal output.")
    ] = 1.5
    smoothing: Annotated[
        float,
        POSITIVE_OR_NONE,
        Setting("rad/s", "Smoothing ω₀", "Of s = ω_r/√(ω_r² + ω₀²); 0 is the paper's sign."),
    ] = 0.0

    def joint_horizons(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return the prediction times of the arm's joints (n_joints,), s.

        Args:
            dynamics: The robot's dynamics.
            period: Control period, s; the paper knows none.
        """
        return np.full(len(dynamics.robot.joints), self.joint_horizon or self.horizon)

    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist to ask of a base that cannot move sideways."""
        state, x, x_dot = tracking
        turn = state.twist[2] + x[2] / self.horizon, state.twist_dot[2] + x_dot[2] / self.horizon
        sign, sign_rate = self._sign(state.twist[2], state.twist_dot[2])
        return coupled(tracking, turn, (self.beta * sign, self.beta * sign_rate), self.horizon)

    def _sign(self, omega_r: float, alpha_r: float) -> tuple[float, float]:
        """Return s and ṡ; the sign's own jump has no derivative to speak of."""
        if self.smoothing == 0.0:
            return float(np.sign(omega_r)), 0.0
        size = math.hypot(omega_r, self.smoothing)
        return omega_r / size, alpha_r * self.smoothing**2 / size**3


def coupled(
    tracking: Tracking, turn: tuple[float, float], beta_sign: tuple[float, float], horizon: float
) -> Twist:
    """Return the twist of a turning base that lets x1 − b x2 decay at 1/h while b is steady.

    Args:
        turn: ω_d (rad/s) and its derivative along the actual motion (rad/s²).
        beta_sign: b = β s, and its derivative.
        horizon: Prediction time h, s.
    """
    state, x, x_dot = tracking
    v_r, a_r = state.twist[0], state.twist_dot[0]
    (omega_d, alpha_d), (b, b_rate) = turn, beta_sign
    cos, sin = math.cos(x[2]), math.sin(x[2])
    drift = v_r * sin - x[0] * omega_d
    drift_rate = a_r * sin + v_r * cos * x_dot[2] - x_dot[0] * omega_d - x[0] * alpha_d
    v_d = v_r * cos + x[1] * omega_d - b * drift + (x[0] - b * x[1]) / horizon
    a_d = (
        a_r * cos
        - v_r * sin * x_dot[2]
        + x_dot[1] * omega_d
        + x[1] * alpha_d
        - b * drift_rate
        - b_rate * drift
        + (x_dot[0] - b * x_dot[1] - b_rate * x[1]) / horizon
    )
    return Twist(np.array([v_d, 0.0, omega_d]), np.array([a_d, 0.0, alpha_d]))
