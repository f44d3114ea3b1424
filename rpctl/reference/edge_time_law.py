"""The time law of a table: its own time, but for a soft start and stop of data in motion."""

from __future__ import annotations

from typing import NamedTuple

from rpctl.reference.paths import PathTime, ramped_time

EDGE_TIME = 1.0  # s; duration of the start and the stop of data that begin or end in motion
# Of u⁴..u⁷: zero with three derivatives at 0, and 1, 1, 0, 0 at 1.
CATCH_UP_COEFFICIENTS = 20.0, -45.0, 36.0, -10.0


class EdgeTimeLaw(NamedTuple):
    """s(t) = t, but at rest where data begin or end in motion.

    Data that start in motion are reached from rest within ``edge`` seconds: s = edge f(t/edge),
    with f of degree 7 from rest (three zero derivatives) to rate one, on time. The last ``edge``
    seconds of data that end in motion take twice as long while the rate falls to zero. Every
    recorded pose is passed.
    """

    end: float
    soft_start: bool
    soft_end: bool
    edge: float

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""
        return self.end + self.edge if self.soft_end else self.end

    def __call__(self, t: float) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s)."""
        left = self.duration - t
        if t <= 0.0 or left <= 0.0:
            return PathTime(0.0 if t <= 0.0 else self.end, 0.0, 0.0)
        if self.soft_start and t < self.edge:
            f, rate, bend = _catch_up_profile(t / self.edge)
            return PathTime(self.edge * f, rate, bend / self.edge)
        if self.soft_end and left < 2.0 * self.edge:
            s, rate, change = ramped_time(left, 1.0, 2.0 * self.edge)
            return PathTime(self.end - s, rate, -change)
        return PathTime(t, 1.0, 0.0)


def _catch_up_profile(u: float) -> tuple[float, float, float]:
    a, b, c, d = CATCH_UP_COEFFICIENTS
    return (
        u**4 * (a + u * (b + u * (c + u * d))),
        u**3 * (4 * a + u * (5 * b + u * (6 * c + u * 7 * d))),
        u**2 * (12 * a + u * (20 * b + u * (30 * c + u * 42 * d))),
    )
