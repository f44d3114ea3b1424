"""One sample of the horizon law: the motion predicted, the reference ahead, and the reach."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.reference.motion import Reference
from rpctl.reference.quasi_velocities import reference_rates, steering


class TimeScaling(NamedTuple):
    """When to read the reference at the ends of N steps, and how fast its time runs there."""

    times: Array  # (N + 1,) s
    paces: Array  # (N + 1,)


class Target(NamedTuple):
    """A reference at the N + 1 ends of the steps."""

    pose: Array  # (N + 1, 3) of P
    joints: Array  # (N + 1, n_joints)
    nu: Array  # (N + 1, dof)


class EndEffectorPoints(NamedTuple):
    """The end effector after some steps, with its derivatives by pose and joints."""

    positions: Array  # (K, 3) m
    goals: Array  # (K, 3) m, where it should be
    jacobian: Array  # (K, 3, 3 + n_joints), or (K, 3, n_joints) for a fixed base


class Sample(NamedTuple):
    """What a QP is written about."""

    motion: PredictedMotion
    target: Target
    end_effector: EndEffectorPoints | None


def look_ahead(
    model: Model, reference: Reference, time_scaling: TimeScaling, joints: Array
) -> Target:
    """Return a reference read at the ends of the steps.

    Args:
        model: The prediction's model.
        reference: The reference.
        time_scaling: When to read it.
        joints: The joints' positions now (n_joints,). A wheel that heads back rolls along as well,
            so steering angles are asked for that lie nearest to those before, modulo π.
    """
    robot, count = model.robot, model.steered
    states = [reference(t) for t in time_scaling.times.tolist()]
    pose, arm = np.array([state.pose for state in states]), [state.joints for state in states]
    nu = time_scaling.paces[:, None] * [reference_rates(robot, state).nu for state in states]
    if not count:
        return Target(pose, np.array(arm), nu)
    angles = np.array([steering(robot, state)[0] for state in states])
    near = np.unwrap(np.vstack([joints[:count], angles]), axis=0, period=math.pi)[1:]
    if not robot.drive.has_axle:  # the base's speed is the first wheel's, along its own heading
        nu[:, 0] *= np.where(np.rint((near[:, 0] - angles[:, 0]) / math.pi) % 2.0, -1.0, 1.0)
    return Target(pose, np.hstack([near, arm]), nu)


class EndEffectorKinematics:
    """Finds the end effector along motions; owns a workspace.

    Args:
        model: The prediction's model, of a robot with an end effector.
        stages: Steps after which it is looked at.
    """

    def __init__(self, model: Model, stages: list[int]) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._frame = robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)
        self._after = [k + 1 for k in stages]

    def end_effector(self, motion: PredictedMotion, target: Target) -> EndEffectorPoints:
        """Return the end effector along a motion and its target."""
        found = [self.jacobian(motion.pose[k], motion.joints[k]) for k in self._after]
        goals = [self.position(target.pose[k], target.joints[k]) for k in self._after]
        positions, jacobian = zip(*found, strict=True)
        return EndEffectorPoints(np.array(positions), np.array(goals), np.array(jacobian))

    def position(self, pose: Array, joints: Array) -> Array:
        """Return where it is (3,), m, at a pose of P and positions of the joints."""
        model = self._model.robot.model
        pin.forwardKinematics(model, self._data, self._model.configuration(joints, pose))
        return pin.updateFramePlacement(model, self._data, self._frame).translation.copy()

    def jacobian(self, pose: Array, joints: Array) -> tuple[Array, Array]:
        """Return where it is (3,), m, and its derivatives (3, 3 + n_joints)."""
        model, data = self._model.robot.model, self._data
        pin.computeJointJacobians(model, data, self._model.configuration(joints, pose))
        position = pin.updateFramePlacement(model, data, self._frame).translation.copy()
        J = pin.getFrameJacobian(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        by_joints = J[:3] @ self._model.joint_columns
        if not self._model.base:
            return position, by_joints
        by_pose = np.eye(3)
        by_pose[:, 2] = pose[1] - position[1], position[0] - pose[0], 0.0
        return position, np.hstack([by_pose, by_joints])
