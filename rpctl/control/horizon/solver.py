"""The horizon law's QP in its accelerations alone, solved by its active bounds.

The states of the prediction follow from the accelerations u, δx = Γ u, so the QP is

    minimise ½ uᵀ H u + gᵀ u   with   a u ≤ b for all bounds,    H = D + EᵀE.

D has a block for the base and one for each joint of the arm, which does not depend on the motion
and is inverted once. E are the end effector's errors at a few stages, which tie the blocks
together; they enter by the Woodbury identity.

Few of the bounds are ever active. The QP is solved without bounds first; those that its solution
breaks become candidates, and with their rows A, W = A H⁻¹ Aᵀ and d = b − A u₀ what is left is

    minimise ½ λᵀ W λ + dᵀ λ   over λ ≥ 0,    u = u₀ − H⁻¹ Aᵀ λ.

Every bound is then checked again, and those broken join the candidates, until none is: the solution
is that of the whole QP.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices
from rpctl.control.horizon.qp import (
    SLACK_CURVATURE,
    SLACK_PRICE,
    CondensedStructure,
    Linearisation,
)

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
