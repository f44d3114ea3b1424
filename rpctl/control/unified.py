"""The unified predictive law: one law for lines, turns, reverse and spins."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking, Twist
from rpctl.control.kinematic import coupled
from rpctl.control.twist_law import BaseLaw
from rpctl.files.records import POSITIVE, POSITIVE_OR_NONE, WITHIN, Setting
from rpctl.reference.motion import ReferenceState


@dataclass(frozen=True)
class UnifiedKinematic(BaseLaw):
    """The paper's law with a lateral error that is predicted to second order.

    A turn shows in the lateral error only in its second derivative. With d = ω_d − ω_r, the
    reference's speed v taken as steady over the horizon h, and x1 left to its own output,

        x2 + h ẋ2 + ½ h² ẍ2 = p2 − a d,    p2 = x2 + h v sin x3,    a = ½ h² v cos x3
        x3 + h ẋ3           = x3 − h d

    One input cannot make both vanish, so the weights count: J = ½ W2 (p2 − a d)² + ½ W3 (x3 − h d)²
    is least at

        d = (a p2 + w h x3)/(a² + w h²),    w = W3/W2

    and v_d follows from the output x1 − β s x2 as in the paper's law, with the smooth sign
    s = ω_r/√(ω_r² + κ² v_r²): it passes through zero where a curve changes its side, but is ±1 on a
    spin however slow, where no other term moves the lateral error. At rest the reference's
    direction decides, so s does not jump when a motion starts.

    Facing more than a right angle away, a turn to the reference would come out as one to the other
    side: a is 0 there, and the heading turns back as in the paper's law. With that v a ≥ 0, and the
    reference is the only equilibrium; with a's own sign there are others, facing away from it.

    Near the reference d = K2 x2 + K3 x3 with

        K2 = ½ v/D,    K3 = (½ h v² + w/h)/D,    D = ¼ h² v² + w

    and on the output's zero (ẋ2, ẋ3) = [[−β s ω, v], [−K2, −K3]] (x2, x3). Its trace is negative
    and its determinant ½ v²/D + β s ω K3 positive, for every w, h > 0 and every steady
    (v, ω) ≠ 0: forward, reverse and spin alike. On a line the sampled law (zero-order hold) is
    stable for T < 2/K3, which lies between h and 2h; on a spin it is the paper's.

    A term ½ h² v̇ sin x3 in p2 would foresee changes of the speed, but ν̇_d would then need v̈, which
    a reference does not give. On figure-eights of 6 to 20 s a lap it changed the rms error by less
    than 1 %.
    """

    horizon: Annotated[float, POSITIVE, Setting("s", "Horizon h", "Prediction time h.")] = 0.65
    beta: Annotated[
        float,
        WITHIN,
        Setting(
            "",
            "β",
            "Weight of the lateral error in the longitudinal output. On a spin it decays at β |ω|, "
            "and x1 = ±β x2 costs on the way: from β = 1 on, faster is no longer nearer.",
        ),
    ] = 1.25
    bend: Annotated[
        float,
        POSITIVE_OR_NONE,
        Setting(
            "1/m",
            "",
            "κ: the curvature from which on a path counts as a turn; 0 is the paper's sign.",
        ),
    ] = 0.5
    weight: Annotated[
        float,
        POSITIVE,
        Setting(
            "m²/rad²",
            "",
            "w: the square of the lateral error that counts as much as one radian.",
        ),
    ] = 0.02
    leash: Leash | None = field(default_factory=Leash, kw_only=True)
    approach: Approach | None = field(default_factory=Approach, kw_only=True)

    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist to ask of a base that cannot move sideways."""
        h, w, (state, x, x_dot) = self.horizon, self.weight, tracking
        v, v_dot = state.twist[0], state.twist_dot[0]
        cos, sin = math.cos(x[2]), math.sin(x[2])
        p2 = x[1] + h * v * sin
        p2_rate = x_dot[1] + h * (v_dot * sin + v * cos * x_dot[2])
        a, a_rate = 0.0, 0.0
        if cos > 0.0:
            a = 0.5 * h**2 * v * cos
            a_rate = 0.5 * h**2 * (v_dot * cos - v * sin * x_dot[2])
        size = a**2 + w * h**2
        d = (a * p2 + w * h * x[2]) / size
        d_rate = (a_rate * p2 + a * p2_rate + w * h * x_dot[2] - 2.0 * d * a * a_rate) / size
        turn = state.twist[2] + d, state.twist_dot[2] + d_rate
        return coupled(tracking, turn, self._beta_sign(state), h)

    def _beta_sign(self, state: ReferenceState) -> tuple[float, float]:
        """Return β s and its derivative."""
        vectors = (state.twist, state.twist_dot) if state.direction is None else state.direction
        (v, _, omega), (a, _, alpha) = vectors[0], vectors[1]
        size = math.hypot(omega, self.bend * v)
        if size == 0.0:
            return 0.0, 0.0
        rate = self.bend**2 * v * (alpha * v - omega * a) / size**3
        return self.beta * omega / size, self.beta * rate
