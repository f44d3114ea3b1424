"""Time laws: as fast as limits allow, softly from rest to rest; or a table's own time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.caps import cap, how_to_raise
from rpctl.reference.formula import Along, Columns, Numbers
from rpctl.reference.paths import DEGREE, PathTime, quintic, uniform_knots

KNOT_SPACING = 0.15  # s; spacing of the time law's knots: accelerations change over about three
SAMPLES_PER_KNOT = 4  # points a knot interval where the limits are checked again
SLOWDOWN_GUARD = 1.002  # limits are checked at points, and may be exceeded between them
UNLIMITED_RATE = 100.0  # 1/s: rate where nothing limits it, relative to the path's range
EDGE_TIME = 1.0  # s; duration of the start and the stop of data that begin or end in motion


class Bound(NamedTuple):
    """Limits of one coordinate c(s): |c' ṡ| ≤ speed and |c'' ṡ² + c' s̈| ≤ acceleration.

    An effort is bounded likewise, with what it takes of ṡ² and of s̈ as ``bend`` and ``slope``.
    """

    slope: Array  # (N,) c'
    bend: Array  # (N,) c''
    speed: float
    acceleration: float | Array = math.inf  # or (N,)


class TimeLaw:
    """s(t): at rest before it begins and after its end.

    Args:
        s: Returns s, a scalar on a sheet, at a time of its own, which begins at 0.
        end: The last of these times, s.
        duration: How long it takes to run through it, s; None: as long as that.
    """

    def __init__(
        self, s: Callable[[Along, Any], Any], end: float, duration: float | None = None
    ) -> None:
        self._s, self._end = s, end
        self.duration = end if duration is None else duration

    def lasting(self, duration: float) -> TimeLaw:
        """Return the same motion in another time, s."""
        return TimeLaw(self._s, self._end, duration)

    @cached_property
    def columns(self) -> Columns:
        """What it returns, (3,), by time."""
        at, end = Along(), self.duration
        within = casadi.if_else(at.x <= 0.0, 0.0, casadi.if_else(at.x >= end, end, at.x))
        pace = self._end / end if end else 0.0
        return at.columns(at.orders([self._s(at, pace * within)]))

    def __call__(self, t: Numbers) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s), or at times (K,)."""
        return PathTime(*self.columns(t).T)


AT_REST = TimeLaw(lambda at, t: casadi.SX(0.0), 0.0)


def recorded_time(end: float, soft_start: bool, soft_end: bool) -> TimeLaw:
    """Return s(t) = t up to a table's end (s), but at rest where its data begin or end in motion.

    Data that start in motion are reached from rest within ``EDGE_TIME``, by a polynomial of degree
    7 from rest (three zero derivatives) to rate one, on time. The last ``EDGE_TIME`` of data that
    end in motion takes twice as long while the rate falls to zero. Every recorded pose is passed.
    """
    edge = min(EDGE_TIME, 0.4 * end)

    def s(at: Along, t: Any) -> Any:
        found = t
        if soft_start:
            found = casadi.if_else(t < edge, edge * _from_rest(t / edge, 1.0), found)
        if soft_end:
            left = end - edge * _from_rest(0.5 * (end + edge - t) / edge, 2.0)
            found = casadi.if_else(t > end - edge, left, found)
        return found

    return TimeLaw(s, end + edge if soft_end else end)


def _from_rest(u: Any, slope: float) -> Any:
    """Return the polynomial from 0, with three zero derivatives, to 1 at u = 1.

    Its slope is given there, its second and third derivatives are zero: u⁴ times the first terms of
    the series of (1 - slope w) / (1 - w)⁴ in w = 1 - u.
    """
    w = 1.0 - u
    series = (20.0 - 10.0 * slope) * w + 10.0 - 4.0 * slope
    return u**4 * (1.0 + w * (4.0 - slope + w * series))


def max_squared_rate(s: Array, bounds: Sequence[Bound]) -> Array:
    """Return the largest ṡ² (N,) that bounds allow along a path, from rest to rest.

    In x = ṡ², with s̈ = ½ dx/ds, every bound is linear, and the largest of two profiles that keep
    them keeps them too. So one linear program, maximise Σ x, gives the largest at every point.

    Args:
        s: Points of the path (N,), uniform.

    Raises:
        RpctlError: No motion keeps the limits.
    """
    top = np.full(len(s), (UNLIMITED_RATE * (s[-1] - s[0])) ** 2)
    for bound in bounds:
        steep = np.abs(bound.slope) > 1e-12
        top[steep] = np.minimum(top[steep], (bound.speed / bound.slope[steep]) ** 2)
    top[[0, -1]] = 0.0
    rows, right = _accelerations(s, bounds)
    found = linprog(-np.ones(len(s)), rows, right, bounds=np.column_stack([np.zeros(len(s)), top]))
    if found.x is None:
        raise RpctlError(f"no time law satisfies the limits: {found.message}")
    return np.maximum(found.x, 0.0)


def _accelerations(s: Array, bounds: Sequence[Bound]) -> tuple[coo_array | None, Array | None]:
    """Return the linear inequalities on ṡ² that accelerations set.

    Between two points s̈ is constant, and every bound is kept with it at both of them.
    """
    count, step = len(s) - 1, s[1] - s[0]
    here = np.arange(count)
    entries: list[tuple[Any, Any, Any]] = []  # values, rows, columns
    rights: list[Array] = []
    for bound in bounds:
        most = np.broadcast_to(bound.acceleration, len(s))
        if np.isinf(most).all():
            continue
        for sign in (1.0, -1.0):
            for end in (0, 1):
                slope = sign * bound.slope[here + end] * 0.5 / step
                bend = sign * bound.bend[here + end]
                row = here + len(rights) * count
                entries.append((-slope + bend * (1 - end), row, here))
                entries.append((slope + bend * end, row, here + 1))
                rights.append(most[here + end])
    if not rights:
        return None, None
    values, rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
    shape = (len(rights) * count, len(s))
    return coo_array((values, (rows, columns)), shape=shape).tocsr(), np.concatenate(rights)


def time_law(s: Array, bounds: Sequence[Bound]) -> TimeLaw:
    """Return the fastest smooth time law of a path within bounds.

    The fastest motion's accelerations jump; as the coefficients of a uniform quintic spline its
    samples give a motion with smooth ones, whose speeds and accelerations are means of the
    fastest's. What these means still exceed is kept by running all of it slower.

    Args:
        s: Points of the path (N,), uniform.

    Raises:
        RpctlError: No motion keeps the limits.
    """
    rate = np.sqrt(max_squared_rate(s, bounds))
    pace = 0.5 * (rate[1:] + rate[:-1])
    times = np.concatenate([[0.0], np.cumsum(np.diff(s) / np.maximum(pace, 1e-12))])
    most = cap("MAX_REFERENCE_SECONDS")
    if times[-1] > most:
        raise RpctlError(
            f"the path takes {times[-1]:.3g} s at these limits, and {most} s are allowed at most; "
            "shorten it or raise the limits of speed and acceleration; "
            f"{how_to_raise('MAX_REFERENCE_SECONDS')}"
        )
    count = max(2, math.ceil(times[-1] / KNOT_SPACING))
    samples = _positions(np.linspace(0.0, times[-1], count + 1), times, s, rate)
    ends = np.ones(DEGREE - 1)
    values = np.concatenate([s[0] * ends, samples, s[-1] * ends])
    knots = uniform_knots(len(values)) * times[-1] / count
    spline = quintic(knots, values)
    law = TimeLaw(lambda at, t: at.spline(spline, t)[0], float(knots[len(values)]))
    return law.lasting(law.duration * max(1.0, SLOWDOWN_GUARD * _slowdown(law, s, bounds)))


def _positions(t: Array, times: Array, s: Array, rate: Array) -> Array:
    """Return s at times ``t``, accelerations constant between the path's points."""
    index = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(s) - 2)
    share = (t - times[index]) / (times[index + 1] - times[index])
    first, last = rate[index], rate[index + 1]
    mean = 0.5 * (first + last)
    weight = np.divide(
        first * share + 0.5 * (last - first) * share**2, mean, where=mean > 0, out=share.copy()
    )
    return s[index] + weight * (s[index + 1] - s[index])


def _slowdown(timing: TimeLaw, s: Array, bounds: Sequence[Bound]) -> float:
    """Return the factor by which a time law must slow down for the bounds; 1 or less: none."""
    count = SAMPLES_PER_KNOT * max(2, round(timing.duration / KNOT_SPACING))
    at, rate, acceleration = timing(np.linspace(0.0, timing.duration, count))
    worst = 0.0
    for bound in bounds:
        slope, bend = np.interp(at, s, bound.slope), np.interp(at, s, bound.bend)
        speed = np.abs(slope * rate).max() / bound.speed
        most = np.interp(at, s, np.broadcast_to(bound.acceleration, len(s)))
        change = (np.abs(bend * rate**2 + slope * acceleration) / most).max()
        worst = max(worst, float(speed), math.sqrt(float(change)))
    return worst
