"""Linear equations solved once for all numbers: no pivots are looked for while they are solved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.kernels.scalars import Scalar, dot, is_zero, times, total


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
    return 1.0 / value if isinstance(value, float) else math.fabs(1.0 / value)


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
        pattern = math.sparsify(math.DM(filled))
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
    return abs(value) if isinstance(value, float) else math.fabs(value)


def least(values: Sequence[Scalar]) -> Scalar:
    """Return the smallest of some numbers."""
    known = [value for value in values if isinstance(value, float)]
    found: Scalar = min(known, default=None)
    for value in values:
        if not isinstance(value, float):
            found = value if found is None else math.fmin(found, value)
    return found
