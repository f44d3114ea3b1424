"""The motion that the referee asks of a robot: it sets off, turns, and brakes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.contact.plan import TICK_S, Course

LAST_SPEED_RATIO = 0.3  # of the top speed, after braking: it does not come to stand, where
# friction of joints would change its sign


@dataclass(frozen=True)
class RefereeCourse(Course):
    """Speeds rise in the first third and fall in the last; the rest moves in the middle half.

    Attributes:
        duration: s.
        tick: How long efforts are held, s.
    """

    duration: float = 3.0
    tick: float = TICK_S

    @property
    def peak(self) -> float:  # type: ignore[override]
        """Largest rate of what moves and stops, over its stroke, 1/s."""
        return 4.0 / self.duration

    def speeds(self, t: float, size: Array, rising: Array) -> tuple[Array, Array]:
        """Return ν and ν̇ (dof,) at a time.

        Args:
            t: s.
            size: Speeds (m/s) of what rises, strokes of what moves and stops (dof,).
            rising: What rises (dof,), true or false.
        """
        third, half = self.duration / 3.0, 0.5 * self.duration
        up, up_rate = _rise(t, third)
        down, down_rate = _rise(t - 2.0 * third, third)
        lost = 1.0 - LAST_SPEED_RATIO
        speed = up - lost * down, up_rate - lost * down_rate
        pulse = _pulse(t - 0.5 * half, half)
        nu, nu_dot = (size * np.where(rising, a, b) for a, b in zip(speed, pulse, strict=True))
        return nu, nu_dot


def _rise(t: float, length: float) -> tuple[float, float]:
    """Return a rise from 0 to 1 within a length of time (s), and its rate."""
    if not 0.0 < t < length:
        return float(t >= length), 0.0
    w = math.pi / length
    return 0.5 * (1.0 - math.cos(w * t)), 0.5 * w * math.sin(w * t)


def _pulse(t: float, length: float) -> tuple[float, float]:
    """Return a pulse of area 1 within a length of time (s), and its rate."""
    if not 0.0 < t < length:
        return 0.0, 0.0
    w = 2.0 * math.pi / length
    return (1.0 - math.cos(w * t)) / length, w * math.sin(w * t) / length
