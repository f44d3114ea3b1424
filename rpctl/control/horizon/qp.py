"""The horizon law's quadratic program: its structure is fixed once, its values at each solve.

Its unknowns are deviations from a predicted motion: stage k holds δν̇ of step k and the deviations
of pose, joints and ν at step k + 1; the slacks of the soft constraints come last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import daqp
import numpy as np
from scipy.linalg import block_diag
from scipy.linalg.lapack import dpotrf, dpotrs

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


class StageValues(NamedTuple):
    """One number, or the index in x, of each unknown of the N stages."""

    nu_dot: Any  # (N, dof)
    pose: Any  # (N, 3), or (N, 0) for a fixed base
    joints: Any  # (N, n_joints)
    nu: Any  # (N, dof)


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


def stage_indices(model: Model) -> StageValues:
    """Return the index in x of each stage's unknowns."""
    dof, joints = model.robot.dof, len(model.joints)
    sizes = [dof, BASE_NV if model.base else 0, joints, dof]
    every = np.arange(model.steps * sum(sizes)).reshape(model.steps, -1)
    return StageValues(*np.split(every, np.cumsum(sizes)[:-1], axis=1))


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


MAX_ROUNDS = 100  # of adding broken bounds; most solves take none, few more than four
BROKEN = 1e-7  # of a bound's unit: what counts as broken
RIDGE = 1e-12  # of W's scaled diagonal: keeps its factor regular where rows depend on each other
PRIMAL_TOLERANCE = 1e-9  # of the largest violation, of a row of length one
FREE_SLACK = -SLACK_PRICE / SLACK_CURVATURE  # minimiser of a slack's cost without its bound
DAQP_OPTIMAL = 1
DAQP_INFINITY = 1e30  # what DAQP takes for no bound


class CondensedSolution(NamedTuple):
    """Outcome of a condensed QP."""

    x: Array  # deviations of all stages, then the slacks: the unknowns of the sparse QP
    active: Indices  # numbers of the bounds that hold it, for the next solve
    solved: bool
    rounds: int  # of adding broken bounds


class CondensedQp:
    """A QP about one motion, its Hessian factored."""

    def __init__(self, structure: CondensedStructure, linearisation: Linearisation) -> None:
        self._structure, self._values = structure, linearisation
        self._pose_map = np.empty((0, 0))
        if structure.model.base:
            Phi = self._pose_map = structure.pose_map(linearisation.jacobian)
            weighted = structure.hessian.pose.reshape(-1, 1) * Phi
            self._factor, _ = dpotrf(structure.base_block + Phi.T @ weighted, lower=1)
        parts = zip(structure.extra_unknowns, linearisation.extra_cost, strict=True)
        E = [each.jacobian @ self._gamma(unknowns) for unknowns, each in parts]
        unknowns = structure.model.robot.dof * structure.model.steps
        self._E = np.vstack([np.empty((0, unknowns)), *E])
        self._tied = self._untied_solve(self._E.T)
        self._capacitance = np.linalg.inv(np.eye(len(self._E)) + self._E @ self._tied)

    def _gamma(self, deviations: Indices) -> Array:
        """Return the rows of Γ (..., unknowns) of these deviations (...)."""
        structure = self._structure
        rows = structure.gamma(deviations)
        if structure.model.base:
            pose = structure.pose_rows[deviations]
            rows[pose >= 0, : structure.base] = self._pose_map[pose[pose >= 0]]
        return np.asarray(rows)

    def _untied_solve(self, right: Array) -> Array:
        """Return D⁻¹ of columns (unknowns, m)."""
        structure, base = self._structure, self._structure.base
        found = np.empty_like(right)
        if base:
            found[:base], _ = dpotrs(self._factor, right[:base], lower=1)
        joints, n, _ = structure.arm_inverse.shape
        arm = structure.arm_inverse @ right[base:].reshape(joints, n, right.shape[1])
        found[base:] = arm.reshape(joints * n, right.shape[1])
        return found

    def _hessian_solve(self, right: Array) -> Array:
        """Return H⁻¹ of columns (unknowns, m)."""
        found = self._untied_solve(right)
        return np.asarray(found - self._tied @ (self._capacitance @ (self._E @ found)))

    def _gradient(self) -> Array:
        """Return g (unknowns, 1)."""
        structure, gradient = self._structure, self._values.gradient
        g = gradient.nu_dot.T + gradient.nu.T @ structure.speeds
        g[structure.model.base :] += gradient.joints.T @ structure.positions
        flat = g.reshape(-1, 1)
        if structure.model.base:
            flat[: structure.base] += self._pose_map.T @ gradient.pose.reshape(-1, 1)
        if len(self._E):
            errors = np.concatenate([each.residual for each in self._values.extra_cost])
            flat += self._E.T @ errors[:, None]
        return flat

    def _deviations(self, u: Array) -> Array:
        """Return Γ u."""
        structure = self._structure
        nu_dot = u.reshape(-1, structure.model.steps).T
        joints = structure.positions @ nu_dot[:, structure.model.base :]
        pose = (self._pose_map @ u[: structure.base]).reshape(len(nu_dot), -1)
        parts = [nu_dot, pose, joints, structure.speeds @ nu_dot]
        return np.hstack(parts if structure.model.base else [nu_dot, *parts[2:]]).ravel()

    def _soft_values(self, x: Array) -> Array:
        """Return value + jacobian δ of all soft rows."""
        found = [
            (each.value + (each.jacobian @ x[block.unknowns][:, :, None])[:, :, 0]).ravel()
            for block, each in zip(self._structure.soft, self._values.soft, strict=True)
        ]
        return np.concatenate([np.empty(0), *found])

    def solve(self, values: Linearisation, guess: Indices) -> CondensedSolution:
        """Return the solution.

        Args:
            values: Gradient, residuals, values and bounds; derivatives are those factored.
            guess: Numbers of bounds that may be active: lower bounds of the deviations, upper ones,
                then the soft rows.
        """
        self._values = values
        self._lower, self._upper = (
            np.hstack(bounds).ravel() for bounds in (values.lower, values.upper)
        )
        u = free = -self._hessian_solve(self._gradient())[:, 0]
        slacks = np.zeros(int(self._structure.slacks[-1]))
        candidates, active = guess[:0], guess[:0]
        for rounds in range(MAX_ROUNDS):
            x = self._deviations(u)
            broken = self._broken(x, slacks)
            if not len(broken):
                return CondensedSolution(np.concatenate([x, slacks]), active, True, rounds)
            candidates = np.union1d(candidates if rounds else guess, broken)
            found = self._within(candidates, free)
            if found is None:
                break
            u, slacks, active = found
        return CondensedSolution(np.concatenate([x, slacks]), guess[:0], False, rounds)

    def _broken(self, x: Array, slacks: Array) -> Indices:
        """Return the numbers of the bounds that a solution breaks."""
        rows = self._soft_values(x) - slacks[self._structure.slack_of_rows]
        return np.flatnonzero(np.concatenate([self._lower - x, x - self._upper, rows]) > BROKEN)

    def _rows(self, candidates: Indices) -> tuple[Array, Array, Indices]:
        """Return rows (m, unknowns) and bounds (m,) of candidates, and the slacks of the last."""
        structure, count = self._structure, len(self._lower)
        lower, upper, soft = np.split(candidates, np.searchsorted(candidates, [count, 2 * count]))
        upper, soft = upper - count, soft - 2 * count
        rows = [-self._gamma(lower), self._gamma(upper)]
        bounds = [-self._lower[lower], self._upper[upper]]
        blocks = zip(structure.soft, self._values.soft, strict=True)
        for (unknowns, _), values in blocks:
            here, soft = np.split(soft, np.searchsorted(soft, [values.value.size]))
            soft = soft - values.value.size
            stage, row = np.unravel_index(here, values.value.shape)
            jacobian = values.jacobian[stage, row][:, None]
            rows.append((jacobian @ self._gamma(unknowns[stage]))[:, 0])
            bounds.append(-values.value[stage, row])
        slacks = structure.slack_of_rows[candidates[candidates >= 2 * count] - 2 * count]
        return np.vstack(rows), np.concatenate(bounds), slacks

    def _within(self, candidates: Indices, free: Array) -> tuple[Array, Array, Indices] | None:
        """Return accelerations, slacks and active bounds of the QP with these bounds alone.

        A slack s belongs to all soft rows of its stage; with its own bound −s ≤ 0, it is one more
        unknown whose block of H is its curvature.

        Args:
            free: Solution without bounds (unknowns,).
        """
        A, b, slack_of_row = self._rows(candidates)
        used, place = np.unique(slack_of_row, return_inverse=True)
        m = len(b)
        by_slack = np.zeros((m + len(used), len(used)))  # minus the rows' derivatives by slacks
        by_slack[np.arange(m - len(place), m), place] = 1.0
        by_slack[m:] = np.eye(len(used))
        pull = self._hessian_solve(A.T)
        W = by_slack @ by_slack.T / SLACK_CURVATURE
        W[:m, :m] += A @ pull
        room = by_slack.sum(axis=1) * FREE_SLACK
        room[:m] += b - A @ free
        multipliers = _least_multipliers(W, room)
        if multipliers is None:
            return None
        slacks = np.zeros(int(self._structure.slacks[-1]))
        slacks[used] = np.maximum(FREE_SLACK + by_slack.T @ multipliers / SLACK_CURVATURE, 0.0)
        u = free - pull @ multipliers[:m]
        return u, slacks, candidates[multipliers[:m] > 0.0]


def _least_multipliers(W: Array, room: Array) -> Array | None:
    """Return the λ ≥ 0 of least ½ λᵀ W λ + λᵀ room; None if there is none.

    With L Lᵀ = W these are the multipliers of the shortest w with L w ≤ room.
    """
    scale = 1.0 / np.sqrt(np.diag(W))
    room, count = room * scale, len(scale)
    size = float(np.abs(room).max())  # DAQP's tolerances are absolute
    L, info = dpotrf(W * np.outer(scale, scale) + RIDGE * np.eye(count), lower=1)
    if info:
        return None
    _, _, flag, found = daqp.solve(
        np.eye(count),
        np.zeros(count),
        np.tril(L),
        room / size,
        np.full(count, -DAQP_INFINITY),
        np.zeros(count, dtype=np.intc),
        primal_tol=PRIMAL_TOLERANCE,
    )
    return size * scale * np.asarray(found["lam"]) if flag == DAQP_OPTIMAL else None
