"""The kinematic predictive law of [MS21]: from the tracking error to the speeds to ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpctl.control.command import Command, KinematicLaw, Twist, command
from rpctl.control.end_effector import EndEffector
from rpctl.control.error import Tracking, observe
from rpctl.description.records import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnknownNameError, require_positive
from rpctl.reference.motion import Reference


@dataclass(frozen=True)
class PaperKinematic:
    """The predictive law of [MS21, Eq. 11-20].

    The outputs z = (x1 − β s x2, x3, joint errors), predicted to first order over the horizon h,
    minimise J = ½ Σ wᵢ (zᵢ + h żᵢ)². Inputs and outputs are equal in number, so the minimum is
    zero, the weights cancel, and every output decays as ż = −z/h:

        ω_d = ω_r + x3/h
        v_d = v_r cos x3 + x2 ω_d − β s (v_r sin x3 − x1 ω_d) + (x1 − β s x2)/h
        q̇_d = q̇_r + (q_r − q)/h

    with s = sgn ω_r. On the output's zero the lateral error obeys ẋ2 = −β |ω_r| x2: a straight
    line leaves it as it is. A holonomic base has three inputs, so x1, x2 and x3 are outputs
    themselves, and the same prediction drives each of them to zero.

    Attributes:
        horizon: Prediction time h, s.
        beta: Weight β of the lateral error in the longitudinal output.
        smoothing: ω₀ (rad/s) of s = ω_r/√(ω_r² + ω₀²); 0 is the paper's sign.
    """

    horizon: float = 0.8
    beta: float = 1.5
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a horizon that predicts nothing."""
        require_positive("horizon", self.horizon)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and ν̇_d; the latter is exact, not a difference of samples."""
        tracking = observe(dynamics, reference(t), q, nu)
        law = self.holonomic if dynamics.robot.drive.holonomic else self.unicycle
        return command(dynamics, tracking, law(tracking), self.horizon)

    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist to ask of a base that cannot move sideways."""
        horizon, (state, x, x_dot) = self.horizon, tracking
        v_r, _, omega_r = state.twist
        a_r, _, alpha_r = state.twist_dot
        sign, sign_rate = self._sign(omega_r, alpha_r)
        b, b_rate = self.beta * sign, self.beta * sign_rate
        cos, sin = math.cos(x[2]), math.sin(x[2])
        omega_d = omega_r + x[2] / horizon
        alpha_d = alpha_r + x_dot[2] / horizon
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

    def holonomic(self, tracking: Tracking) -> Twist:
        """Return the twist to ask of a base that moves any way: outputs are x1, x2, x3 themselves.

        A reference that a base with an axle could follow has no speed to the left, others do.
        """
        horizon, (state, x, x_dot) = self.horizon, tracking
        vx_r, vy_r, omega_r = state.twist
        ax_r, ay_r, alpha_r = state.twist_dot
        cos, sin, turn = math.cos(x[2]), math.sin(x[2]), x_dot[2]
        omega_d, alpha_d = omega_r + x[2] / horizon, alpha_r + x_dot[2] / horizon
        ahead, left = vx_r * cos - vy_r * sin, vx_r * sin + vy_r * cos
        ahead_rate = ax_r * cos - ay_r * sin - left * turn
        left_rate = ax_r * sin + ay_r * cos + ahead * turn
        vx_d = ahead + x[1] * omega_d + x[0] / horizon
        vy_d = left - x[0] * omega_d + x[1] / horizon
        ax_d = ahead_rate + x_dot[1] * omega_d + x[1] * alpha_d + x_dot[0] / horizon
        ay_d = left_rate - x_dot[0] * omega_d - x[0] * alpha_d + x_dot[1] / horizon
        return Twist(np.array([vx_d, vy_d, omega_d]), np.array([ax_d, ay_d, alpha_d]))

    def _sign(self, omega_r: float, alpha_r: float) -> tuple[float, float]:
        """Return s and ṡ; the sign's own jump has no derivative to speak of."""
        if self.smoothing == 0.0:
            return float(np.sign(omega_r)), 0.0
        size = math.hypot(omega_r, self.smoothing)
        return omega_r / size, alpha_r * self.smoothing**2 / size**3


KINEMATIC_LAWS: dict[str, Callable[[], KinematicLaw]] = {
    "paper": PaperKinematic,
    "end-effector": EndEffector,
}


def kinematic_by_name(name: str) -> KinematicLaw:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in KINEMATIC_LAWS:
        raise UnknownNameError("kinematic law", name, KINEMATIC_LAWS)
    return KINEMATIC_LAWS[name]()
