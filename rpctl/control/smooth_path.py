"""Paths of bounded, smooth curvature from pose to pose: Dubins' [D57], steered without jumps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import root

from rpctl.arrays import Array
from rpctl.control.error import wrap
from rpctl.reference.paths import smooth_step

TURN = 2.0 * math.pi
LEFT, STRAIGHT, RIGHT = 1.0, 0.0, -1.0
ROUNDING = 1e-9  # rad: an arc that is shorter than a whole turn by less is none
GRID_M = 0.05  # m between the stored points of a path, of a bend of 1 m; less of sharper ones
GAUSS = np.polynomial.legendre.leggauss(4)  # exact to rounding on so short a piece
TOLERANCE = 1e-14  # of the lengths, relative
CLOSED = 1e-10  # m, rad: the path ends at its goal
CAUTION = 0.3  # of the lengths: the first step of the search for them
SHORTEST_PIECE = -1e-9  # m; a piece that comes out shorter does not exist


class Bends(NamedTuple):
    """Three pieces of constant curvature, one after the other."""

    curvatures: tuple[float, float, float]  # 1/m, positive to the left
    lengths: tuple[float, float, float]  # m


def shortest_paths(start: Array, goal: Array, radius: float) -> list[Bends]:
    """Return the paths of the six kinds that lead from a pose to another, the shortest first.

    Each has two or three arcs of the given radius: with a straight line between two of them, or
    three that alternate. One of them is the shortest path of all whose curvature stays below
    1/radius.

    Args:
        start: x, y (m) and heading (rad) (3,).
        radius: Of the arcs, m.
    """
    dx, dy = (float(goal[k] - start[k]) / radius for k in (0, 1))
    d, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
    a, b = wrap(start[2] - bearing), wrap(goal[2] - bearing)
    found = [
        Bends(
            tuple(side * turn / radius for turn in turns),  # type: ignore[arg-type]
            tuple(radius * length for length in lengths),  # type: ignore[arg-type]
        )
        for side in (1.0, -1.0)  # what turns right is the mirror image of what turns left
        for turns, lengths in _beginning_left(d, side * a, side * b)
    ]
    return sorted(found, key=lambda path: sum(path.lengths))


def _beginning_left(
    d: float, a: float, b: float
) -> Iterator[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Yield the turns and lengths, over the radius, of the paths that begin with a left turn.

    Args:
        d: Distance of the goal over the radius.
        a: Heading of the start from the direction to the goal, rad.
        b: That of the goal, likewise.
    """
    sines, cosines = math.sin(a) - math.sin(b), math.cos(a) - math.cos(b)
    along, apart = math.atan2(-cosines, d + sines), math.hypot(d + sines, cosines)
    yield (LEFT, STRAIGHT, LEFT), (_arc(along - a), apart, _arc(b - along))
    if apart <= 4.0:
        middle = TURN - 2.0 * math.asin(0.25 * apart)
        first = _arc(along - a + 0.5 * middle)
        yield (LEFT, RIGHT, LEFT), (first, middle, _arc(b - a - first + middle))
    x, y = d + math.sin(a) + math.sin(b), math.cos(a) + math.cos(b)
    if math.hypot(x, y) >= 2.0:
        line = math.sqrt(x**2 + y**2 - 4.0)
        along = math.atan2(-y, x) + math.atan2(2.0, line)
        yield (LEFT, STRAIGHT, RIGHT), (_arc(along - a), line, _arc(along - b))


def _arc(angle: float) -> float:
    """Return an angle within [0, 2π)."""
    angle %= TURN
    return 0.0 if angle > TURN - ROUNDING else angle


class SmoothPathPoint(NamedTuple):
    """A point of a path, and the curvature there with its derivatives by the path's length."""

    pose: Array  # (3,) x, y in m, heading in rad
    curvature: Array  # (3,) κ, κ′, κ″; 1/m, 1/m², 1/m³


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A path whose curvature changes at places, each time by a smooth step.

        κ(s) = κ_0 + Σ Δ_i S((s − s_i)/d),    S(u) = u³ (10 − 15 u + 6 u²) within (0, 1)

    The heading is its integral in closed form; the position is integrated once on a grid, and from
    the nearest grid point by Gauss's rule.

    Attributes:
        start: x, y (m) and heading (rad) (3,).
        curvature: κ_0, 1/m.
        steps: Δ_i (K,), 1/m.
        places: s_i (K,), m: where the steps begin.
        transition: d, m: how long a step is.
        length: m.
    """

    start: Array
    curvature: float
    steps: Array
    places: Array
    transition: float
    length: float

    @cached_property
    def grid(self) -> tuple[Array, Array]:
        """Lengths (n,), m, and the positions (n, 2), m, there."""
        sharpest = np.abs(np.cumsum([self.curvature, *self.steps])).max()
        # A search for lengths may try one below 0.
        count = math.ceil(abs(self.length) * max(sharpest, 1.0) / GRID_M) + 1
        grid = np.linspace(0.0, self.length, count + 1)
        moves = self._move(grid[:-1], grid[1:])
        return grid, self.start[:2] + np.vstack([np.zeros(2), np.cumsum(moves, axis=0)])

    def __call__(self, s: float) -> SmoothPathPoint:
        """Return the point at a length ``s`` (m) from the start."""
        grid, points = self.grid
        at = min(max(int(s / grid[1]), 0), len(grid) - 2)
        x, y = points[at] + self._move(grid[at : at + 1], np.array([s]))[0]
        rise = smooth_step(np.clip((s - self.places) / self.transition, 0.0, 1.0))
        slope, bend = rise.slope / self.transition, rise.bend / self.transition**2
        kappa = self.steps @ np.column_stack([rise.value, slope, bend])
        kappa[0] += self.curvature
        return SmoothPathPoint(np.array([x, y, self.heading(np.array([s]))[0]]), kappa)

    def heading(self, s: Array) -> Array:
        """Return the headings (n,), rad, at lengths ``s`` (n,) from the start."""
        u = (s[:, None] - self.places) / self.transition
        area = smooth_step(np.clip(u, 0.0, 1.0)).area + np.maximum(u - 1.0, 0.0)
        return np.asarray(self.start[2] + self.curvature * s + self.transition * area @ self.steps)

    @property
    def end(self) -> Array:
        """The last pose (3,)."""
        return np.append(self.grid[1][-1], self.heading(np.array([self.length])))

    def _move(self, first: Array, last: Array) -> Array:
        """Return the displacements (n, 2), m, between pairs of lengths (n,)."""
        half = 0.5 * (last - first)
        s = first[:, None] + half[:, None] * (1.0 + GAUSS[0])
        angles = self.heading(s.ravel()).reshape(s.shape)
        return np.column_stack(
            [half * (np.cos(angles) @ GAUSS[1]), half * (np.sin(angles) @ GAUSS[1])]
        )


def smooth_path(
    start: Array,
    goal: Array,
    curvatures: tuple[float, float],
    radius: float,
    transition: float,
    longest: float,
) -> SmoothPath | None:
    """Return a short path from pose to pose with these curvatures at its ends, or None.

    Its pieces are those of one of Dubins' paths, joined by smooth steps of the curvature; their
    three lengths are solved for, so that the path ends at its goal. Steps lead a path off its sharp
    one. What has to come back from there ends in a short arc where the sharp path has none, or
    would have to turn a little the other way: a whole turn but for less than a step.

    Args:
        start: x, y (m) and heading (rad) (3,).
        goal: Likewise.
        curvatures: At start and goal, 1/m.
        radius: Of the arcs, m.
        transition: How long a step of the curvature is, m.
        longest: No path is longer, m.
    """
    sharp = dict.fromkeys(shortest_paths(start, goal, radius))
    almost = TURN * radius - transition
    for turns, lengths in [*sharp]:
        kept = [0.0 if turn and x > almost else x for turn, x in zip(turns, lengths, strict=True)]
        sharp[Bends(turns, (kept[0], kept[1], kept[2]))] = None
    for bends in sorted(sharp, key=lambda path: sum(path.lengths)):
        if sum(bends.lengths) > longest + transition:  # a smooth one may be a little shorter
            break
        path = _closed(start, goal, curvatures, bends, transition, longest)
        if path is not None and path.length <= longest:
            return path
    return None


def _closed(
    start: Array,
    goal: Array,
    curvatures: tuple[float, float],
    bends: Bends,
    transition: float,
    longest: float,
) -> SmoothPath | None:
    """Return the path of these pieces that ends at its goal, or None."""

    def path(lengths: Array) -> SmoothPath:
        # A search for lengths may try any.
        bounded = np.clip(lengths, -transition, longest)
        return _joined(start, curvatures, bends.curvatures, transition, bounded)

    def miss(lengths: Array) -> Array:
        off = path(lengths).end - goal
        off[2] = wrap(off[2])
        return off

    half = 0.5 * transition  # the middles of the steps lie where the sharp pieces meet
    sharp = np.maximum(bends.lengths - half * np.array([1.0, 0.0, 1.0]), 0.0)
    found = root(miss, sharp, tol=TOLERANCE, options={"factor": CAUTION})
    closed = np.abs(found.fun).max() < CLOSED and found.x.min() > SHORTEST_PIECE
    return path(found.x) if closed else None


def _joined(
    start: Array,
    curvatures: tuple[float, float],
    pieces: tuple[float, float, float],
    transition: float,
    lengths: Array,
) -> SmoothPath:
    """Return the path of three pieces, each as long as from one step's start to the next one's."""
    steps = np.diff([curvatures[0], *pieces, curvatures[1]])
    places = np.append(0.0, np.cumsum(lengths))
    return SmoothPath(start, curvatures[0], steps, places, transition, places[-1] + transition)
