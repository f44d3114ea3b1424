"""The horizon law's QP, written about a predicted motion: dynamics, cost and bounds by stage.

Its unknowns are deviations from that motion: stage k has δν̇ of step k, then what it leads to, the
deviations of pose, joints and ν at step k + 1; the slacks of all soft bounds come last.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices, Model, PoseJacobian
from rpctl.control.horizon.qp import QuadraticProgram, SparsityPattern
from rpctl.robot.model import BASE_NV

SLACK_PRICE = 3e4  # cost of a unit of slack: more than errors pay, so that bounds give way last
SLACK_CURVATURE = 1e4  # curvature of that cost, which keeps the solution unique


class RowBlock(NamedTuple):
    """Soft rows of one kind at K stages; those of a stage share one slack."""

    unknowns: Indices  # (K, columns) that the rows of each stage are about
    rows: int  # of each stage


class LinearisedConstraint(NamedTuple):
    """Numbers of a family: value + slopes @ δ ≤ slack at each stage."""

    value: Array  # (K, rows)
    jacobian: Array  # (K, rows, columns)


class StageIndices(NamedTuple):
    """Index in x of each stage's unknowns."""

    nu_dot: Indices  # (N, dof)
    pose: Indices  # (N, 3), or (N, 0) for a fixed base
    joints: Indices  # (N, n_joints)
    nu: Indices  # (N, dof)


class StageValues(NamedTuple):
    """A number for each of these unknowns."""

    nu_dot: Array
    pose: Array
    joints: Array
    nu: Array


class Quadratic(NamedTuple):
    """Part of the cost on pose and joints at one stage: ½ δᵀ H δ + gᵀ δ."""

    H: Array
    g: Array


def stage_indices(model: Model) -> StageIndices:
    """Return where each stage's unknowns are."""
    dof, joints = model.robot.dof, len(model.joints)
    sizes = [dof, BASE_NV if model.base else 0, joints, dof]
    every = np.arange(model.steps * sum(sizes)).reshape(model.steps, -1)
    return StageIndices(*np.split(every, np.cumsum(sizes)[:-1], axis=1))


class QpBuilder:
    """The QP of one robot: patterns once, numbers each time.

    Args:
        model: The prediction's model.
        weights: Diagonal of the cost's Hessian, as :class:`StageValues` has the unknowns.
        terminal: Cross weight of each joint's position and rate at the last stage (n_joints,).
        extra_cost: Stages with a :class:`Quadratic` besides.
        soft: Families of rows that may give way.
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
        """Announce rows @ δ − slack ≤ −value."""
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
        """Announce δx_{k+1} − (∂x_{k+1}/∂x_k) δx_k − (∂x_{k+1}/∂ν̇_k) δν̇_k = 0."""
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

    def build(
        self,
        jacobian: PoseJacobian,
        gradient: StageValues,
        extra_cost: Sequence[Quadratic],
        soft: Iterable[LinearisedConstraint],
        lower: StageValues,
        upper: StageValues,
    ) -> QuadraticProgram:
        """Return the QP about a motion.

        Args:
            jacobian: Derivatives of the base's motion.
            gradient: Of the cost at the motion, without ``extra_cost``.
            extra_cost: Cost at the stages announced.
            soft: Rows in the order announced.
            lower: Bounds of the unknowns.
            upper: Likewise.
        """
        total = len(self._diagonal)
        c = np.full(total, SLACK_PRICE)
        low, high = np.zeros(total), np.full(total, np.inf)
        for index, g, least, most in zip(self.indices, gradient, lower, upper, strict=True):
            c[index], low[index], high[index] = g, least, most
        diagonal, off_diagonal = self._diagonal.copy(), [self._terminal]
        for k, (H, g) in zip(self._extra_stages, extra_cost, strict=True):
            unknowns = np.concatenate([self.indices.pose[k], self.indices.joints[k]])
            diagonal[unknowns] += np.diag(H)
            c[unknowns] += g
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
    """Return the places of a full block a stage: rows (K, a) by columns (K, b)."""
    shape = (len(rows), rows.shape[1], columns.shape[1])
    return (
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )
