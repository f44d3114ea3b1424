"""The horizon law's QP, written about a predicted motion: dynamics, cost and bounds by stage.

Its unknowns are deviations from that motion: stage k has δν̇ of step k, then what it leads to, the
deviations of pose, joints and ν at step k + 1; the slacks of all soft bounds come last.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.model import Indices, Model, PoseSlopes
from rpctl.control.horizon.qp import Pattern, QuadraticProgram
from rpctl.robot.model import BASE_NV

EXACT = 3e4  # cost of a unit of slack: more than errors pay, so that bounds give way last
ROUND = 1e4  # curvature of that cost, which keeps the solution unique


class Family(NamedTuple):
    """Soft rows of one kind at K stages; those of a stage share one slack."""

    unknowns: Indices  # (K, columns) that the rows of each stage are about
    rows: int  # of each stage


class Soft(NamedTuple):
    """Numbers of a family: value + slopes @ δ ≤ slack at each stage."""

    value: Array  # (K, rows)
    slopes: Array  # (K, rows, columns)


class Places(NamedTuple):
    """Index in x of each stage's unknowns."""

    nu_dot: Indices  # (N, dof)
    pose: Indices  # (N, 3), or (N, 0) for a fixed base
    joints: Indices  # (N, n_joints)
    nu: Indices  # (N, dof)


class Stages(NamedTuple):
    """A number for each of these unknowns."""

    nu_dot: Array
    pose: Array
    joints: Array
    nu: Array


class Quadratic(NamedTuple):
    """Part of the cost on pose and joints at one stage: ½ δᵀ H δ + gᵀ δ."""

    H: Array
    g: Array


def lay_out(model: Model) -> Places:
    """Return where each stage's unknowns are."""
    dof, joints = model.robot.dof, len(model.joints)
    sizes = [dof, BASE_NV if model.base else 0, joints, dof]
    every = np.arange(model.steps * sum(sizes)).reshape(model.steps, -1)
    return Places(*np.split(every, np.cumsum(sizes)[:-1], axis=1))


class Program:
    """The QP of one robot: patterns once, numbers each time.

    Args:
        model: The prediction's model.
        weights: Diagonal of the cost's Hessian, as :class:`Stages` has the unknowns.
        terminal: Cross weight of each joint's position and rate at the last stage (n_joints,).
        posed: Stages with a :class:`Quadratic` besides.
        soft: Families of rows that may give way.
    """

    def __init__(
        self,
        model: Model,
        weights: Stages,
        terminal: Array,
        posed: Sequence[int],
        soft: Sequence[Family],
    ) -> None:
        self.at = lay_out(model)
        self._model, self._terminal, self._posed = model, terminal, list(posed)
        self._count = int(self.at.nu[-1, -1]) + 1
        total = self._count + sum(len(family.unknowns) for family in soft)
        self._diagonal = np.full(total, ROUND)
        for index, weight in zip(self.at, weights, strict=True):
            self._diagonal[index] = weight
        self._cost(total)
        self._dynamics(total)
        self._soften(soft, total)

    def _soften(self, soft: Sequence[Family], total: int) -> None:
        """Announce rows @ δ − slack ≤ −value."""
        places = [(np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))]
        slack, row = self._count, 0
        for unknowns, count in soft:
            stages = len(unknowns)
            own = np.arange(slack, slack + stages)[:, None]
            rows = np.arange(row, row + stages * count).reshape(stages, count)
            places.append(_block(rows, np.hstack([unknowns, own])))
            slack, row = slack + stages, row + stages * count
        rows, columns = (np.concatenate(part) for part in zip(*places, strict=True))
        self._bounds = Pattern((row, total), rows, columns)

    def _cost(self, total: int) -> None:
        at = self.at
        self._pairs = np.triu_indices(at.pose.shape[1] + at.joints.shape[1], 1)
        rows, columns = [np.arange(total), at.joints[-1]], [np.arange(total)]
        columns.append(at.nu[-1, self._model.base :])
        for k in self._posed:
            unknowns = np.concatenate([at.pose[k], at.joints[k]])
            rows.append(unknowns[self._pairs[0]])
            columns.append(unknowns[self._pairs[1]])
        self._hessian = Pattern((total, total), np.concatenate(rows), np.concatenate(columns))

    def _dynamics(self, total: int) -> None:
        """Announce δx_{k+1} − (∂x_{k+1}/∂x_k) δx_k − (∂x_{k+1}/∂ν̇_k) δν̇_k = 0."""
        at, model, dt = self.at, self._model, self._model.dt
        base, moving = model.base, model.moving
        pose, joints = at.pose.shape[1], at.joints.shape[1]
        row = np.arange(model.steps * (pose + joints + at.nu.shape[1])).reshape(model.steps, -1)
        of_pose, of_joints, of_nu = np.split(row, [pose, pose + joints], axis=1)
        entries = [
            (row, np.hstack([at.pose, at.joints, at.nu]), 1.0),
            (of_pose[1:], at.pose[:-1], -1.0),
            (of_joints[1:], at.joints[:-1], -1.0),
            (of_joints[1:], at.nu[:-1, base:], -dt),
            (of_joints, at.nu_dot[:, base:], -0.5 * dt**2),
            (of_nu[1:], at.nu[:-1], -1.0),
            (of_nu, at.nu_dot, -dt),
        ]
        self._steady = np.concatenate([np.full(r.size, value) for r, _, value in entries])
        places = [(r.ravel(), c.ravel()) for r, c, _ in entries]
        if pose:
            places += [
                _block(of_pose[1:, :2], at.pose[:-1, 2:]),
                _block(of_pose[1:], at.nu[:-1, :moving]),
                _block(of_pose, at.nu_dot[:, :moving]),
                _block(of_pose[1:], at.joints[:-1, : model.steered]),
            ]
        rows, columns = (np.concatenate(part) for part in zip(*places, strict=True))
        self._transition = Pattern((row.size, total), rows, columns)
        self._b = np.zeros(row.size)

    def build(
        self,
        slopes: PoseSlopes,
        gradient: Stages,
        posed: Sequence[Quadratic],
        soft: Iterable[Soft],
        lower: Stages,
        upper: Stages,
    ) -> QuadraticProgram:
        """Return the QP about a motion.

        Args:
            slopes: Derivatives of the base's motion.
            gradient: Of the cost at the motion, without ``posed``.
            posed: Cost at the stages announced.
            soft: Rows in the order announced.
            lower: Bounds of the unknowns.
            upper: Likewise.
        """
        total = len(self._diagonal)
        c = np.full(total, EXACT)
        low, high = np.zeros(total), np.full(total, np.inf)
        for index, g, least, most in zip(self.at, gradient, lower, upper, strict=True):
            c[index], low[index], high[index] = g, least, most
        diagonal, coupled = self._diagonal.copy(), [self._terminal]
        for k, (H, g) in zip(self._posed, posed, strict=True):
            unknowns = np.concatenate([self.at.pose[k], self.at.joints[k]])
            diagonal[unknowns] += np.diag(H)
            c[unknowns] += g
            coupled.append(H[self._pairs])
        rows, h = [np.empty(0)], [np.empty(0)]
        for value, by in soft:
            rows.append(np.concatenate([by, np.full((*value.shape, 1), -1.0)], axis=2).ravel())
            h.append(-value.ravel())
        return QuadraticProgram(
            P=self._hessian.fill(np.concatenate([diagonal, *coupled])),
            c=c,
            A=self._transition.fill(np.concatenate([self._steady, *self._moving(slopes)])),
            b=self._b,
            G=self._bounds.fill(np.concatenate(rows)),
            h=np.concatenate(h),
            lower=low,
            upper=high,
            slack=self._count,
        )

    def slack(self, x: Array) -> float:
        """Return the largest slack of a solution, in the units of the soft rows."""
        return float(x[self._count :].max(initial=0.0))

    def _moving(self, slopes: PoseSlopes) -> list[Array]:
        if not self._model.base:
            return []
        heading, nu, nu_dot, steering = slopes
        return [-part.ravel() for part in (heading[1:], nu[1:], nu_dot, steering[1:])]


def _block(rows: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """Return the places of a full block a stage: rows (K, a) by columns (K, b)."""
    shape = (len(rows), rows.shape[1], columns.shape[1])
    return (
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )
