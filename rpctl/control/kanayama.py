"""Kanayama's law: a baseline."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from rpctl import math
from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking
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

    kx: Annotated[float, POSITIVE, Setting("1/s", "", "Kx.")] = 1.5
    ky: Annotated[float, POSITIVE, Setting("1/m²", "", "Ky.")] = 16.0
    ktheta: Annotated[float, POSITIVE, Setting("1/m", "", "Kθ.")] = 8.0
    leash: Leash | None = field(default_factory=Leash, kw_only=True)
    approach: Approach | None = field(default_factory=Approach, kw_only=True)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the speed and the turning rate to ask of a base that cannot move sideways."""
        (v_r, _, omega_r), (x1, x2, x3) = at.twist, at.e
        gain = at.sheet.named("K", self.ky * x2 + math.sign(v_r) * self.ktheta * math.sin(x3))
        v_d = at.sheet.named("v_d", v_r * math.cos(x3) + self.kx * x1)
        return v_d, at.sheet.named("omega_d", omega_r + v_r * gain)
