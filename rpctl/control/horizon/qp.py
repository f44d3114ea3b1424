"""The horizon law's quadratic program: its structure is fixed once, its values at each solve.

Its unknowns are deviations from a predicted motion: stage k holds δν̇ of step k and the deviations
of pose, joints and ν at step k + 1; the slacks of the soft constraints come last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices, Model, PoseJacobian
from rpctl.robot.model import BASE_NV

SLACK_PRICE = 3e4  # cost of a unit of slack, above any tracking error's: soft bounds give way last
SLACK_CURVATURE = 1e4  # curvature of that cost, which keeps the solution unique


class RowBlock(NamedTuple):
    """Structure of the soft rows of one kind at K stages; the rows of a stage share one slack."""

    unknowns: Indices  # (K, columns) unknowns of the rows at each stage
    rows: int  # at each stage


class LinearisedConstraint(NamedTuple):
    """Values of a :class:`RowBlock`: value + jacobian @ δ ≤ slack at each stage."""

    value: Array  # (K, rows)
    jacobian: Array  # (K, rows, columns)


class StageIndices(NamedTuple):
    """Index in x of each stage's unknowns."""

    nu_dot: Indices  # (N, dof)
    pose: Indices  # (N, 3), or (N, 0) for a fixed base
    joints: Indices  # (N, n_joints)
    nu: Indices  # (N, dof)


class StageValues(NamedTuple):
    """One value for each unknown, in the order of :class:`StageIndices`."""

    nu_dot: Array
    pose: Array
    joints: Array
    nu: Array


class LeastSquares(NamedTuple):
    """Part of the cost on pose and joints at one stage: ½ |residual + jacobian δ|²."""

    jacobian: Array  # (rows, unknowns)
    residual: Array  # (rows,)


class Linearisation(NamedTuple):
    """The values of a QP about a motion.

    Attributes:
        jacobian: Derivatives of the base's motion.
        gradient: Gradient of the cost at the motion, without ``extra_cost``.
        extra_cost: Cost on pose and joints, one for each stage that has it.
        soft: Values of the soft rows, in the order of their structure.
        lower: Lower bounds of the unknowns.
        upper: Upper bounds of the unknowns.
    """

    jacobian: PoseJacobian
    gradient: StageValues
    extra_cost: Sequence[LeastSquares]
    soft: Sequence[LinearisedConstraint]
    lower: StageValues
    upper: StageValues


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


class SparsityPattern:
    """A sparse matrix of fixed structure, filled in the order in which its entries were given.

    Args:
        shape: Shape of the matrix.
        rows: Row of each entry (K,).
        columns: Column of each entry (K,); no entry twice.
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


def stage_indices(model: Model) -> StageIndices:
    """Return the index in x of each stage's unknowns."""
    dof, joints = model.robot.dof, len(model.joints)
    sizes = [dof, BASE_NV if model.base else 0, joints, dof]
    every = np.arange(model.steps * sum(sizes)).reshape(model.steps, -1)
    return StageIndices(*np.split(every, np.cumsum(sizes)[:-1], axis=1))


class QpBuilder:
    """Builds the QPs of one robot: sparsity patterns once, values at every solve.

    Args:
        model: The prediction's model.
        weights: Diagonal of the cost's Hessian.
        terminal: Cross weight of each joint's position and rate at the last stage (n_joints,).
        extra_cost: Stages whose cost has a :class:`LeastSquares` on pose and joints besides.
        soft: Structure of the soft rows.
    """

    def __init__(
        self,
        model: Model,
        weights: StageValues,
        terminal: Array,
        extra_cost: Sequence[int],
        soft: Sequence[RowBlock],
    ) -> None:
        self.indices = stage_indices(model)
        self._model, self._terminal, self._extra_stages = model, terminal, list(extra_cost)
        self._slack_start = int(self.indices.nu[-1, -1]) + 1
        total = self._slack_start + sum(len(row_block.unknowns) for row_block in soft)
        self._diagonal = np.full(total, SLACK_CURVATURE)
        for index, weight in zip(self.indices, weights, strict=True):
            self._diagonal[index] = weight
        self._hessian_pattern(total)
        self._dynamics_pattern(total)
        self._constraint_pattern(soft, total)

    def _constraint_pattern(self, soft: Sequence[RowBlock], total: int) -> None:
        """Fix the sparsity of the soft rows: rows @ δ − slack ≤ −value."""
        blocks = [(np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))]
        slack, row = self._slack_start, 0
        for unknowns, count in soft:
            stages = len(unknowns)
            slack_columns = np.arange(slack, slack + stages)[:, None]
            rows = np.arange(row, row + stages * count).reshape(stages, count)
            blocks.append(_block_entries(rows, np.hstack([unknowns, slack_columns])))
            slack, row = slack + stages, row + stages * count
        rows, columns = (np.concatenate(part) for part in zip(*blocks, strict=True))
        self._bounds = SparsityPattern((row, total), rows, columns)

    def _hessian_pattern(self, total: int) -> None:
        indices = self.indices
        self._pairs = np.triu_indices(indices.pose.shape[1] + indices.joints.shape[1], 1)
        rows, columns = [np.arange(total), indices.joints[-1]], [np.arange(total)]
        columns.append(indices.nu[-1, self._model.base :])
        for k in self._extra_stages:
            unknowns = np.concatenate([indices.pose[k], indices.joints[k]])
            rows.append(unknowns[self._pairs[0]])
            columns.append(unknowns[self._pairs[1]])
        self._hessian = SparsityPattern(
            (total, total), np.concatenate(rows), np.concatenate(columns)
        )

    def _dynamics_pattern(self, total: int) -> None:
        """Fix the sparsity of the dynamics.

        δx_{k+1} − (∂x_{k+1}/∂x_k) δx_k − (∂x_{k+1}/∂ν̇_k) δν̇_k = 0
        """
        indices, model, dt = self.indices, self._model, self._model.dt
        base, base_columns = model.base, model.base_columns
        pose, joints = indices.pose.shape[1], indices.joints.shape[1]
        row = np.arange(model.steps * (pose + joints + indices.nu.shape[1])).reshape(
            model.steps, -1
        )
        of_pose, of_joints, of_nu = np.split(row, [pose, pose + joints], axis=1)
        entries = [
            (row, np.hstack([indices.pose, indices.joints, indices.nu]), 1.0),
            (of_pose[1:], indices.pose[:-1], -1.0),
            (of_joints[1:], indices.joints[:-1], -1.0),
            (of_joints[1:], indices.nu[:-1, base:], -dt),
            (of_joints, indices.nu_dot[:, base:], -0.5 * dt**2),
            (of_nu[1:], indices.nu[:-1], -1.0),
            (of_nu, indices.nu_dot, -dt),
        ]
        self._constant_entries = np.concatenate([np.full(r.size, value) for r, _, value in entries])
        blocks = [(r.ravel(), c.ravel()) for r, c, _ in entries]
        if pose:
            blocks += [
                _block_entries(of_pose[1:, :2], indices.pose[:-1, 2:]),
                _block_entries(of_pose[1:], indices.nu[:-1, :base_columns]),
                _block_entries(of_pose, indices.nu_dot[:, :base_columns]),
                _block_entries(of_pose[1:], indices.joints[:-1, : model.steered]),
            ]
        rows, columns = (np.concatenate(part) for part in zip(*blocks, strict=True))
        self._transition = SparsityPattern((row.size, total), rows, columns)
        self._b = np.zeros(row.size)

    def build(self, linearisation: Linearisation) -> QuadraticProgram:
        """Return the QP about a motion."""
        jacobian, gradient, extra_cost, soft, lower, upper = linearisation
        total = len(self._diagonal)
        c = np.full(total, SLACK_PRICE)
        low, high = np.zeros(total), np.full(total, np.inf)
        for index, g, least, most in zip(self.indices, gradient, lower, upper, strict=True):
            c[index], low[index], high[index] = g, least, most
        diagonal, off_diagonal = self._diagonal.copy(), [self._terminal]
        for k, (J, residual) in zip(self._extra_stages, extra_cost, strict=True):
            H = J.T @ J
            unknowns = np.concatenate([self.indices.pose[k], self.indices.joints[k]])
            diagonal[unknowns] += np.diag(H)
            c[unknowns] += J.T @ residual
            off_diagonal.append(H[self._pairs])
        rows, h = [np.empty(0)], [np.empty(0)]
        for value, by in soft:
            rows.append(np.concatenate([by, np.full((*value.shape, 1), -1.0)], axis=2).ravel())
            h.append(-value.ravel())
        return QuadraticProgram(
            P=self._hessian.fill(np.concatenate([diagonal, *off_diagonal])),
            c=c,
            A=self._transition.fill(
                np.concatenate([self._constant_entries, *self._motion_entries(jacobian)])
            ),
            b=self._b,
            G=self._bounds.fill(np.concatenate(rows)),
            h=np.concatenate(h),
            lower=low,
            upper=high,
            slack=self._slack_start,
        )

    def slack(self, x: Array) -> float:
        """Return the largest slack of a solution, in the units of the soft rows."""
        return float(x[self._slack_start :].max(initial=0.0))

    def _motion_entries(self, jacobian: PoseJacobian) -> list[Array]:
        if not self._model.base:
            return []
        heading, nu, nu_dot, steering = jacobian
        return [-part.ravel() for part in (heading[1:], nu[1:], nu_dot, steering[1:])]


def _block_entries(rows: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """Return rows and columns of the entries of a dense (a, b) block at each of K stages."""
    shape = (len(rows), rows.shape[1], columns.shape[1])
    return (
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )
