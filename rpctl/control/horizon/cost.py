"""The cost of the horizon law: weights, and the errors that they are of."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model, StageValues
from rpctl.control.horizon.qp import LinearRows
from rpctl.control.horizon.settings import Weights
from rpctl.control.horizon.target import Sample
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
        self._dt = model.dt
        self._end_effector = weights.end_effector * model.steps / stage_count
        base = model.base
        position = [weights.position, weights.position, weights.heading]
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

    def errors(self, sample: Sample) -> StageValues:
        """Return what a motion is off its target by; of ν̇ off the target's."""
        motion, target = sample.motion, sample.target
        pose = motion.pose[1:] - target.pose[1:]
        pose[:, 2] = wrap_angles(pose[:, 2])
        joints = motion.joints[1:] - target.joints[1:]
        joints[:, self._continuous] = wrap_angles(joints[:, self._continuous])
        nu_dot = motion.nu_dot - np.diff(target.nu, axis=0) / self._dt
        return StageValues(nu_dot, pose, joints, motion.nu[1:] - target.nu[1:])

    def end_effector_errors(self, positions: LinearRows, goals: Array) -> LinearRows:
        """Return the end effector's errors, weighted."""
        root = math.sqrt(self._end_effector)
        errors = root * (positions.value - goals)
        return LinearRows(positions.unknowns, errors, root * positions.jacobian)


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
