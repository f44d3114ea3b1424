"""Solvers of the horizon law's quadratic programs: by active bounds, or PIQP on the sparse QP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import piqp

from rpctl.arrays import Array
from rpctl.control.horizon.condensed import CondensedQp
from rpctl.control.horizon.prediction import Indices
from rpctl.control.horizon.qp import Linearisation, QpBuilder, QuadraticProgram
from rpctl.control.horizon.structure import CondensedStructure

QP_TOLERANCE = 1e-6  # of the QP's residuals and gap, absolute and relative
MAX_QP_ITERATIONS = 40  # of the interior-point method; most samples take about ten


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


class Answer(NamedTuple):
    """Solution of a QP, or what its solver ended with."""

    x: Array  # deviations of all stages, then the slacks
    solved: bool


class HorizonSolver:
    """Solves the QPs of one robot: condensed, or, where that gives up, sparse.

    The bounds that were active last are the first to be tried.

    Args:
        builder: Builds the sparse QP.
        structure: Of the condensed QP.
    """

    def __init__(self, builder: QpBuilder, structure: CondensedStructure) -> None:
        self._builder, self._structure = builder, structure if structure.affordable else None
        self._sparse = SparseSolver()
        self._active: Indices = np.empty(0, dtype=np.intp)
        self.sparse_solves = 0

    def factored(self, linearisation: Linearisation) -> CondensedQp | None:
        """Return the condensed QP, its Hessian factored; None where there are too many unknowns."""
        if self._structure is None:
            return None
        return CondensedQp(self._structure, linearisation)

    def solve(self, linearisation: Linearisation, qp: CondensedQp | None) -> Answer:
        """Return the solution.

        Args:
            linearisation: Values of the QP.
            qp: The condensed QP, factored for the same motion; None leaves it to the sparse one.
        """
        if qp is not None:
            found = qp.solve(linearisation, self._active)
            self._active = found.active
            if found.solved and np.isfinite(found.x).all():
                return Answer(found.x, True)
            self.sparse_solves += 1
        return self.solve_sparse(linearisation)

    def solve_sparse(self, linearisation: Linearisation) -> Answer:
        """Return the solution of the sparse QP."""
        found = self._sparse.solve(self._builder.build(linearisation))
        return Answer(found.x, found.solved)


class SparseSolver:
    """PIQP ([SJKJ23]) on QPs of one sparsity: its ordering and symbolic factors are kept.

    The QP without inequalities is solved first, at a fraction of the cost; if its solution
    satisfies them all, it is the answer. An interior-point method is not warm-started: what carries
    over is the motion that the QP is linearised about, and the structure of the factorisation.
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
        found.z_lower[qp.slack :] = qp.c[qp.slack :]  # multipliers that keep the slacks at 0
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
