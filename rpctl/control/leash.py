"""A leash on the tracking error: far errors ask no more of a law than near ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import BASE_ERRORS, Tracking
from rpctl.errors import require_positive

SERIES_RADIUS = 1e-2  # of u: below it the series of g(u) is exact to rounding, its quotient is not


@dataclass(frozen=True)
class Leash:
    """A smooth bound of the base's error, with its exact rate.

    v_d of a kinematic law contains x2 ω_d, which grows with the square of the error: far from its
    reference a robot is asked for speeds that it has not. With p = (x1, x2) and u = |p|/L the law
    is given

        p' = p tanh(u)/u,    x3' = T tanh(x3/T)

    and their derivatives along the motion, so that ν̇_d stays analytic:

        ṗ' = ṗ tanh(u)/u + p (p·ṗ) g(u)/L²,    g(u) = (sech² u − tanh(u)/u)/u²,
        ẋ3' = ẋ3 sech²(x3/T)

    The direction of p stays. Errors much smaller than the leash pass as they are, to third order:
    the law near its reference is what it was.

    Attributes:
        distance: L, m: the position error that a law is given stays below it.
        heading: T, rad: so does the heading error.
    """

    distance: float = 0.3
    heading: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a leash without length."""
        for name in ("distance", "heading"):
            require_positive(name, getattr(self, name))

    def __call__(self, tracking: Tracking) -> Tracking:
        """Return a tracking error on the leash, and its rate; joints' errors pass as they are."""
        state, e, e_dot = tracking
        position, position_rate = self.position(e[:2], e_dot[:2])
        turn = math.tanh(e[2] / self.heading)
        angle, angle_rate = self.heading * turn, (1.0 - turn**2) * e_dot[2]
        rest = slice(BASE_ERRORS, None)
        return Tracking(
            state,
            np.concatenate([position, [angle], e[rest]]),
            np.concatenate([position_rate, [angle_rate], e_dot[rest]]),
        )

    def position(self, p: Array, p_dot: Array) -> tuple[Array, Array]:
        """Return a position error (2,), m, on the leash, and its rate (2,), m/s.

        Args:
            p: Position error (2,), m.
            p_dot: Its rate (2,), m/s.
        """
        u = math.hypot(p[0], p[1]) / self.distance
        if u < SERIES_RADIUS:
            scale, bend = 1.0 - u**2 / 3.0 + 2.0 * u**4 / 15.0, -2.0 / 3.0 + 8.0 * u**2 / 15.0
        else:
            scale = math.tanh(u) / u
            bend = (1.0 - math.tanh(u) ** 2 - scale) / u**2
        along = float(p @ p_dot) / self.distance**2
        return scale * p, scale * p_dot + bend * along * p
