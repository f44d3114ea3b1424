"""The Lagrange-multiplier path: the full tree under A(q) v = 0, all coordinates kept.

M v̇ + b = f + Aᵀ λ, with f of actuators and losses, together with A v̇ = −Ȧ v. Redundant rows of A
(two wheels on one axle) leave the accelerations as they are and make single multipliers
indeterminate; the shortest λ is returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve, qr

from rpctl.arrays import Array
from rpctl.dynamics.rolling import RollingConstraints, constraint, constraint_drift
from rpctl.robot.model import Robot

# The oracle's own margin, of the largest: below it a row of A, seen through M⁻¹, repeats others.
RANK_MARGIN = 1e-9


@dataclass(frozen=True)
class ConstrainedMotion:
    """What the constraints make of the efforts.

    Attributes:
        v_dot: Acceleration of the tree (nv,).
        multipliers: λ (rows,), the shortest that fits; N for wheels, N·m or N for mimic joints.
        force: Aᵀ λ (nv,), which is determinate.
    """

    v_dot: Array
    multipliers: Array
    force: Array


def constrained_motion(
    robot: Robot, rolling: RollingConstraints, q: Array, v: Array, push: Array
) -> ConstrainedMotion:
    """Solve the tree's equations with multipliers, whatever the rank of A.

    Args:
        push: Generalised force (nv,) of actuators and losses, N·m or N.
    """
    data = robot.model.createData()
    A, drift = _rows(rolling, q, v)
    force = push - pin.nonLinearEffects(robot.model, data, q, v)
    M = pin.crba(robot.model, data, q)
    factor = cho_factor(M)
    response = cho_solve(factor, A.T)  # acceleration by each multiplier (nv, rows)
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("ij,ji->i", A, response), np.finfo(float).tiny))
    mobility = scale[:, None] * (A @ response) * scale
    inverse = np.linalg.pinv(mobility, rcond=RANK_MARGIN, hermitian=True)
    v_dot, multipliers = np.zeros(len(v)), np.zeros(len(A))
    # What the constraints take back of the free acceleration may be nearly all: the first pass
    # loses those digits, the second solves for what is left of both equations.
    for _ in range(2):
        free = cho_solve(factor, force - M @ v_dot + A.T @ multipliers)
        more = scale * (inverse @ (scale * (-drift - A @ (v_dot + free))))
        v_dot, multipliers = v_dot + free + response @ more, multipliers + more
    return ConstrainedMotion(v_dot, multipliers, A.T @ multipliers)


def pinocchio_motion(
    robot: Robot, rolling: RollingConstraints, q: Array, v: Array, push: Array
) -> Array:
    """Return v̇ (nv,) by Pinocchio's own constrained dynamics.

    It is well posed for independent rows only, so as many rows of A are handed over as A has rank.

    Args:
        push: Generalised force (nv,) of actuators and losses, N·m or N.
    """
    data = robot.model.createData()
    A, drift = _rows(rolling, q, v)
    if not len(A):
        return np.asarray(pin.aba(robot.model, data, q, v, push))
    _, triangle, order = qr(A.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    rows = order[: np.count_nonzero(sizes > RANK_MARGIN * sizes[0])]
    acceleration = pin.forwardDynamics(
        robot.model, data, q, v, push, np.ascontiguousarray(A[rows]), drift[rows]
    )
    return np.asarray(acceleration).copy()


def _rows(rolling: RollingConstraints, q: Array, v: Array) -> tuple[Array, Array]:
    """Return A (rows, nv) and Ȧ v (rows,)."""
    return constraint(rolling, q), constraint_drift(rolling, q, v)


def effort_columns(robot: Robot) -> Array:
    """Return B_q (nv, n_act): the generalised force of each actuator's unit effort."""
    columns = np.zeros((robot.nv, len(robot.actuators)))
    for column, name in enumerate(robot.actuators):
        columns[robot.velocity_index(name), column] = 1.0
    return columns
