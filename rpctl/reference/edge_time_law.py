"""The time law of a table: its own time, but for a soft start and stop of data in motion."""

from __future__ import annotations

from typing import NamedTuple

from rpctl.reference.paths import PathTime, ramped_time
from rpctl.reference.pointwise import Numbers, choose

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

    def __call__(self, t: Numbers) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s), or at times (K,)."""
        return choose(t <= 0.0, t, lambda t: PathTime(0.0 * t, 0.0, 0.0), self._begun)

    def _begun(self, t: Numbers) -> PathTime:
        starts = (t < self.edge) & (t < self.duration) & self.soft_start
        return choose(starts, t, self._starting, self._started)

    def _starting(self, t: Numbers) -> PathTime:
        f, rate, bend = _catch_up_profile(t / self.edge)
        return PathTime(self.edge * f, rate, bend / self.edge)

    def _started(self, t: Numbers) -> PathTime:
        stops = (self.duration - t < 2.0 * self.edge) & (t < self.duration) & self.soft_end
        return choose(stops, t, self._stopping, self._moving)

    def _stopping(self, t: Numbers) -> PathTime:
        s, rate, change = ramped_time(self.duration - t, 1.0, 2.0 * self.edge)
        return PathTime(self.end - s, rate, -change)

    def _moving(self, t: Numbers) -> PathTime:
        """Return the time itself; the end once that has passed."""
        return choose(
            self.duration - t <= 0.0,
            t,
            lambda t: PathTime(self.end + 0.0 * t, 0.0, 0.0),
            lambda t: PathTime(t, 1.0, 0.0),
        )


def _catch_up_profile(u: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    a, b, c, d = CATCH_UP_COEFFICIENTS
    square = u * u
    return (
        square * square * (a + u * (b + u * (c + u * d))),
        square * u * (4 * a + u * (5 * b + u * (6 * c + u * 7 * d))),
        square * (12 * a + u * (20 * b + u * (30 * c + u * 42 * d))),
    )
