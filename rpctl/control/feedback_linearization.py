"""Dynamic feedback linearisation: a baseline."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from rpctl.control.approach import Approach
from rpctl.control.error import Leash, Tracking, Twist
from rpctl.control.twist_law import BaseLaw
from rpctl.errors import UnfitLawError
from rpctl.files.records import POSITIVE, Setting
from rpctl.reference.motion import ReferenceState

SPIN_RADIUS = 1e-6  # m; a reference that turns about a point nearer than this spins


@dataclass(frozen=True)
class FeedbackLinearization(BaseLaw):
    """The law of [ODV02]: P's acceleration as the input of a linear loop.

    With z = P's position error and u = z̈_r + kd ż + kp z, seen in the robot's axes,

        v̇_d = u₁,    ω_d = u₂/v

    gives v̇ = u₁ and v ω = u₂, which is P's acceleration, and so z̈ + kd ż + kp z = 0. The paper
    integrates v̇_d in a compensator whose state ξ is the speed it asks for. Here the robot's own
    speed is that state: v_d = v, so that the dynamic law has v̇_d alone to follow and does so
    exactly. The law remembers nothing.

    At v = 0 the law is singular: P cannot be accelerated sideways. The paper asks for references
    whose speed never vanishes, and for initial errors that keep the robot's from vanishing. Ours
    start from rest, so below v₀ 1/v is v/v₀²: there the robot turns less than it should. A spin
    says nothing about where to head for, and is refused. Heading is no output: where u points
    backwards for long enough the robot turns round and follows in reverse.

    ω̇_d contains v̈_r sin x3/v. A reference does not give v̈_r: it is taken from the direction, which
    is exact while the pace is steady; what a soft start adds is left out.
    """

    horizon: Annotated[
        float,
        POSITIVE,
        Setting("s", "Horizon h", "Prediction time of the arm and of an omnidirectional base."),
    ] = 0.65
    kp: Annotated[float, POSITIVE, Setting("1/s²", "", "Gain of the position error.")] = 1.0
    kd: Annotated[float, POSITIVE, Setting("1/s", "", "Gain of its rate.")] = 2.0
    slowest: Annotated[
        float, POSITIVE, Setting("m/s", "", "v₀: from this speed on the law is exact.")
    ] = 0.2
    leash: Leash | None = field(default_factory=Leash, kw_only=True)
    approach: Approach | None = field(default_factory=Approach, kw_only=True)

    def leashed(self, tracking: Tracking) -> Tracking:
        """Return the error as it is: the law reads the robot's own speed off it.

        Only the feedback of the position error is on the leash.
        """
        return tracking

    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist of a base that cannot move sideways.

        Raises:
            UnfitLawError: The reference turns on the spot.
        """
        state, x, x_dot = tracking
        v_r, _, omega_r = state.twist
        a_r, _, alpha_r = state.twist_dot
        _refuse_spin(v_r, omega_r)
        cos, sin, turn = math.cos(x[2]), math.sin(x[2]), x_dot[2]
        omega = omega_r - turn
        v = v_r * cos + x[1] * omega - x_dot[0]  # what ẋ1 says of the robot's own speed
        z, z_dot = x[:2], x_dot[:2]
        if self.leash is not None:
            z, z_dot = self.leash.position(z, z_dot)
        across, across_rate = v_r * omega_r, a_r * omega_r + v_r * alpha_r
        u1 = a_r * cos - across * sin + self.kd * (v_r * cos - v) + self.kp * z[0]
        u2 = a_r * sin + across * cos + self.kd * v_r * sin + self.kp * z[1]
        u2_rate = (
            (_jerk(state) - across * turn) * sin
            + (a_r * turn + across_rate) * cos
            + self.kd * (a_r * sin + v_r * cos * turn)
            + self.kp * z_dot[1]
        )
        slow = abs(v) < self.slowest
        inverse = v / self.slowest**2 if slow else 1.0 / v
        slope = 1.0 / self.slowest**2 if slow else -1.0 / v**2
        return Twist(
            np.array([v, 0.0, u2 * inverse]),
            np.array([u1, 0.0, u2_rate * inverse + u2 * slope * u1]),
        )


def _jerk(state: ReferenceState) -> float:
    """Return v̈_r of a reference that keeps its pace along its direction."""
    if state.direction is None or not state.direction[0].any():
        return 0.0
    along, _, twice = state.direction
    return float(twice[0] * (state.twist @ along) / (along @ along))


def _refuse_spin(v_r: float, omega_r: float) -> None:
    if abs(v_r) < SPIN_RADIUS * abs(omega_r):
        raise UnfitLawError(
            "the reference turns on the spot, where feedback linearisation does not know which way "
            "to head; take --kinematic unified"
        )
