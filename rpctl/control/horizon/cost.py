"""The cost of the horizon law, and its gradient at a predicted motion."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.qp import LeastSquares, StageValues
from rpctl.control.horizon.settings import Weights
from rpctl.control.horizon.target import EndEffectorPoints, Sample


class Cost:
    """Half the weighted sum over the steps of squared errors and of squared accelerations.

    Accelerations are relative to the reference's. The terminal cost stands for everything beyond
    the horizon: for each coordinate it is the cost-to-go (Riccati solution) of a double integrator
    with the same weights.

    Args:
        weights: The weights.
        model: The prediction's model.
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
    return np.asarray(
        solve_discrete_are(
            A, B, np.diag([weight, weights.rates]), np.array([[weights.accelerations]])
        )
    )


def wrap_angles(angles: Array) -> Array:
    """Return angles (rad) wrapped into (−π, π]."""
    return math.pi - (math.pi - angles) % (2.0 * math.pi)
