"""A configuration in symbols, and what rolling makes of velocities and efforts there: S, Ṡν, B."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.projection import Projector
from rpctl.kernels.scalars import (
    BlockSolver,
    Scalar,
    Vector,
    column,
    dot,
    entries,
    exact,
    matrix,
    product,
    solve_positive,
    times,
    total,
    transposed,
    turned,
)
from rpctl.robot.coordinates import JointEntry
from rpctl.robot.model import BASE_NV


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
    return column(joints_moved(found, v, entries_of))


def joints_moved(found: list[Scalar], v: Any, entries_of: dict[int, JointEntry]) -> list[Scalar]:
    """Return the entries of q with the joints moved along v for a time of 1."""
    for index, entry in entries_of.items():
        i = entry.index
        if entry.is_pair:
            found[i : i + 2] = _composed(
                found[i], found[i + 1], casadi.cos(v[index]), casadi.sin(v[index])
            )
        else:
            found[i] = found[i] + v[index]
    return found


def _composed(cos: Scalar, sin: Scalar, c: Scalar, s: Scalar) -> list[Scalar]:
    """Return cosine and sine of the sum of two angles, their squares' sum nearer to 1."""
    x, y = c * cos - s * sin, s * cos + c * sin
    scale = 1.5 - 0.5 * (x * x + y * y)
    return [scale * x, scale * y]


SINGULAR = 1e-6  # a smaller margin is left to Python: :class:`ReducedDynamics` refuses at 1e-9
Matrix = Sequence[Vector]


class SymbolicBasis:
    """S, and what Ṡν is made of, at one configuration.

    Args:
        projector: That of the robot.
        numbers: Those of ``rolling_numbers``, as floats or symbols, nested as the arrays are.
        at: The configuration.
        swivels: Entries in q of the swivels' joints.
    """

    def __init__(
        self,
        projector: Projector,
        numbers: Mapping[str, Any],
        at: SymbolicConfiguration,
        swivels: Sequence[JointEntry],
    ) -> None:
        self._projector, self._numbers = projector, numbers
        self.margin: Scalar = 1.0
        self._solver: BlockSolver | None = None
        if projector.constant is not None:
            self.S: Matrix = numbers["S"]
            return
        core = projector.equations.core
        n = len(numbers["R"])
        pairs = [at.pair(entry) for entry in swivels]
        self._waves = _waves(core.G, numbers["cosine"], numbers["sine"], pairs)
        both = [
            [
                total((entry, *(times(w, H[r][c]) for w, H in self._harmonics("harmonics"))))
                for c, entry in enumerate(row)
            ]
            for r, row in enumerate(numbers["constant"])
        ]
        self._X = both[n:]
        self._solver = BlockSolver(both[:n], core.bound[:n])
        self.margin = self._solver.margin
        columns = [self._solver.solve(list(b)) for b in zip(*numbers["R"], strict=True)]
        self.S = [
            [total((c, dot(x, y))) for c, y in zip(row, columns, strict=True)]
            for x, row in zip(self._X, numbers["C"], strict=True)
        ]

    def _harmonics(self, name: str) -> list[tuple[Scalar, Matrix]]:
        cosines, sines = self._waves
        return list(zip([*cosines, *sines], self._numbers[name], strict=True))

    def drift(self, v: Vector) -> list[Scalar]:
        """Return Ṡν (nv,) at v = S ν (nv,)."""
        if self._solver is None:
            return [0.0] * len(v)
        rolling = self._projector.rolling
        rates = [v[i] for i in rolling.index.tolist()]
        turning = [dot(row, rates) for row in self._projector.equations.core.G.tolist()]
        cosines, sines = self._waves
        changes = [times(-rate, s) for rate, s in zip(turning, sines, strict=True)]
        changes += [times(rate, c) for rate, c in zip(turning, cosines, strict=True)]
        rows = range(len(rolling.matrix.constant))
        slip = [
            -total(
                times(change, dot(H[r], v))
                for change, H in zip(changes, self._numbers["A"], strict=True)
            )
            for r in rows
        ]
        return self.answer(slip)

    def answer(self, slip: list[Scalar]) -> list[Scalar]:
        """Return x (nv,) with A x = ``slip`` (rows,) and W x = 0, where wheels swivel."""
        assert self._solver is not None
        y = self._solver.solve(product(self._numbers["N"], slip))
        rest = product(self._numbers["P"], slip)
        return [total((dot(x, y), other)) for x, other in zip(self._X, rest, strict=True)]


def _waves(
    G: Array, cosine: Vector, sine: Vector, pairs: Sequence[tuple[Scalar, Scalar]]
) -> tuple[list[Scalar], list[Scalar]]:
    """Return cosines and sines of phase + G p, of which each entry is 0 or ±1."""
    cosines, sines = [], []
    for row, c, s in zip(G.tolist(), cosine, sine, strict=True):
        for sign, (x, y) in zip(row, pairs, strict=True):
            if sign:
                y = times(sign, y)
                c, s = (
                    total((times(c, x), times(-s, y))),
                    total((times(s, x), times(c, y))),
                )
        cosines.append(c)
        sines.append(s)
    return cosines, sines


class SymbolicProjection:
    """What rolling makes of velocities and efforts at one configuration, in symbols.

    Args:
        projector: That of the robot.
        basis: S at the configuration.

    Attributes:
        rows: Rows of S.
        columns: Its columns.
    """

    def __init__(self, projector: Projector, basis: SymbolicBasis) -> None:
        self._projector, self._basis = projector, basis
        self.rows = basis.S
        self.columns = transposed(basis.S)

    @cached_property
    def S(self) -> Any:
        """Basis ``casadi.SX`` (nv, dof), sparse where it is constantly 0."""
        return matrix(self.rows)

    @cached_property
    def B(self) -> Any:
        """Actuation map ``casadi.SX`` (dof, n_act), likewise."""
        return matrix(self.actuation)

    @cached_property
    def actuation(self) -> list[list[Scalar]]:
        """Rows of B."""
        robot = self._projector.robot
        return transposed([self.rows[robot.velocity_index(name)] for name in robot.actuators])

    @property
    def margin(self) -> Any:
        """How far the steering is from a singular one, of 1; 1 where S is constant."""
        return casadi.SX(self._basis.margin)

    @cached_property
    def allocation(self) -> Any:
        """Right inverse of B (n_act, dof) of least efforts relative to their limits."""
        units = np.eye(self._projector.robot.dof).tolist()
        return matrix(transposed([self.allocated(unit) for unit in units]))

    def allocated(self, force: list[Scalar]) -> list[Scalar]:
        """Return the entries of the τ of least effort with B τ = ``force``.

        Raises:
            ActuationError: Actuators do not drive all quasi-velocities.
        """
        projector = self._projector
        known = all(isinstance(entry, float) for row in self.rows for entry in row)
        if projector.constant is not None and known:  # S is the same in all robots of the graph
            return product(projector.constant.allocation.tolist(), force)
        regular = projector.robot.random_configuration(np.random.default_rng(0))
        _ = projector.at(regular).allocation  # refuses what nothing drives
        limits = projector.robot.effort_limits
        squares = (np.where(np.isfinite(limits), limits, 1.0) ** 2).tolist()
        B = self.actuation
        weighted = [[times(b, square) for b, square in zip(row, squares, strict=True)] for row in B]
        gram = [[dot(a, b) for b in B] for a in weighted]
        return product(transposed(weighted), solve_positive(gram, force))

    def multipliers(self, force: Any) -> Any:
        """Return λ (rows, 1), the shortest with Aᵀ λ = ``force`` (nv, 1)."""
        constant = self._projector.constant
        if constant is not None:
            return column(product(constant.multipliers.tolist(), entries(force)))
        slip = casadi.SX.sym("slip", len(self._projector.rolling.matrix.constant))
        return casadi.jtimes(column(self._basis.answer(entries(slip))), slip, force, True)

    def drift(self, nu: Any) -> Any:
        """Return Ṡν (nv, 1)."""
        return column(self.drifting(entries(nu)))

    def drifting(self, nu: list[Scalar]) -> list[Scalar]:
        """Return the entries of Ṡν."""
        return self._basis.drift(product(self.rows, nu))
