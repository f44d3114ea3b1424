"""Arithmetic on scalars that are floats where they are constant, else ``casadi.SX``.

What is known when the graph is built is computed then: sums take their constants together first,
and a factor 0 removes its product.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array

ROUNDING = 4e-16  # of the largest entry of a constant array: a smaller one is rounding, so 0

Rotation = tuple[float, float]  # cosine and sine of an angle about one axis
Scalar = Any  # a float, or a casadi.SX (1, 1)
Vector = Sequence[Scalar]
ZERO = (0.0, 0.0, 0.0)


def is_zero(value: Scalar) -> bool:
    """Return whether a scalar is the constant 0."""
    return isinstance(value, float) and value == 0.0


def times(left: Scalar, right: Scalar) -> Scalar:
    """Return the product."""
    return 0.0 if is_zero(left) or is_zero(right) else left * right


def total(terms: Iterable[Scalar]) -> Scalar:
    """Return the sum; its constants are added up first."""
    constant, found = 0.0, None
    for term in terms:
        if isinstance(term, float):
            constant += term
        else:
            found = term if found is None else found + term
    if found is None:
        return constant
    return found + constant if constant else found


def dot(left: Iterable[Scalar], right: Iterable[Scalar]) -> Scalar:
    """Return the scalar product."""
    return total(times(a, b) for a, b in zip(left, right, strict=True))


def plus(*vectors: Vector) -> list[Scalar]:
    """Return the sum of vectors."""
    return [total(entries) for entries in zip(*vectors, strict=True)]


def cross(a: Vector, b: Vector) -> list[Scalar]:
    """Return a × b."""
    return [
        total((times(a[1], b[2]), times(-a[2], b[1]))),
        total((times(a[2], b[0]), times(-a[0], b[2]))),
        total((times(a[0], b[1]), times(-a[1], b[0]))),
    ]


def product(matrix: Iterable[Vector], vector: Vector) -> list[Scalar]:
    """Return a matrix, row by row, times a vector."""
    return [dot(row, vector) for row in matrix]


def transposed(matrix: Iterable[Vector]) -> list[list[Scalar]]:
    """Return the columns of a matrix as rows."""
    return [list(column) for column in zip(*matrix, strict=True)]


def column(entries: Iterable[Scalar]) -> Any:
    """Return a dense ``casadi.SX`` (n, 1)."""
    return casadi.vertcat(*(casadi.SX(entry) for entry in entries), casadi.SX(0, 1))


def matrix(rows: Iterable[Iterable[Scalar]], dense: bool = False) -> Any:
    """Return a ``casadi.SX``; unless it shall be dense, what is constantly 0 is left out."""
    found = casadi.vertcat(*(casadi.horzcat(*(casadi.SX(x) for x in row)) for row in rows))
    return casadi.densify(found) if dense else casadi.sparsify(found)


def entries(vector: Any) -> list[Scalar]:
    """Return the entries of a ``casadi.SX`` (n, 1), constants as floats."""
    return [as_scalar(vector[i]) for i in range(vector.numel())]


def as_scalar(value: Any) -> Scalar:
    """Return a ``casadi.SX`` (1, 1), or its value where it is constant."""
    return float(value) if value.is_constant() else value


def cleaned(values: Array) -> Array:
    """Return a constant array whose entries that are rounding, or a hair off ±1, are exact."""
    size = float(np.abs(values).max(initial=0.0))
    nearest = np.round(values)
    simple = (np.abs(values - nearest) <= ROUNDING) & (np.abs(nearest) <= 1.0)
    found = np.where(simple, nearest, values)
    return np.asarray(np.where(np.abs(values) <= ROUNDING * size, 0.0, found) + 0.0)


def exact(angle: float) -> Rotation:
    """Return cosine and sine of an angle; those of right angles are exact."""
    cos, sin = math.cos(angle), math.sin(angle)
    if min(abs(cos), abs(sin)) <= ROUNDING:
        return round(cos) + 0.0, round(sin) + 0.0
    return cos, sin


def turned(x: Scalar, y: Scalar, cos: Scalar, sin: Scalar) -> tuple[Scalar, Scalar]:
    """Return a vector of a plane, turned by an angle.

    Args:
        x: First entry of the vector.
        y: Second entry.
        cos: Cosine of the angle.
        sin: Sine of it.
    """
    return total((times(cos, x), times(-sin, y))), total((times(sin, x), times(cos, y)))


def clipped(value: Any, lower: Any, upper: Any) -> Any:
    """Return a value within bounds, as ``numpy.clip``; infinite bounds are left out.

    Args:
        value: (1, 1).
        lower: (1, 1).
        upper: (1, 1).
    """
    above = value if _is_infinite(lower) else casadi.fmax(value, lower)
    return above if _is_infinite(upper) else casadi.fmin(above, upper)


def _is_infinite(bound: Any) -> bool:
    return isinstance(bound, float) and math.isinf(bound)


def rounded(value: Any) -> Any:
    """Return the nearest integer (1, 1); of two the one nearer to 0."""
    return -casadi.sign(value) * casadi.floor(0.5 - casadi.fabs(value))


def any_true(values: Any) -> Any:
    """Return whether any entry (n, 1) is not 0."""
    found = casadi.SX(0)
    for k in range(values.numel()):
        found = casadi.logic_or(found, values[k])
    return found


class Layout:
    """Where matrices stand in a column; only entries that are not constantly 0 do.

    Args:
        parts: Matrices ``casadi.SX`` by name.
    """

    def __init__(self, parts: Mapping[str, Any]) -> None:
        self._shapes = {name: part.sparsity() for name, part in parts.items()}
        self.size = sum(shape.nnz() for shape in self._shapes.values())
        self.column = casadi.vertcat(*(casadi.vec(part.nz[:]) for part in parts.values()))

    def parts(self, column: Any) -> dict[str, Any]:
        """Return the matrices in a column ``casadi.SX`` (size, 1) by name."""
        found, start = {}, 0
        for name, shape in self._shapes.items():
            found[name] = casadi.SX(shape, column[start : start + shape.nnz()])
            start += shape.nnz()
        return found
