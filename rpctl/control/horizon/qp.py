"""The horizon law's quadratic program: sparsity fixed once, numbers filled in, solved by PIQP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import piqp
from scipy.sparse import csc_matrix

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices

QP_TOLERANCE = 1e-6  # of the QP's residuals and gap, absolute and relative
MAX_QP_ITERATIONS = 40  # of the interior-point method; most samples take about ten


class QuadraticProgram(NamedTuple):
    """minimise ½ xᵀP x + cᵀx with A x = b, G x ≤ h, lower ≤ x ≤ upper.

    P holds its upper half. From ``slack`` on x are slacks: no less than 0, and they cost.
    """

    P: csc_matrix
    c: Array
    A: csc_matrix
    b: Array
    G: csc_matrix
    h: Array
    lower: Array
    upper: Array
    slack: int


class QpSolution(NamedTuple):
    """Outcome of a QP, with the multipliers that prove it."""

    x: Array
    y: Array  # of A x = b
    z: Array  # of G x ≤ h
    z_lower: Array
    z_upper: Array
    solved: bool
    iterations: int
    status: str


class SparsityPattern:
    """A sparse matrix whose places are fixed: values go in by the order they were announced in.

    Args:
        shape: Of the matrix.
        rows: Row of each entry.
        columns: Column of each entry; no place twice.
    """

    def __init__(self, shape: tuple[int, int], rows: Indices, columns: Indices) -> None:
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
    """PIQP ([SJKJ23]) on QPs of one sparsity: its ordering and symbolic factors are kept.

    The QP without its inequalities comes first, at a fraction of the price: where its solution
    keeps them all, it is the QP's. An interior-point method starts anew each time; what is warm is
    the motion about which the QP is written, and the factorisation's structure.
    """

    def __init__(self) -> None:
        self._free: piqp.SparseSolver | None = None
        self._bounded: piqp.SparseSolver | None = None

    def solve(self, qp: QuadraticProgram) -> QpSolution:
        """Return the solution, or the last iterate with ``solved`` false."""
        free = self.unbounded(qp)
        x = free.x
        if free.solved and ((qp.lower <= x) & (x <= qp.upper)).all() and (qp.G @ x <= qp.h).all():
            return free
        found = self.bounded(qp)
        return found._replace(iterations=free.iterations + found.iterations)

    def unbounded(self, qp: QuadraticProgram) -> QpSolution:
        """Return the solution without inequalities, all slacks 0."""
        c = qp.c.copy()
        c[qp.slack :] = 0.0
        data = (qp.P, c, qp.A, qp.b)
        self._free = _with_data(self._free, data)
        found = _solution(self._free)
        found.z_lower[qp.slack :] = qp.c[qp.slack :]  # what keeps each slack at 0
        return found._replace(z=np.zeros(len(qp.h)))

    def bounded(self, qp: QuadraticProgram) -> QpSolution:
        """Return the solution within all bounds."""
        no_lower = np.full(len(qp.h), -np.inf)
        data = (qp.P, qp.c, qp.A, qp.b, qp.G, no_lower, qp.h, qp.lower, qp.upper)
        self._bounded = _with_data(self._bounded, data)
        return _solution(self._bounded)


def _with_data(solver: piqp.SparseSolver | None, data: tuple[object, ...]) -> piqp.SparseSolver:
    if solver is not None:
        solver.update(*data)
        return solver
    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.eps_abs = settings.eps_rel = QP_TOLERANCE
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = QP_TOLERANCE
    settings.max_iter = MAX_QP_ITERATIONS
    settings.preconditioner_reuse_on_update = True
    solver.setup(*data)
    return solver


def _solution(solver: piqp.SparseSolver) -> QpSolution:
    status = solver.solve()
    found = solver.result
    return QpSolution(
        x=found.x,
        y=found.y,
        z=found.z_u,
        z_lower=np.array(found.z_bl),
        z_upper=found.z_bu,
        solved=status == piqp.PIQP_SOLVED and bool(np.isfinite(found.x).all()),
        iterations=int(found.info.iter),
        status=str(status).rpartition(".")[2],
    )
