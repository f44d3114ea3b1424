"""Arithmetic and linear equations in scalars: floats where they are constant, else ``casadi.SX``.

What is known when the graph is built is computed then: sums take their constants together first,
and a factor 0 removes its product. Linear equations are solved once for all numbers, without
pivots.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

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


def solve_positive(M: Sequence[Sequence[Scalar]], b: Sequence[Scalar]) -> list[Scalar]:
    """Return M⁻¹ b (n,) of a symmetric positive definite M (n, n).

    Args:
        M: Its lower half is read.
        b: Right side.
    """
    return solve_factored(factored(M), b)


class PositiveFactors(NamedTuple):
    """A symmetric positive definite M = Lᵀ D L."""

    L: list[dict[int, Scalar]]  # row by row, below the diagonal of ones
    over: list[Scalar]  # D⁻¹


def factored(M: Sequence[Sequence[Scalar]]) -> PositiveFactors:
    """Return the factors of a symmetric positive definite M (n, n), whose lower half is read.

    Rows are eliminated from the last to the first: the joints at the ends of a tree fill in nothing
    between its branches ([F08, Ch. 6]). None of D vanishes, so no pivot has to be looked for.
    """
    n = len(M)
    rows = [list(row) for row in M]
    over: list[Scalar] = [0.0] * n
    L: list[dict[int, Scalar]] = [{} for _ in range(n)]
    for k in reversed(range(n)):
        row, over[k] = rows[k], reciprocal(rows[k][k])
        L[k] = {i: times(row[i], over[k]) for i in range(k) if not is_zero(row[i])}
        for i, factor in L[k].items():
            for j in L[k]:
                if j <= i:
                    rows[i][j] = total((rows[i][j], -times(factor, row[j])))
    return PositiveFactors(L, over)


def solve_factored(factors: PositiveFactors, b: Sequence[Scalar]) -> list[Scalar]:
    """Return M⁻¹ b (n,).

    Args:
        factors: Of M.
        b: Right side.
    """
    L, over = factors
    found = list(b)
    for k in reversed(range(len(b))):
        for i, factor in L[k].items():
            found[i] = total((found[i], -times(factor, found[k])))
    solved: list[Scalar] = []
    for k, row in enumerate(L):
        rest = (-times(factor, solved[i]) for i, factor in row.items())
        solved.append(total((times(found[k], over[k]), *rest)))
    return solved


def reciprocal(value: Scalar) -> Scalar:
    """Return 1/value of a positive number.

    CasADi turns each product with an inverse into a division, which takes several times as long;
    with the size of an inverse it does not.
    """
    return 1.0 / value if isinstance(value, float) else casadi.fabs(1.0 / value)


class BlockSolver:
    """Solves M y = b for a small M whose pivots cannot be chosen when the graph is built.

    M is brought to lower block triangular form by its zeros. Each block's inverse is its adjugate
    over its determinant: no number is divided by but those determinants, and one of them vanishes
    only where M is singular.

    Args:
        M: (n, n).
        bound: The largest size that each entry may have (n, n).
    """

    def __init__(self, M: Sequence[Sequence[Scalar]], bound: Array) -> None:
        filled = [[int(not is_zero(entry)) for entry in row] for row in M]
        pattern = casadi.sparsify(casadi.DM(filled))
        count, rows, columns, row_ends, column_ends, *_ = pattern.sparsity().btf()
        self._M = M
        self._blocks = [
            (rows[row_ends[k] : row_ends[k + 1]], columns[column_ends[k] : column_ends[k + 1]])
            for k in range(count)
        ]
        sizes = bound.sum(axis=1)
        self._inverses, margins = [], []
        for rows_k, columns_k in self._blocks:
            inverse, size = inverted([[M[r][c] for c in columns_k] for r in rows_k])
            self._inverses.append(inverse)
            margins.append(absolute(size) / float(np.prod(sizes[list(rows_k)])))
        self.margin: Scalar = least(margins)

    def solve(self, b: Sequence[Scalar]) -> list[Scalar]:
        """Return y (n,)."""
        y: list[Scalar] = [0.0] * len(b)
        for (rows, columns), inverse in zip(self._blocks, self._inverses, strict=True):
            left = [total((b[r], -dot(self._M[r], y))) for r in rows]
            for c, row in zip(columns, inverse, strict=True):
                y[c] = dot(row, left)
        return y


def inverted(M: Sequence[Sequence[Scalar]]) -> tuple[list[list[Scalar]], Scalar]:
    """Return the inverse of a small matrix, its adjugate over its determinant, and that."""
    everything = range(len(M))

    def cofactor(i: int, j: int) -> Scalar:
        rest = [[M[r][c] for c in everything if c != j] for r in everything if r != i]
        return times((-1.0) ** (i + j), determinant(rest))

    cofactors = [[cofactor(i, j) for j in everything] for i in everything]
    size = dot(M[0], cofactors[0])
    over = times(size, reciprocal(times(size, size)))
    return [[times(cofactors[j][i], over) for j in everything] for i in everything], size


def determinant(M: Sequence[Sequence[Scalar]]) -> Scalar:
    """Return the determinant of a small matrix, expanded along its first row."""
    if not M:
        return 1.0
    first, *below = M
    return total(
        times(times((-1.0) ** k, entry), determinant([[*row[:k], *row[k + 1 :]] for row in below]))
        for k, entry in enumerate(first)
        if not is_zero(entry)
    )


def absolute(value: Scalar) -> Scalar:
    """Return |value|."""
    return abs(value) if isinstance(value, float) else casadi.fabs(value)


def least(values: Sequence[Scalar]) -> Scalar:
    """Return the smallest of some numbers."""
    known = [value for value in values if isinstance(value, float)]
    found: Scalar = min(known, default=None)
    for value in values:
        if not isinstance(value, float):
            found = value if found is None else casadi.fmin(found, value)
    return found
