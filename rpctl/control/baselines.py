"""Laws of others to compare with: Kanayama's, Samson's, and dynamic feedback linearisation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from rpctl import math
from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking
from rpctl.control.twist_law import BaseLaw
from rpctl.files.records import POSITIVE, Setting


@dataclass(frozen=True, kw_only=True)
class Kanayama(BaseLaw):
    """The law of [K90]:

        v_d = v_r cos x3 + Kx x1
        ω_d = ω_r + v_r (Ky x2 + Kθ sin x3)

    The paper assumes forward motion, where V = ½ (x1² + x2²) + (1 − cos x3)/Ky decreases:
    V̇ = −Kx x1² − v_r Kθ sin² x3/Ky. In reverse Kθ multiplies |v_r|, which is the same law seen from
    the robot's other end. In a spin v_r = 0, and the heading error remains.

    On a line x2 and x3 have the natural frequency √Ky |v_r| and the damping ratio Kθ/(2 √Ky); the
    default gains, as the paper's, give critical damping.
    """

    kx: Annotated[float, POSITIVE, Setting("1/s", "", "Gain Kx of the longitudinal error.")] = 1.5
    ky: Annotated[float, POSITIVE, Setting("1/m²", "", "Gain Ky of the lateral error.")] = 16.0
    ktheta: Annotated[float, POSITIVE, Setting("1/m", "", "Gain Kθ of the heading error.")] = 8.0
    leash: Leash | None = field(default_factory=Leash)
    approach: Approach | None = field(default_factory=Approach)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the desired speed (m/s) of P and turning rate (rad/s), two scalars."""
        (v_r, _, omega_r), (x1, x2, x3) = at.twist, at.e
        gain = at.sheet.named("K", self.ky * x2 + math.sign(v_r) * self.ktheta * math.sin(x3))
        v_d = at.sheet.named("v_d", v_r * math.cos(x3) + self.kx * x1)
        return v_d, at.sheet.named("omega_d", omega_r + v_r * gain)


@dataclass(frozen=True, kw_only=True)
class Samson(BaseLaw):
    """The nonlinear law of [SSVO09, Section 11.5.1]:

        v_d = v_r cos x3 + k x1
        ω_d = ω_r + b v_r x2 sin x3/x3 + k x3,    k = 2 ζ √(ω_r² + b v_r²)

    V = ½ b (x1² + x2²) + ½ x3² decreases: V̇ = −b k x1² − k x3². Near a steady reference the errors
    have the natural frequency √(ω_r² + b v_r²) and the damping ratio ζ, and the third pole is real.
    If the reference stands still, the gains vanish and the error remains.
    """

    b: Annotated[float, POSITIVE, Setting("1/m²", "Weight of the position error")] = 16.0
    zeta: Annotated[float, POSITIVE, Setting("", "Damping ratio")] = 0.7
    leash: Leash | None = field(default_factory=Leash)
    approach: Approach | None = field(default_factory=Approach)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the desired speed (m/s) of P and turning rate (rad/s), two scalars."""
        sheet, (v_r, _, omega_r), (x1, x2, x3) = at.sheet, at.twist, at.e
        square = sheet.named("a_square", omega_r**2 + self.b * v_r**2)
        root = math.sqrt(math.if_else(square > 0.0, square, 1.0))  # whose rate is finite at rest
        k = sheet.named("k_a", 2.0 * self.zeta * math.if_else(square > 0.0, root, 0.0))
        turn = self.b * v_r * x2 * math.sinc(x3) + k * x3
        v_d = sheet.named("v_d", v_r * math.cos(x3) + k * x1)
        return v_d, sheet.named("omega_d", omega_r + turn)


SPIN_RADIUS = 1e-6  # m; a reference that turns about a point nearer than this spins


@dataclass(frozen=True, kw_only=True)
class FeedbackLinearization(BaseLaw):
    """The law of [ODV02]: P's acceleration as the input of a linear loop.

    With z = P's position error and u = z̈_r + kd ż + kp z, seen in the robot's axes,

        v̇_d = u₁,    ω_d = u₂/v

    gives v̇ = u₁ and v ω = u₂, the components of P's acceleration, and thus z̈ + kd ż + kp z = 0. The
    paper integrates v̇_d in a compensator whose state ξ is the desired speed. Here the robot's speed
    is that state, v_d = v, so that the dynamic law follows v̇_d exactly and the law has no memory.

    At v = 0 the law is singular: P cannot accelerate sideways. The paper requires references whose
    speed never vanishes, and small initial errors. References here start from rest, so below v₀ the
    law uses v/v₀² instead of 1/v, and the robot turns less. The law refuses a spin, which has no
    direction of motion. The heading is not an output: if u points backward for long enough, the
    robot turns round and follows in reverse.

    ω̇_d contains v̈_r sin x3/v. A reference does not contain v̈_r: it follows from the reference's
    direction, which is exact at a constant pace; the contribution of a soft start is neglected.
    """

    kp: Annotated[float, POSITIVE, Setting("1/s²", "", "Gain of the position error.")] = 1.0
    kd: Annotated[float, POSITIVE, Setting("1/s", "", "Gain of its rate.")] = 2.0
    slowest: Annotated[
        float, POSITIVE, Setting("m/s", "", "v₀: above this speed the law is exact.")
    ] = 0.2
    leash: Leash | None = field(default_factory=Leash)
    approach: Approach | None = field(default_factory=Approach)

    refusal = (
        "the reference turns on the spot, where feedback linearisation is singular; take "
        "--kinematic unified"
    )

    def refuses(self, at: Tracking) -> Any:
        """Return whether the reference turns on the spot, a scalar; 0 is false."""
        v_r, _, omega_r = at.twist
        return math.fabs(v_r) < SPIN_RADIUS * math.fabs(omega_r)

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the desired speed (m/s) of P and turning rate (rad/s), two scalars.

        The leash bounds the position error, not the heading error.
        """
        sheet, (v_r, _, omega_r), a_r = at.sheet, at.twist, at.twist_dot[0]
        x1, x2, _ = at.e
        cos, sin = math.cos(at.error[2]), math.sin(at.error[2])
        sheet.moves(a_r, _jerk(at))
        v = sheet.symbol("v_d", at.own_twist[0])
        across = v_r * omega_r
        u1 = a_r * cos - across * sin + self.kd * (v_r * cos - v) + self.kp * x1
        u2 = a_r * sin + across * cos + self.kd * v_r * sin + self.kp * x2
        sheet.moves(v, sheet.named("u1", u1))
        slow = math.fabs(v) < self.slowest
        over = 1.0 / math.if_else(slow, self.slowest, v)
        inverse = math.if_else(slow, v / self.slowest**2, over)
        return v, sheet.named("omega_d", sheet.named("u2", u2) * inverse)


def _jerk(at: Tracking) -> Any:
    """Return v̈_r of a reference that keeps its pace along its direction."""
    square = sum(each**2 for each in at.direction)
    pace = sum(a * b for a, b in zip(at.twist, at.direction, strict=True)) / square
    return at.sheet.rate(at.sheet.rate(at.direction[0])) * pace
