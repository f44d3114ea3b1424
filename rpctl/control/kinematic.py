"""The kinematic predictive law of [MS21]: from the tracking error to the speeds to ask for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.error import Tracking
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, POSITIVE_OR_NONE, WITHIN, Setting
from rpctl.kernels.sheet import Sheet


@dataclass(frozen=True)
class PaperKinematic(BaseLaw):
    """The predictive law of [MS21, Eq. 11-20].

    The outputs z = (x1 − β s x2, x3, joint errors), predicted to first order over the horizon h,
    minimise J = ½ Σ wᵢ (zᵢ + h żᵢ)². Inputs and outputs are equal in number, so the minimum is
    zero, the weights cancel, and every output decays as ż = −z/h:

        ω_d = ω_r + x3/h
        v_d = v_r cos x3 + x2 ω_d − β s (v_r sin x3 − x1 ω_d) + (x1 − β s x2)/h
        q̇_d = q̇_r + (q_r − q)/h

    with s = sgn ω_r. With zero outputs the lateral error obeys ẋ2 = −β |ω_r| x2: on a straight
    line it remains.
    """

    horizon: Annotated[
        float, POSITIVE, Setting("s", "Horizon h", "Prediction time h, also of the joints.")
    ] = 0.8
    beta: Annotated[
        float,
        WITHIN,
        Setting("", "Weight β of the lateral error", "Weight β in the longitudinal output."),
    ] = 1.5
    smoothing: Annotated[
        float,
        POSITIVE_OR_NONE,
        Setting("rad/s", "Smoothing ω₀", "ω₀ in s = ω_r/√(ω_r² + ω₀²); 0 is the paper's sign."),
    ] = 0.0

    def joint_horizons(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return the prediction times of the arm's joints (n_joints,), s.

        Args:
            dynamics: The robot's dynamics.
            period: Control period, s; not used.
        """
        return np.full(len(dynamics.robot.joints), self.joint_horizon or self.horizon)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the desired speed (m/s) of P and turning rate (rad/s), two scalars."""
        omega_r = at.twist[2]
        omega_d = at.sheet.named("omega_d", omega_r + at.e[2] / self.horizon)
        b = at.sheet.named("b", self.beta * smooth_sign(at.sheet, omega_r, self.smoothing))
        return coupled_speed(at, omega_d, b, self.horizon), omega_d


def smooth_sign(sheet: Sheet, value: Any, slow: Any) -> Any:
    """Return value/√(value² + slow²), 0 where both are 0; the sign where ``slow`` is 0."""
    square = sheet.named("s_square", value**2 + slow**2)
    moves = square > 0.0
    size = sheet.named("s_size", math.sqrt(math.if_else(moves, square, 1.0)))
    return math.if_else(moves, value, 0.0) / size


def coupled_speed(at: Tracking, omega_d: Any, b: Any, horizon: Any) -> Any:
    """Return the speed of a turning base that lets x1 − b x2 decay at 1/h while b is steady.

    Args:
        at: What the law reads.
        omega_d: Turning rate that the base is asked for, rad/s.
        b: β s.
        horizon: Prediction time h, s.
    """
    (x1, x2, x3), v_r = at.e, at.twist[0]
    drift = at.sheet.named("c", v_r * math.sin(x3) - x1 * omega_d)
    v_d = v_r * math.cos(x3) + x2 * omega_d - b * drift + (x1 - b * x2) / horizon
    return at.sheet.named("v_d", v_d)
