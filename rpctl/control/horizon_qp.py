"""The horizon law's quadratic program: sparsity fixed once, numbers filled in, solved by PIQP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import piqp
from scipy.sparse import csc_matrix

from rpctl.description.records import Array

ACCURACY = 1e-6  # of the QP's residuals and gap, absolute and relative
MAX_ITERATIONS = 40  # of the interior-point method; warm samples take about ten


class QuadraticProgram(NamedTuple):
    """minimise ½ xᵀP x + cᵀx with A x = b, G x ≤ h, lower ≤ x ≤ upper; P holds its upper half."""

    P: csc_matrix
    c: Array
    A: csc_matrix
    b: Array
    G: csc_matrix
    h: Array
    lower: Array
    upper: Array


class Solution(NamedTuple):
    """Outcome of a QP, with the multipliers that prove it."""

    x: Array
    y: Array  # of A x = b
    z: Array  # of G x ≤ h
    z_lower: Array
    z_upper: Array
    solved: bool
    iterations: int
    status: str


class Pattern:
    """A sparse matrix whose places are fixed: values go in by the order they were announced in.

    Args:
        shape: Of the matrix.
        rows: Row of each entry.
        columns: Column of each entry; no place twice.
    """

    def __init__(self, shape: tuple[int, int], rows: Array, columns: Array) -> None:
        self._order = np.lexsort((rows, columns))
        counts = np.bincount(columns, minlength=shape[1])
        self.matrix = csc_matrix(
            (np.zeros(len(rows)), rows[self._order], np.concatenate([[0], np.cumsum(counts)])),
            shape=shape,
        )

    def fill(self, values: Array) -> csc_matrix:
        """Return the matrix with these values; the next call overwrites it."""
        np.take(values, self._order, out=self.matrix.data)
        return self.matrix


class Solver:
    """PIQP ([SBN23]) on QPs of one sparsity: its ordering and symbolic factors are kept.

    An interior-point method starts anew each time; what is warm is the motion about which its
    QP is written, the factorisation's structure and the scaling.
    """

    def __init__(self) -> None:
        self._piqp: piqp.SparseSolver | None = None

    def solve(self, qp: QuadraticProgram) -> Solution:
        """Return the solution, or the last iterate with ``solved`` false."""
        unbounded = np.full(len(qp.h), -np.inf)
        data = (qp.P, qp.c, qp.A, qp.b, qp.G, unbounded, qp.h, qp.lower, qp.upper)
        if self._piqp is None:
            self._piqp = _configured()
            self._piqp.setup(*data)
        else:
            self._piqp.update(*data)
        status = self._piqp.solve()
        found = self._piqp.result
        return Solution(
            x=found.x,
            y=found.y,
            z=found.z_u,
            z_lower=found.z_bl,
            z_upper=found.z_bu,
            solved=status == piqp.PIQP_SOLVED and bool(np.isfinite(found.x).all()),
            iterations=int(found.info.iter),
            status=str(status).rpartition(".")[2],
        )


def _configured() -> piqp.SparseSolver:
    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.eps_abs = settings.eps_rel = ACCURACY
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = ACCURACY
    settings.max_iter = MAX_ITERATIONS
    settings.preconditioner_reuse_on_update = True
    return solver
