"""The shortest paths of bounded curvature from pose to pose: arcs and a straight line [D57]."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from rpctl.arrays import Array
from rpctl.control.error import wrap

TURN = 2.0 * math.pi
LEFT, STRAIGHT, RIGHT = 1.0, 0.0, -1.0
ROUNDING = 1e-9  # rad: an arc that is shorter than a whole turn by less is none


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
        goal: Likewise.
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
