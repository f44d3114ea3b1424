"""Kanayama's law: a baseline."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking, Twist
from rpctl.control.twist_law import BaseLaw
from rpctl.files.records import POSITIVE, Setting


@dataclass(frozen=True)
class Kanayama(BaseLaw):
    """The law of [K90]:

        v_d = v_r cos x3 + Kx x1
        ω_d = ω_r + v_r (Ky x2 + Kθ sin x3)

    The paper drives forward, where V = ½ (x1² + x2²) + (1 − cos x3)/Ky falls by
    V̇ = −Kx x1² − v_r Kθ sin² x3/Ky. A reverse drive is the same seen from the robot's other end:
    Kθ then takes |v_r|. Where v_r = 0 a spin turns beside its reference: the heading error stays.

    Near a line x2 and x3 have natural frequency √Ky |v_r| and damping Kθ/(2 √Ky); the gains here
    damp critically, as the paper's.
    """

    horizon: Annotated[
        float,
        POSITIVE,
        Setting("s", "Horizon h", "Prediction time of the arm and of an omnidirectional base."),
    ] = 0.65
    kx: Annotated[float, POSITIVE, Setting("1/s", "", "Kx.")] = 1.5
    ky: Annotated[float, POSITIVE, Setting("1/m²", "", "Ky.")] = 16.0
    ktheta: Annotated[float, POSITIVE, Setting("1/m", "", "Kθ.")] = 8.0
    leash: Leash | None = field(default_factory=Leash, kw_only=True)
    approach: Approach | None = field(default_factory=Approach, kw_only=True)

    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist of a base that cannot move sideways."""
        state, x, x_dot = tracking
        v_r, _, omega_r = state.twist
        a_r, _, alpha_r = state.twist_dot
        cos, sin, direction = math.cos(x[2]), math.sin(x[2]), np.sign(v_r)
        gain = self.ky * x[1] + direction * self.ktheta * sin
        gain_rate = self.ky * x_dot[1] + direction * self.ktheta * cos * x_dot[2]
        v_d = v_r * cos + self.kx * x[0]
        a_d = a_r * cos - v_r * sin * x_dot[2] + self.kx * x_dot[0]
        omega_d = omega_r + v_r * gain
        alpha_d = alpha_r + a_r * gain + v_r * gain_rate
        return Twist(np.array([v_d, 0.0, omega_d]), np.array([a_d, 0.0, alpha_d]))
