"""What the condensed QPs of one robot have in common, computed once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model, PoseJacobian
from rpctl.control.horizon.qp import RowBlock, StageValues, stage_indices

MAX_CONDENSED = 800  # accelerations: with more the sparse QP is faster, and Γ large


class CondensedStructure:
    """What the condensed QPs of one robot have in common.

    Unknowns u are numbered quasi-velocity by quasi-velocity, N accelerations each.

    Args:
        model: The prediction's model.
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
        self.affordable = model.robot.dof * n <= MAX_CONDENSED
        self.gamma = self._gamma() if self.affordable else np.empty((0, 0))
        self.pose_rows = np.full(int(self.indices.nu[-1, -1]) + 1, -1)  # of the map to the pose
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

    def _gamma(self) -> Array:
        """Return Γ (deviations, unknowns), its rows of the pose still 0."""
        indices, n, base = self.indices, self.model.steps, self.model.base
        gamma = np.zeros((int(indices.nu[-1, -1]) + 1, self.model.robot.dof * n))
        for i in range(self.model.robot.dof):
            columns = slice(i * n, (i + 1) * n)
            gamma[indices.nu_dot[:, i], columns] = np.eye(n)
            gamma[indices.nu[:, i], columns] = self.speeds
            if i >= base:
                gamma[indices.joints[:, i - base], columns] = self.positions
        return gamma

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
