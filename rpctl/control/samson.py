"""Samson's law: a baseline."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from rpctl import math
from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking
from rpctl.control.twist_law import BaseLaw
from rpctl.files.records import POSITIVE, Setting


@dataclass(frozen=True)
class Samson(BaseLaw):
    """The nonlinear law of [SSVO09, Section 11.5.1]:

        v_d = v_r cos x3 + k x1
        ω_d = ω_r + b v_r x2 sin x3/x3 + k x3,    k = 2 ζ √(ω_r² + b v_r²)

    V = ½ b (x1² + x2²) + ½ x3² falls by V̇ = −b k x1² − k x3². Near a steady reference the errors
    have natural frequency √(ω_r² + b v_r²) and damping ζ, and the third pole is real. Where the
    reference stands still the gains vanish, and the error stays.
    """

    b: Annotated[float, POSITIVE, Setting("1/m²", "Weight of the position error")] = 16.0
    zeta: Annotated[float, POSITIVE, Setting("", "Damping ratio")] = 0.7
    leash: Leash | None = field(default_factory=Leash, kw_only=True)
    approach: Approach | None = field(default_factory=Approach, kw_only=True)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the speed and the turning rate to ask of a base that cannot move sideways."""
        sheet, (v_r, _, omega_r), (x1, x2, x3) = at.sheet, at.twist, at.e
        square = sheet.named("a_square", omega_r**2 + self.b * v_r**2)
        root = math.sqrt(math.if_else(square > 0.0, square, 1.0))  # whose rate is finite at rest
        k = sheet.named("k_a", 2.0 * self.zeta * math.if_else(square > 0.0, root, 0.0))
        turn = self.b * v_r * x2 * math.sinc(x3) + k * x3
        v_d = sheet.named("v_d", v_r * math.cos(x3) + k * x1)
        return v_d, sheet.named("omega_d", omega_r + turn)
