"""Commands that come at any time, and hold until the next."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from rpctl.arrays import Array

TIME_ROUNDING = 1e-9  # s: rounding of a sample's time


class HeldCommands:
    """Efforts or speeds that hold until others come.

    Args:
        first: The first ones.
    """

    def __init__(self, first: Array) -> None:
        self._held = first
        self._coming = deque[tuple[float, Array]]()

    def send(self, at: float, command: Array) -> None:
        """Send what comes at a time (s), later than those sent before."""
        self._coming.append((at, command))

    def at(self, t: float) -> Array:
        """Return what holds from a time (s) on."""
        while self._coming and self._coming[0][0] <= t + TIME_ROUNDING:
            self._held = self._coming.popleft()[1]
        return self._held

    def during(self, t: float, duration: float) -> Iterator[tuple[float, Array]]:
        """Yield how long (s) what holds, from a time (s) on for a duration (s)."""
        left = duration
        while self._coming and self._coming[0][0] < t + left - TIME_ROUNDING:
            at = self._coming[0][0]
            held = self.at(t)
            if at > t + TIME_ROUNDING:
                yield at - t, held
                t, left = at, left - (at - t)
            self.at(at)
        yield left, self.at(t)
