"""Path error and lag: how far a point was from its reference's path, and how far behind on it.

The error against time mixes the two: a robot that slows down to keep its limits is far from where
the reference is now, and yet on the path.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array

STANDING_SPEED = 1e-4  # m/s: a slower reference stands, and nobody falls behind it


@dataclass(frozen=True, eq=False, repr=False)
class PathTrace:
    """A motion of K samples beside the path of its reference.

    Attributes:
        error: Distance to the nearest point of the path (K,), m.
        lateral: Its part across the path (K,), m, positive where the path lies to the left, as the
            lateral tracking error is; zeros for a path in space.
        lag: How long the reference takes from there to where it is now (K,), s; negative ahead of
            it. Time in which it stands does not count.
        lag_distance: How far that is along the path (K,), m.
        length: Length of the path, m.
    """

    error: Array
    lateral: Array
    lag: Array
    lag_distance: Array
    length: float


@dataclass(frozen=True)
class PathFigures:
    """Path error and lag of a run in numbers; ``settled`` is the largest over its second half.

    Attributes:
        rms: Root mean square of the distance to the path, m.
        final: That distance at the end, m.
        settled: Its largest over the second half, m.
        mean_lateral: Mean of its lateral part over the second half, m, positive where the path
            lies to the left; None for a path in space.
        final_lag: How long the reference takes from the nearest point to where it is at the end,
            s; negative ahead of it.
        final_lag_distance: How far that is along the path, m.
        largest_lag: The largest lag, s; 0 if the reference was never behind.
        largest_lag_distance: The largest lag along the path, m.
        length: Length of the path, m.
    """

    rms: float
    final: float
    settled: float
    mean_lateral: float | None
    final_lag: float
    final_lag_distance: float
    largest_lag: float
    largest_lag_distance: float
    length: float


def path_figures(trace: PathTrace, planar: bool) -> PathFigures:
    """Return path error and lag in numbers.

    Args:
        trace: The motion beside its path.
        planar: Whether the path lies in the plane, so that it has a left side.
    """
    half = len(trace.error) // 2
    return PathFigures(
        rms=float(np.sqrt(np.mean(np.square(trace.error)))),
        final=float(trace.error[-1]),
        settled=float(trace.error[half:].max()),
        mean_lateral=float(trace.lateral[half:].mean()) if planar else None,
        final_lag=float(trace.lag[-1]),
        final_lag_distance=float(trace.lag_distance[-1]),
        largest_lag=float(trace.lag.max(initial=0.0)),
        largest_lag_distance=float(trace.lag_distance.max(initial=0.0)),
        length=trace.length,
    )


def trace_path(t: Array, actual: Array, reference: Array) -> PathTrace:
    """Return the path error and the lag of a point at every sample.

    The path is the polygon through the reference's samples. Where it crosses itself, the nearest
    point of all of it may be on another branch, so only a window of it is searched. The window
    begins where the point was last, or where the reference is now if that is farther back: it
    moves forward only, and a robot that is ahead may wait or return. It ends π times the distance
    to the last point further on, half a circle about the robot: a path that bends no tighter comes
    nearer within it or not at all. The reference's own place counts besides, so that the path error
    never exceeds the error against time.

    Args:
        t: Time (K,), s.
        actual: Positions of the point (K, d), m; d is 1 to 3.
        reference: Positions of its reference (K, d), m.

    Returns:
        Path error, its lateral part, and the lag; NaN where a position is not finite.
    """
    sides = np.diff(reference, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    places = _progress(actual, reference, sides, lengths, arc)
    error = np.linalg.norm(actual - _along(arc, reference, places), axis=1)
    now = np.linalg.norm(actual - reference, axis=1)
    places = np.where(now < error, arc, places)
    moving = lengths > STANDING_SPEED * np.diff(t)
    clock = np.concatenate([[0.0], np.cumsum(np.where(moving, np.diff(t), 0.0))])
    bad = np.where(np.isfinite(now), 0.0, np.nan)
    return PathTrace(
        error=np.fmin(error, now) + bad,
        lateral=_lateral(actual, _along(arc, reference, places), sides, arc, places) + bad,
        lag=clock - np.interp(places, arc, clock) + bad,
        lag_distance=arc - places + bad,
        length=float(arc[-1]),
    )


def _progress(actual: Array, reference: Array, sides: Array, lengths: Array, arc: Array) -> Array:
    """Return the arc length (K,), m, of the nearest point within the moving window."""
    path = _Polygon(reference, sides, lengths, np.where(lengths > 0.0, lengths**2, 1.0))
    arcs, last = arc.tolist(), len(sides)
    places = np.zeros(len(actual))
    place, point = 0.0, reference[0].tolist()
    for k, there in enumerate(actual if last else ()):
        here = there.tolist()
        gap = math.dist(here, point)
        if math.isfinite(gap):
            lower = min(place, arcs[k])
            first = min(bisect_right(arcs, lower) - 1, last - 1)
            end = min(max(bisect_left(arcs, place + math.pi * gap), first + 1), last)
            j, share, point = _nearest(path, here, first, end, lower - arcs[first])
            place = arcs[j] + share * float(lengths[j])
        places[k] = place
    return places


class _Polygon(NamedTuple):
    """The path of a reference: corners, sides, their lengths, and the squares of these, or 1."""

    corners: Array
    sides: Array
    lengths: Array
    squares: Array


def _nearest(
    path: _Polygon, here: list[float], first: int, end: int, lower: float
) -> tuple[int, float, list[float]]:
    """Return the nearest point on sides ``first`` to ``end``: the side, the share of it, the point.

    Args:
        path: The path.
        here: From where (d,), m.
        first: The first side.
        end: The one after the last.
        lower: How far along the first side the point lies at least, m.
    """
    starts, along = path.corners[first:end], path.sides[first:end]
    share = np.einsum("ij,ij->i", np.array(here) - starts, along) / path.squares[first:end]
    share[0] = max(share[0], lower / (float(path.lengths[first]) or 1.0))
    np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
    points = starts + share[:, None] * along
    away = np.array(here) - points
    j = int(np.einsum("ij,ij->i", away, away).argmin())
    return first + j, float(share[j]), points[j].tolist()


def _along(arc: Array, reference: Array, places: Array) -> Array:
    """Return the points (K, d) of the path at arc lengths (K,), m."""
    return np.column_stack([np.interp(places, arc, column) for column in reference.T])


def _lateral(actual: Array, points: Array, sides: Array, arc: Array, places: Array) -> Array:
    """Return how far to the left of a motion in the plane its path lies (K,), m."""
    if actual.shape[1] != 2 or not arc[-1] > 0.0:
        return np.zeros(len(actual))
    first = int(np.searchsorted(arc, 0.0, "right")) - 1  # the side with which the motion starts
    side = sides[np.maximum(np.searchsorted(arc, places, "left") - 1, first)]
    away = points - actual
    cross = side[:, 0] * away[:, 1] - side[:, 1] * away[:, 0]
    return np.asarray(cross / np.linalg.norm(side, axis=1))


def length(value: float) -> str:
    """Return a length, given in m, as text in m, mm or µm."""
    for unit, size in (("m", 1.0), ("mm", 1e-3)):
        if abs(value) >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} µm" if value else "0 m"


def lag(time: float, distance: float) -> str:
    """Return a lag, given in s and in m along the path, as text."""
    return f"{time + 0.0:.2f} s ({length(distance)})"
