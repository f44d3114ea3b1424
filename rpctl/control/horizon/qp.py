"""The horizon law's quadratic program: its structure is fixed once, its values at each solve.

Deviations x from a predicted motion are those of ν̇ of step k and of pose, joints and ν after it,
stage by stage. The accelerations' own deviations u fix them all, x = x₀ + Γ u, so that u and the
slacks of the soft constraints are the unknowns; x₀ is what another initial state leads to under the
predicted accelerations ([DBS05], initial value embedding): its derivative makes the feedback.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import daqp
import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices, Model, StageValues
from rpctl.robot.model import BASE_NV

SLACK_PRICE = 3e4  # cost of a unit of slack, above any tracking error's: soft bounds give way last
SLACK_CURVATURE = 1e4  # curvature of that cost, which keeps the solution unique
FREE_SLACK = -SLACK_PRICE / SLACK_CURVATURE  # minimiser of a slack's cost without its bound
MAX_ROUNDS = 100  # of adding broken bounds; most solves take none, few more than four
BROKEN = 1e-7  # of a bound's unit: what counts as broken
RIDGE = 1e-12  # of W's scaled diagonal: keeps its factor regular where rows depend on each other
PRIMAL_TOLERANCE = 1e-9  # of the largest violation, of a row of length one
DAQP_OPTIMAL = 1
DAQP_INFINITY = 1e30  # what DAQP takes for no bound


class LinearRows(NamedTuple):
    """Rows at K stages, linear in some deviations δ: value + jacobian @ δ.

    Soft rows are at most the slack of their stage; half the squares of others are a cost.
    """

    unknowns: Indices  # (K, columns): which deviations
    value: Array  # (K, rows)
    jacobian: Array  # (K, rows, columns)


def _rows_at(x: Array, rows: Sequence[LinearRows]) -> Array:
    """Return all rows one after the other at deviations x."""
    parts = (each.value + (each.jacobian @ x[each.unknowns, None])[:, :, 0] for each in rows)
    return np.concatenate([x[:0], *(part.ravel() for part in parts)])


class StateDifference(NamedTuple):
    """Initial state less that of the motion that a QP is linearised about, in c columns."""

    pose: Array  # (3, c) m, m, rad
    joints: Array  # (n_joints, c)
    nu: Array  # (dof, c)


class Linearisation(NamedTuple):
    """The values of a QP about a motion.

    Attributes:
        jacobian: Derivatives of the base's moves, as of the motion.
        errors: What the motion is off its target by.
        extra: Errors that are no deviations.
        soft: Soft rows; each stage of each kind has a slack.
        lower: Lower bounds of the deviations.
        upper: Upper bounds of the deviations.
    """

    jacobian: Array
    errors: StageValues
    extra: Sequence[LinearRows]
    soft: Sequence[LinearRows]
    lower: StageValues
    upper: StageValues


class CondensedStructure:
    """What the QPs of one robot have in common.

    u is numbered quasi-velocity by quasi-velocity, N accelerations each. Only the pose, and further
    errors, tie quasi-velocities together.

    Args:
        hessian: Diagonal of the cost's Hessian.
        cross: Cross weight of each joint's position and rate at the last stage (n_joints,).

    Attributes:
        gamma: Γ (deviations, n) but for the pose's rows, which change with the motion.
        pose_row: Of each deviation, its row among the pose's; −1 of others.
        base: Number of the first u, which move the base.
        base_block: Hessian by them of the cost without the pose's.
        arm_inverse: Inverse (n_joints, N, N) of that by the others.
    """

    def __init__(self, model: Model, hessian: StageValues, cross: Array) -> None:
        self.model, self.weights, self.cross = model, hessian.flat(), cross
        self.indices = at = model.indices
        n, dof, self.deviations = model.steps, model.robot.dof, len(self.weights)
        later = np.tril(np.ones((n, n)))
        self._speeds = model.dt * later
        lag = np.subtract.outer(np.arange(n), np.arange(n))
        self._positions = model.dt**2 * (lag + 0.5) * later
        self.gamma = np.zeros((self.deviations, n * dof))
        self.gamma[at.nu_dot.T.ravel()] = np.eye(n * dof)
        self.gamma[at.nu.T.ravel()] = np.kron(np.eye(dof), self._speeds)
        self.gamma[at.joints.T.ravel()] = np.kron(np.eye(dof)[model.base :], self._positions)
        self.pose_row = np.full(self.deviations, -1)
        self.pose_row[at.pose.ravel()] = np.arange(at.pose.size)
        whole, first = self.gamma.T @ self.weigh(self.gamma), n * model.base_columns
        self.base, self.base_block = first, whole[:first, :first]
        blocks = [whole[k : k + n, k : k + n] for k in range(first, n * dof, n)]
        self.arm_inverse = np.linalg.inv(np.reshape(blocks, (-1, n, n)))
        sizes = BASE_NV, len(model.joints), dof
        self._unmoved = StateDifference(*(np.zeros((k, first)) for k in sizes))

    def weigh(self, x: Array) -> Array:
        """Return the cost's Hessian by x times columns (deviations, c)."""
        weighed = self.weights[:, None] * x
        joints, rates = self.indices.joints[-1], self.indices.nu[-1, self.model.base :]
        weighed[joints] += self.cross[:, None] * x[rates]
        weighed[rates] += self.cross[:, None] * x[joints]
        return weighed

    def spread(self, u: Array, poses: Array) -> Array:
        """Return Γ u (deviations,).

        Args:
            poses: The pose's rows (3 N, base).
        """
        nu_dot = u.reshape(-1, self.model.steps).T
        joints, moved = self._positions @ nu_dot[:, self.model.base :], poses @ u[: self.base]
        parts = nu_dot, moved.reshape(-1, BASE_NV), joints, self._speeds @ nu_dot
        return StageValues(*parts).flat()

    def gathered(self, g: Array, poses: Array) -> Array:
        """Return Γᵀ g (c, n) of columns g (deviations, c).

        Args:
            poses: The pose's rows (3 N, base).
        """
        nu_dot, _, joints, nu = (np.moveaxis(g[index], 0, -1) for index in self.indices)
        found = nu_dot + nu @ self._speeds  # (dof, c, N)
        found[self.model.base :] += joints @ self._positions
        found = np.moveaxis(found, 1, 0).reshape(g.shape[1], -1)
        found[:, : self.base] += g[self.indices.pose.ravel()].T @ poses
        return np.asarray(found)

    def pose_rows(self, jacobian: Array) -> Array:
        """Return the rows (3 N, base) of Γ of the pose, by the u that move the base."""
        rows = self._poses(jacobian, self.gamma[:, : self.base], self._unmoved)
        return rows.reshape(BASE_NV * self.model.steps, self.base)

    def embedded(self, jacobian: Array, start: StateDifference) -> Array:
        """Return x₀ (deviations, c): what initial differences lead to."""
        columns = start.nu.shape[1]
        model, at, x = self.model, self.indices, np.zeros((self.deviations, columns))
        x[at.nu] = start.nu
        later = model.dt * np.arange(1, model.steps + 1)[:, None, None]
        x[at.joints] = start.joints + later * start.nu[model.base :]
        x[at.pose] = self._poses(jacobian, x, start)
        return x

    def _poses(self, jacobian: Array, x: Array, start: StateDifference) -> Array:
        """Return the poses' deviations (N, 3, c), given the others' (deviations, c)."""
        at, model = self.indices, self.model
        angles, rates = (
            np.concatenate([first[None, :count], x[index[:-1, :count]]])
            for first, index, count in (
                (start.joints, at.joints, model.steered),
                (start.nu, at.nu, model.base_columns),
            )
        )
        beside = np.concatenate([angles, rates, x[at.nu_dot[:, : model.base_columns]]], axis=1)
        moves = jacobian[:, :, 1:] @ beside
        heading = start.pose[2] + np.cumsum(moves[:, 2], axis=0)
        before = np.concatenate([start.pose[None, 2], heading[:-1]])
        moves += jacobian[:, :, :1] * before[:, None]
        return np.asarray(start.pose + np.cumsum(moves, axis=0))


class CondensedSolution(NamedTuple):
    """Solution of the QP.

    Attributes:
        x: Deviations, then slacks.
        active: Numbers of the bounds that hold it, as of :meth:`CondensedQp.solve`.
        solved: Whether it is the solution.
        rounds: How often broken bounds were added.
    """

    x: Array
    active: Indices
    solved: bool
    rounds: int


class CondensedQp:
    """A QP about one motion, its Hessian factored."""

    def __init__(self, structure: CondensedStructure, values: Linearisation) -> None:
        self._structure = structure
        self._poses = poses = structure.pose_rows(values.jacobian)
        if structure.base:
            weighted = structure.weights[structure.indices.pose].reshape(-1, 1) * poses
            self._factor, _ = dpotrf(structure.base_block + poses.T @ weighted, lower=1)
        rows = [each.jacobian @ self._gamma(each.unknowns) for each in values.extra]
        n = structure.gamma.shape[1]
        self._extra = np.vstack([np.zeros((0, n)), *(row.reshape(-1, n) for row in rows)])
        self._tied = self._untied(self._extra.T)
        self._capacitance = np.linalg.inv(np.eye(len(self._extra)) + self._extra @ self._tied)

        of_stages = [each.value.shape[1] for each in values.soft for _ in each.value]
        self._slacks = np.zeros(len(of_stages))
        self._slack_of_rows = np.repeat(np.arange(len(of_stages)), of_stages)

    def _gamma(self, deviations: Indices) -> Array:
        """Return rows (..., n) of Γ."""
        rows, structure = self._structure.gamma[deviations], self._structure
        pose = structure.pose_row[deviations]
        rows[pose >= 0, : structure.base] = self._poses[pose[pose >= 0]]
        return np.asarray(rows)

    def _untied(self, right: Array) -> Array:
        """Return the columns (n, m) over the Hessian without further errors."""
        (joints, n, _), base = self._structure.arm_inverse.shape, self._structure.base
        found = np.empty_like(right)
        if base:
            found[:base], _ = dpotrs(self._factor, right[:base], lower=1)
        arm = self._structure.arm_inverse @ right[base:].reshape(joints, n, right.shape[1])
        found[base:] = arm.reshape(joints * n, right.shape[1])
        return found

    def _solved(self, right: Array) -> Array:
        """Return the columns (n, m) over the Hessian."""
        found = self._untied(right)
        return np.asarray(found - self._tied @ (self._capacitance @ (self._extra @ found)))

    def solve(self, values: Linearisation, guess: Indices) -> CondensedSolution:
        """Return the solution.

        Args:
            values: Errors, values and bounds; derivatives are those factored.
            guess: Numbers of bounds that may be active: lower bounds of the deviations, upper ones,
                then the soft rows.
        """
        structure = self._structure
        errors = structure.weigh(values.errors.flat()[:, None])
        slopes = structure.gathered(errors, self._poses)[0]
        slopes += self._extra.T @ _rows_at(np.zeros(structure.deviations), values.extra)
        free = -self._solved(slopes[:, None])[:, 0]
        x, excess = self._after(values, free)
        above, slacks = excess, self._slacks
        candidates, active = guess[:0], guess[:0]
        for rounds in range(MAX_ROUNDS):
            broken = np.flatnonzero(above > BROKEN)
            if not len(broken):
                return CondensedSolution(np.concatenate([x, slacks]), active, True, rounds)
            candidates = np.union1d(candidates if rounds else guess, broken)
            found = self._within(values, candidates, free, excess)
            if found is None:
                break
            u, slacks, active = found
            x, above = self._after(values, u)
            above[2 * len(x) :] -= slacks[self._slack_of_rows]
        return CondensedSolution(np.concatenate([x, slacks]), guess[:0], False, rounds)

    def gain(self, values: Linearisation, active: Indices) -> Array:
        """Return the derivatives (dof, 3 + n_joints + dof) of the first ν̇ by the initial state.

        The bounds that hold the solution go on to hold it.

        Args:
            values: As of :meth:`solve`.
            active: Numbers of the bounds that hold the solution.
        """
        structure, model = self._structure, self._structure.model
        joints, dof = len(model.joints), model.robot.dof
        parts = np.split(np.eye(BASE_NV + joints + dof), [BASE_NV, BASE_NV + joints])
        x0 = structure.embedded(values.jacobian, StateDifference(*parts))
        slopes = structure.gathered(structure.weigh(x0), self._poses)
        extra = [(each.jacobian @ x0[each.unknowns]).reshape(-1, len(slopes))
                 for each in values.extra]  # fmt: skip
        moved = slopes.T + self._extra.T @ np.vstack([x0[:0], *extra])
        found = -self._solved(moved)
        if len(active):
            A, beside = self._rows(values, active), self._rows(values, active, x0.__getitem__)
            pull = self._solved(A.T)
            found -= pull @ np.linalg.lstsq(A @ pull, A @ found + beside, rcond=None)[0]
        return np.asarray(found[:: model.steps])

    def _after(self, values: Linearisation, u: Array) -> tuple[Array, Array]:
        """Return x, and by how much it exceeds each of the bounds."""
        x = self._structure.spread(u, self._poses)
        rows = _rows_at(x, values.soft)
        return x, np.concatenate([values.lower.flat() - x, x - values.upper.flat(), rows])

    def _rows(
        self,
        values: Linearisation,
        candidates: Indices,
        by: Callable[[Indices], Array] | None = None,
    ) -> Array:
        """Return the derivatives (m, n) of bounds by u, of the numbers given.

        Args:
            by: What returns rows (..., n) of the deviations' derivatives; None takes Γ.
        """
        by = by or self._gamma
        count = self._structure.deviations
        lower, upper, soft = np.split(candidates, np.searchsorted(candidates, [count, 2 * count]))
        rows, soft = [-by(lower), by(upper - count)], soft - 2 * count
        for each in values.soft:
            here, soft = np.split(soft, np.searchsorted(soft, [each.value.size]))
            soft = soft - each.value.size
            stage, row = np.unravel_index(here, each.value.shape)
            jacobian = each.jacobian[stage, row][:, None]
            rows.append((jacobian @ by(each.unknowns[stage]))[:, 0])
        return np.vstack(rows)

    def _within(
        self, values: Linearisation, candidates: Indices, free: Array, excess: Array
    ) -> tuple[Array, Array, Indices] | None:
        """Return accelerations, slacks and active bounds of the QP with these bounds alone.

        A slack s belongs to all soft rows of its stage; with its own bound −s ≤ 0, it is one more
        unknown whose block of the Hessian is its curvature.

        Args:
            candidates: Numbers of the bounds, ascending.
            free: Solution without bounds (n,).
            excess: By how much it exceeds each of all bounds.
        """
        A, first = self._rows(values, candidates), 2 * self._structure.deviations
        soft = candidates[candidates >= first] - first
        used, place = np.unique(self._slack_of_rows[soft], return_inverse=True)
        m = len(candidates)
        by_slack = np.zeros((m + len(used), len(used)))  # minus the rows' derivatives by slacks
        by_slack[np.arange(m - len(place), m), place] = 1.0
        by_slack[m:] = np.eye(len(used))
        pull = self._solved(A.T)
        W = by_slack @ by_slack.T / SLACK_CURVATURE
        W[:m, :m] += A @ pull
        room = by_slack.sum(axis=1) * FREE_SLACK
        room[:m] -= excess[candidates]
        multipliers = least_multipliers(W, room)
        if multipliers is None:
            return None
        slacks = self._slacks.copy()
        slacks[used] = np.maximum(FREE_SLACK + by_slack.T @ multipliers / SLACK_CURVATURE, 0.0)
        u = free - pull @ multipliers[:m]
        return u, slacks, candidates[multipliers[:m] > 0.0]


def least_multipliers(W: Array, room: Array) -> Array | None:
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
