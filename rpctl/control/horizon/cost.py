"""The cost of the horizon law, its gradient, and its QP from another initial state.

The difference of the initial states runs on along the linearised prediction. What is left to the
accelerations are deviations from there: the QP keeps its Hessian and its rows, and gets other
values ([DBS05], initial value embedding).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model, PoseJacobian
from rpctl.control.horizon.qp import CondensedStructure, LeastSquares, Linearisation, StageValues
from rpctl.control.horizon.settings import Weights
from rpctl.control.horizon.target import EndEffectorPoints, Sample
from rpctl.errors import SolverError


class Cost:
    """Half the weighted sum over the steps of squared errors and of squared accelerations.

    Accelerations are relative to the reference's. The terminal cost stands for everything beyond
    the horizon: for each coordinate it is the cost-to-go (Riccati solution) of a double integrator
    with the same weights.

    Args:
        stage_count: Number of stages with a cost of the end effector, which share its weight.
    """

    def __init__(self, weights: Weights, model: Model, stage_count: int) -> None:
        self._model = model
        self._end_effector = weights.end_effector * model.steps / stage_count
        base = model.base
        position = [weights.position, weights.position, weights.heading][: 3 if base else 0]
        pose = np.tile(position, (model.steps, 1))
        of_joints = np.full(len(model.joints), weights.joints)
        of_joints[: model.steered] = weights.steering
        joints = np.tile(of_joints, (model.steps, 1))
        nu = np.full((model.steps, model.robot.dof), weights.rates)
        rest = {w: _cost_to_go(w, weights, model.dt) for w in {*position, *of_joints.tolist()}}
        pose[-1] = [rest[w][0, 0] for w in position]
        joints[-1] = [rest[w][0, 0] for w in of_joints]
        nu[-1, base:] = [rest[w][1, 1] for w in of_joints]
        nu[-1, :base] = max(P[1, 1] for P in rest.values())
        self.hessian = StageValues(np.full(nu.shape, weights.accelerations), pose, joints, nu)
        self.cross = np.array([rest[w][0, 1] for w in of_joints])
        continuous = (i for i, joint in enumerate(model.joints) if joint.kind == "continuous")
        self._continuous = [i for i in continuous if i >= model.steered]  # the arm's

    def gradient(self, sample: Sample) -> StageValues:
        """Return the gradient of the cost without the end effector's."""
        motion, target, model = sample.motion, sample.target, self._model
        pose = motion.pose[1:] - target.pose[1:]
        pose[:, 2] = wrap_angles(pose[:, 2])
        joints = motion.joints[1:] - target.joints[1:]
        joints[:, self._continuous] = wrap_angles(joints[:, self._continuous])
        nu = motion.nu[1:] - target.nu[1:]
        nu_dot = motion.nu_dot - np.diff(target.nu, axis=0) / model.dt
        hessian = self.hessian
        of_joints, of_nu = hessian.joints * joints, hessian.nu * nu
        of_joints[-1] += self.cross * nu[-1, model.base :]
        of_nu[-1, model.base :] += self.cross * joints[-1]
        of_pose = hessian.pose * pose[:, : hessian.pose.shape[1]]
        return StageValues(hessian.nu_dot * nu_dot, of_pose, of_joints, of_nu)

    def end_effector_cost(self, end_effector: EndEffectorPoints | None) -> list[LeastSquares]:
        """Return the cost of the end effector's error at its stages; empty without one."""
        if end_effector is None:
            return []
        root = math.sqrt(self._end_effector)
        errors = root * (end_effector.positions - end_effector.goals)
        return list(map(LeastSquares, root * end_effector.jacobian, errors))


def _cost_to_go(weight: float, weights: Weights, dt: float) -> Array:
    """Return the cost-to-go (2, 2) of a double integrator's position and rate."""
    A, B = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[0.5 * dt**2], [dt]])
    Q, R = np.diag([weight, weights.rates]), np.array([[weights.accelerations]])
    try:
        return np.asarray(solve_discrete_are(A, B, Q, R))
    except (ValueError, np.linalg.LinAlgError) as error:  # what LAPACK answers differs by machine
        raise SolverError(
            f"weights of {weight:g} for positions, {weights.rates:g} for rates and "
            f"{weights.accelerations:g} for accelerations have no cost beyond the horizon with "
            f"steps of {dt:g} s ({error}); bring them nearer to each other"
        ) from None


def wrap_angles(angles: Array) -> Array:
    """Return angles (rad) wrapped into (−π, π]."""
    return math.pi - (math.pi - angles) % (2.0 * math.pi)


class StateDifference(NamedTuple):
    """Initial state less that of the motion that a QP is linearised about."""

    pose: Array  # (3,) m, m, rad
    joints: Array  # (n_joints,)
    nu: Array  # (dof,)


def from_another_start(
    structure: CondensedStructure, values: Linearisation, start: StateDifference
) -> Linearisation:
    """Return the QP for deviations from what a difference of the initial states leads to."""
    free = _free_response(structure, values.jacobian, start)
    hessian, base = structure.hessian, structure.model.base
    g_joints = values.gradient.joints + hessian.joints * free.joints
    g_nu = values.gradient.nu + hessian.nu * free.nu
    g_joints[-1] += structure.cross * free.nu[-1, base:]
    g_nu[-1, base:] += structure.cross * free.joints[-1]
    gradient = StageValues(
        values.gradient.nu_dot, values.gradient.pose + hessian.pose * free.pose, g_joints, g_nu
    )
    x = np.hstack(free).ravel()
    costs = zip(structure.extra_unknowns, values.extra_cost, strict=True)
    rows = zip(structure.soft, values.soft, strict=True)
    return Linearisation(
        values.jacobian,
        gradient,
        [cost._replace(residual=cost.residual + cost.jacobian @ x[at]) for at, cost in costs],
        [
            soft._replace(value=soft.value + (soft.jacobian @ x[block.unknowns, None])[..., 0])
            for block, soft in rows
        ],
        StageValues(*(bound - part for bound, part in zip(values.lower, free, strict=True))),
        StageValues(*(bound - part for bound, part in zip(values.upper, free, strict=True))),
    )


def _free_response(
    structure: CondensedStructure, jacobian: PoseJacobian, start: StateDifference
) -> StageValues:
    """Return the deviations that an initial difference leads to under the same accelerations."""
    model, n = structure.model, structure.model.steps
    nu, rates = np.tile(start.nu, (n, 1)), start.nu[model.base :]
    joints = start.joints + model.dt * np.outer(np.arange(n + 1), rates)
    pose = np.empty((n, 0))
    if model.base:
        angles = joints[:-1, : model.steered, None]
        turned = jacobian.nu @ start.nu[: model.base_columns]
        turned += (jacobian.steering @ angles)[:, :, 0]
        first = np.append(start.pose[:2], wrap_angles(start.pose[2:]))
        heading = first[2] + np.concatenate([[0.0], np.cumsum(turned[:, 2])])
        moved = turned[:, :2] + jacobian.heading * heading[:-1, None]
        pose = np.column_stack([first[:2] + np.cumsum(moved, axis=0), heading[1:]])
    return StageValues(np.zeros_like(nu), pose, joints[1:], nu)
