"""A reference along a path, with a time law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import Path, PathPoint, PathTime, steady
from rpctl.reference.pointwise import Numbers, beside, entries, split_rows, stack_rows, vector
from rpctl.reference.sizing import Sizing
from rpctl.reference.splines import Curves


class TimeLaw(Protocol):
    """s(t) with two derivatives, and the duration of its motion."""

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""

    def __call__(self, t: Numbers) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s), or at times (K,)."""


@dataclass(frozen=True)
class TimedPath:
    """Base and arm as functions of one path parameter s, and a time law s(t).

    Attributes:
        path: The base's path.
        arm: Positions of the joints (n_joints,) by s.
        time_law: s(t).
        travel_direction: Direction of travel by s, or by many, that does not vanish where the path
            stands still; None takes the path's own.
        sizing: How large and fast it is, and why; None where a file says it.
    """

    path: Path = field(repr=False)
    arm: Curves = field(repr=False)
    time_law: TimeLaw = field(repr=False)
    travel_direction: Callable[[Numbers], Array] | None = field(default=None, repr=False)
    sizing: Sizing | None = None

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""
        return self.time_law.duration

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at time ``t`` (s), or at times (K,), a row each."""
        return self.at(self.time_law(t))

    def at(self, path_time: PathTime) -> ReferenceState:
        """Return the reference where the path parameter is s, with these derivatives by time."""
        s, *rates = path_time
        point, (ds, dds) = self.path(s), map(beside, rates)
        along, bend, _ = split_rows(point.direction)
        joints, slope, curve = self.arm(s)
        toward, change, twice = split_rows(
            point.direction if self.travel_direction is None else self.travel_direction(s)
        )
        return ReferenceState(
            point.pose,
            along * ds,
            bend * ds**2 + along * dds,
            joints,
            slope * ds,
            curve * ds**2 + slope * dds,
            stack_rows(toward, change * ds, twice * ds**2 + change * dds),
        )


class Stretched:
    """A time law run in another time, from rest to rest as before.

    Args:
        law: The time law.
        duration: Its new duration, s.
    """

    def __init__(self, law: TimeLaw, duration: float) -> None:
        self._law, self.duration = law, duration
        self._pace = law.duration / duration

    def __call__(self, t: Numbers) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s), or at times (K,)."""
        s, rate, acceleration = self._law(self._pace * t)
        return PathTime(s, self._pace * rate, self._pace**2 * acceleration)


def slowed(reference: TimedPath, factor: float) -> TimedPath:
    """Return a reference that runs ``factor`` times slower."""
    law = reference.time_law
    return replace(reference, time_law=Stretched(law, factor * law.duration))


def still(pose: Array) -> Path:
    """Return the path of a base that stays at a pose (3,)."""

    def at(s: Numbers) -> PathPoint:
        return PathPoint(vector(s, entries(pose)), steady(s, 0.0, 0.0))

    return at


def constant(values: Array, start: float, end: float) -> Curves:
    """Return constant curves.

    Args:
        values: Their values (n,).
        start: First s.
        end: Last s.
    """
    return Curves(BSpline(np.repeat([start, end], 3), np.tile(values, (3, 1)), 2))


def along(path: Path, s: Array) -> Array:
    """Return a path's direction and its first derivative by s at points (N,): (N, 2, 3)."""
    return path(s).direction[:, :2]
