"""The horizon law's whole QP, dense: deviations of all stages under their dynamics, and slacks.

It is the referee of the condensed one, with which it shares no step but the values.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.planner import Planner
from rpctl.control.horizon.qp import SLACK_CURVATURE, SLACK_PRICE, Linearisation

EQUALITY, OPTIMAL = 5, 1  # DAQP's names for them
NO_BOUND = 1e30  # DAQP's
TOLERANCE = 1e-10


class WholeQp(NamedTuple):
    """minimise ½ xᵀP x + cᵀx with A x = b, G x ≤ h, lower ≤ x ≤ upper."""

    P: Array
    c: Array
    A: Array
    b: Array
    G: Array
    h: Array
    lower: Array
    upper: Array

    def solution(self) -> Array:
        """Return x."""
        low = np.concatenate([self.lower, self.b, np.full(len(self.h), -NO_BOUND)])
        high = np.concatenate([self.upper, self.b, self.h])
        sense = np.zeros(len(low), dtype=np.intc)
        sense[len(self.c) : len(self.c) + len(self.b)] = EQUALITY
        low, high = np.maximum(low, -NO_BOUND), np.minimum(high, NO_BOUND)
        rows = np.vstack([self.A, self.G])
        x, _, flag, _ = daqp.solve(
            self.P, self.c, rows, high, low, sense, primal_tol=TOLERANCE, dual_tol=TOLERANCE
        )
        assert flag == OPTIMAL
        return np.asarray(x)

    def free_solution(self, count: int) -> Array:
        """Return the first ``count`` entries, those before the slacks, without inequalities."""
        P, A, none = self.P[:count, :count], self.A[:, :count], np.zeros((len(self.b),) * 2)
        right = np.concatenate([-self.c[:count], self.b])
        return np.asarray(np.linalg.solve(np.block([[P, A.T], [A, none]]), right)[:count])


def whole_qp(planner: Planner, values: Linearisation) -> WholeQp:
    structure, at = planner.structure, planner.structure.indices
    count = structure.deviations + sum(len(rows.value) for rows in values.soft)
    P, c = SLACK_CURVATURE * np.eye(count), np.full(count, SLACK_PRICE)
    lower, upper = np.zeros(count), np.full(count, np.inf)
    errors = np.zeros(count)
    parts = zip(at, planner.cost.hessian, values.errors, values.lower, values.upper, strict=True)
    for index, weight, error, low, high in parts:
        P[index, index], errors[index], lower[index], upper[index] = weight, error, low, high
    last = at.joints[-1], at.nu[-1, planner.model.base :]
    P[last], P[last[::-1]] = planner.cost.cross, planner.cost.cross
    c[: structure.deviations] = (P @ errors)[: structure.deviations]
    for further in values.extra:
        for unknowns, residual, J in zip(*further, strict=True):
            P[np.ix_(unknowns, unknowns)] += J.T @ J
            c[unknowns] += J.T @ residual
    A = _dynamics(planner, values, np.eye(count))
    slack = structure.deviations
    rows: list[Array] = [np.empty((0, count))]
    right: list[Array] = [np.empty(0)]
    for soft in values.soft:
        for unknowns, value, by in zip(*soft, strict=True):
            row = np.zeros((len(value), count))
            row[:, unknowns], row[:, slack] = by, -1.0
            rows.append(row)
            right.append(-value)
            slack += 1
    return WholeQp(P, c, A, np.zeros(len(A)), np.vstack(rows), np.concatenate(right), lower, upper)


def _dynamics(planner: Planner, values: Linearisation, I: Array) -> Array:  # noqa: E741 (unit matrix)
    """Return the rows of pose, joints and ν after each step, less what the step before makes."""
    model, J, at = planner.model, values.jacobian, planner.structure.indices
    base, columns, dt, rows = model.base, model.base_columns, model.dt, []
    for k in range(model.steps):
        heading, angles, rates, forces = np.split(
            J[k], np.cumsum([1, model.steered, columns]), axis=1
        )
        pose, nu = I[at.pose[k]], I[at.nu[k]] - dt * I[at.nu_dot[k]]
        pose = pose - forces @ I[at.nu_dot[k, :columns]]
        joints = I[at.joints[k]] - 0.5 * dt**2 * I[at.nu_dot[k, base:]]
        if k:
            nu = nu - I[at.nu[k - 1]]
            joints = joints - I[at.joints[k - 1]] - dt * I[at.nu[k - 1, base:]]
            pose = pose - I[at.pose[k - 1]] - rates @ I[at.nu[k - 1, :columns]]
            pose -= angles @ I[at.joints[k - 1, : model.steered]]
            pose -= heading @ I[at.pose[k - 1, 2:]]
        rows.append(np.vstack([pose, joints, nu]))
    return np.vstack(rows)
