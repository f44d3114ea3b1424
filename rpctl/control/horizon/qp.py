"""The horizon law's quadratic program: its structure is fixed once, its values at each solve.

Its unknowns are deviations from a predicted motion: stage k holds δν̇ of step k and the deviations
of pose, joints and ν at step k + 1; the slacks of the soft constraints come last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

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


def stage_indices(model: Model) -> StageIndices:
    """Return the index in x of each stage's unknowns."""
    dof, joints = model.robot.dof, len(model.joints)
    sizes = [dof, BASE_NV if model.base else 0, joints, dof]
    every = np.arange(model.steps * sum(sizes)).reshape(model.steps, -1)
    return StageIndices(*np.split(every, np.cumsum(sizes)[:-1], axis=1))


class CondensedStructure:
    """What the condensed QPs of one robot have in common.

    Unknowns u are numbered quasi-velocity by quasi-velocity, N accelerations each.

    Args:
        hessian: Diagonal of the cost's Hessian.
        cross: Cross weight of each joint's position and rate at the last stage (n_joints,).
        extra_cost: Stages with a cost on pose and joints besides.
        soft: Structure of the soft rows.
    """

    def __init__(
        self,
        model: Model,
        hessian: StageValues,
        cross: Array,
        extra_cost: Sequence[int],
        soft: Sequence[RowBlock],
    ) -> None:
        self.model, self.hessian, self.cross = model, hessian, cross
        self.indices, self.soft = stage_indices(model), tuple(soft)
        self.extra_unknowns = [
            np.concatenate([self.indices.pose[k], self.indices.joints[k]]) for k in extra_cost
        ]
        n = model.steps
        later = np.tril(np.ones((n, n)))
        lag = np.subtract.outer(np.arange(n), np.arange(n))
        self.speeds = model.dt * later  # δν after each step by the accelerations
        self.positions = model.dt**2 * (lag + 0.5) * later  # a joint's position after each step
        blocks = [self._block(i) for i in range(model.robot.dof)]
        self.base = n * model.base_columns  # unknowns of the base
        moving = blocks[: model.base_columns]
        self.base_block = block_diag(*moving) if moving else np.empty((0, 0))
        arm = [np.linalg.inv(block) for block in blocks[model.base_columns :]]
        self.arm_inverse = np.reshape(arm, (-1, n, n))
        self.deviations = int(self.indices.nu[-1, -1]) + 1  # then come the slacks
        self._number_responses()
        self.pose_rows = np.full(self.deviations, -1)  # of the map to the pose
        self.pose_rows[self.indices.pose.ravel()] = np.arange(self.indices.pose.size)
        self.slacks = np.cumsum([0, *(len(unknowns) for unknowns, _ in soft)])  # first of each kind
        numbers = [np.repeat(np.arange(len(unknowns)), rows) for unknowns, rows in soft]
        first = zip(self.slacks, numbers, strict=False)
        self.slack_of_rows = np.concatenate([np.empty(0, np.intp), *(at + k for at, k in first)])

    def _block(self, i: int) -> Array:
        """Return the Hessian (N, N) of the cost of quasi-velocity i, without the pose's."""
        H, V, P = self.hessian, self.speeds, self.positions
        block = np.diag(H.nu_dot[:, i]) + V.T @ (H.nu[:, i, None] * V)
        joint = i - self.model.base
        if joint >= 0:
            last = self.cross[joint] * np.outer(P[-1], V[-1])
            block = block + P.T @ (H.joints[:, joint, None] * P) + last + last.T
        return np.asarray(block)

    def _number_responses(self) -> None:
        """Note by which quasi-velocity each deviation moves, and how by its accelerations."""
        n, dof, base = self.model.steps, self.model.robot.dof, self.model.base
        self._responses = np.vstack([np.eye(n), self.speeds, self.positions, np.zeros((1, n))])
        self._moved_by = np.zeros(self.deviations, dtype=np.intp)
        self._response = np.full(self.deviations, 3 * n)
        of_each = (self.indices.nu_dot, 0), (self.indices.nu, 0), (self.indices.joints, base)
        for kind, (index, first) in enumerate(of_each):
            self._moved_by[index] = np.arange(first, dof)
            self._response[index] = kind * n + np.arange(n)[:, None]

    def gamma(self, deviations: Indices) -> Array:
        """Return the rows of Γ (..., unknowns) of these deviations (...); 0 of the pose."""
        flat, n = deviations.ravel(), self.model.steps
        rows = np.zeros((len(flat), self.model.robot.dof, n))
        rows[np.arange(len(flat)), self._moved_by[flat]] = self._responses[self._response[flat]]
        return rows.reshape(*deviations.shape, self.model.robot.dof * n)

    def pose_map(self, jacobian: PoseJacobian) -> Array:
        """Return the map (3 N, base's unknowns) from accelerations to the pose after each step."""
        n, model = self.model.steps, self.model
        before = np.zeros((n, n))
        before[1:] = self.speeds[:-1]
        by = jacobian.nu[:, :, :, None] * before[:, None, None]  # (N, 3, base_columns, N)
        by += jacobian.nu_dot[:, :, :, None] * np.eye(n)[:, None, None]
        if model.steered:
            before[1:] = self.positions[:-1]
            by[:, :, model.base :] += jacobian.steering[:, :, :, None] * before[:, None, None]
        by = by.reshape(n, 3, -1)
        heading = by[:, 2].cumsum(axis=0)
        by[1:, :2] += jacobian.heading[1:, :, None] * heading[:-1, None]
        by[:, :2] = by[:, :2].cumsum(axis=0)
        by[:, 2] = heading
        return by.reshape(3 * n, -1)
