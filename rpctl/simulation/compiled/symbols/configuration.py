"""A configuration q in symbols: what joints' positions, cosines and sines it holds."""

from __future__ import annotations

from typing import Any

import casadi

from rpctl.robot.coordinates import JointEntry
from rpctl.robot.model import BASE_NV
from rpctl.simulation.compiled.symbols.scalars import Scalar, column, entries, exact, turned


class SymbolicConfiguration:
    """Reads a configuration; each cosine and sine is one node of the graph.

    Args:
        q: ``casadi.SX`` (nq, 1).
    """

    def __init__(self, q: Any) -> None:
        self.q = q
        self.values = entries(q)
        self._pairs: dict[tuple[int, float], tuple[Scalar, Scalar]] = {}

    def pair(self, entry: JointEntry, offset: float = 0.0) -> tuple[Scalar, Scalar]:
        """Return cosine and sine of a joint's position plus an offset (rad)."""
        i, (cos, sin) = entry.index, exact(offset)
        if entry.is_pair:
            return turned(self.values[i], self.values[i + 1], cos, sin)
        key = i, 0.0 if 0.0 in (cos, sin) else offset  # right angles need no node of their own
        if key not in self._pairs:
            angle = self.q[i] + key[1]
            self._pairs[key] = casadi.cos(angle), casadi.sin(angle)
        return self._pairs[key] if key[1] else turned(*self._pairs[key], cos, sin)

    def position(self, entry: JointEntry) -> Scalar:
        """Return a joint's position, rad or m; a continuous joint's in (−π, π]."""
        i = entry.index
        return casadi.atan2(self.q[i + 1], self.q[i]) if entry.is_pair else self.values[i]


def integrated(q: Any, v: Any, entries_of: dict[int, JointEntry]) -> Any:
    """Return q moved along v for a time of 1, as ``pinocchio.integrate``; ``casadi.SX`` (nq, 1).

    The planar root moves along an arc, with v in its own axes. Cosines and sines are brought back
    towards the circle by a step of Newton's.

    Args:
        q: ``casadi.SX`` (nq, 1).
        v: ``casadi.SX`` (nv, 1).
        entries_of: Entries in q of the joints by their index in v.
    """
    found: list[Scalar] = list(entries(q))
    x, y, cos, sin = found[:4]
    ahead, left, turn = (v[i] for i in range(BASE_NV))
    half = 0.5 * turn
    c, s = casadi.cos(half), casadi.sin(half)
    still = half == 0.0
    chord = (s + still) / (half + still)  # sin(h)/h, 1 where h = 0
    along, aside = chord * (c * ahead - s * left), chord * (s * ahead + c * left)
    found[0], found[1] = x + (cos * along - sin * aside), y + (sin * along + cos * aside)
    found[2:4] = _composed(cos, sin, 1.0 - 2.0 * s * s, 2.0 * s * c)
    for index, entry in entries_of.items():
        i = entry.index
        if entry.is_pair:
            found[i : i + 2] = _composed(
                found[i], found[i + 1], casadi.cos(v[index]), casadi.sin(v[index])
            )
        else:
            found[i] = found[i] + v[index]
    return column(found)


def _composed(cos: Scalar, sin: Scalar, c: Scalar, s: Scalar) -> list[Scalar]:
    """Return cosine and sine of the sum of two angles, their squares' sum nearer to 1."""
    x, y = c * cos - s * sin, s * cos + c * sin
    scale = 1.5 - 0.5 * (x * x + y * y)
    return [scale * x, scale * y]
