"""The clock by which the horizon law reads its reference: it waits for a base that falls behind."""

from __future__ import annotations

import math

from rpctl.description.records import Array
from rpctl.reference.motion import Reference

SLOW = 1e-2  # m/s: a reference slower than this is not waited for, it hardly moves
PASSES = 3  # Newton steps to the lag; each sample starts at the last one's


class Clock:
    """Reads a reference late where the base is farther behind it than a leash allows.

    The lag ℓ ≥ 0 is the least at which (p_r(t − ℓ) − p) · v_r/|v_r| ≤ leash; it grows no faster
    than time, so that the reference waits but never runs back.

    Args:
        leash: m.
    """

    def __init__(self, leash: float) -> None:
        self._leash, self._lag, self._then = leash, 0.0, 0.0
        self.largest = 0.0

    def __call__(self, reference: Reference, t: float, pose: Array) -> float:
        """Return the time (s) at which to read the reference, for the base at ``pose`` (3,)."""
        most = self._lag + max(t - self._then, 0.0)
        lag = self._lag
        for _ in range(PASSES):
            state = reference(t - lag)
            cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
            vx, vy, _ = state.twist
            speed = math.hypot(vx, vy)
            if speed < SLOW:
                break
            x, y = state.pose[0] - pose[0], state.pose[1] - pose[1]
            behind = (x * (cos * vx - sin * vy) + y * (sin * vx + cos * vy)) / speed
            lag = min(max(lag + (behind - self._leash) / speed, 0.0), most)
        self._lag, self._then = lag, t
        self.largest = max(self.largest, lag)
        return t - lag
