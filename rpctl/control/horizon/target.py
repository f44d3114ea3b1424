"""Targets of one sample: the reference over the horizon, and detours round obstacles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.control.obstacles import Obstacle
from rpctl.reference.motion import Reference
from rpctl.reference.quasi_velocities import reference_rates, steering


class TimeScaling(NamedTuple):
    """Reference times at the ends of the N steps, and the rates of reference time there."""

    times: Array  # (N + 1,) s
    paces: Array  # (N + 1,) seconds of reference time a second


class Target(NamedTuple):
    """The reference at the start and after each of the N steps."""

    pose: Array  # (N + 1, 3) of P
    joints: Array  # (N + 1, n_joints)
    nu: Array  # (N + 1, dof)


class EndEffectorPoints(NamedTuple):
    """The end effector after some steps, with its derivatives by pose and joints."""

    positions: Array  # (K, 3) m
    goals: Array  # (K, 3) m, where it should be
    jacobian: Array  # (K, 3, 3 + n_joints), or (K, 3, n_joints) for a fixed base


class Sample(NamedTuple):
    """The predicted motion and its target, about which a QP is linearised."""

    motion: PredictedMotion
    target: Target
    end_effector: EndEffectorPoints | None


def look_ahead(
    model: Model, reference: Reference, time_scaling: TimeScaling, joints: Array
) -> Target:
    """Return the reference at the start and after each step.

    Args:
        model: The prediction's model.
        reference: The reference.
        time_scaling: Reference times and their rates.
        joints: Present positions (n_joints,). Steering angles are unwrapped modulo π from there,
            because a wheel may as well roll backwards.
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
    """The end effector along predicted motions; holds Pinocchio's workspace.

    Args:
        model: The prediction's model, of a robot with an end effector.
        stages: Stages at which the end effector is computed.
    """

    def __init__(self, model: Model, stages: list[int]) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._frame = robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)
        self._after = [k + 1 for k in stages]

    def end_effector(self, motion: PredictedMotion, target: Target) -> EndEffectorPoints:
        """Return the end effector along a motion and where its target has it."""
        found = [self.jacobian(motion.pose[k], motion.joints[k]) for k in self._after]
        goals = [self.position(target.pose[k], target.joints[k]) for k in self._after]
        positions, jacobian = zip(*found, strict=True)
        return EndEffectorPoints(np.array(positions), np.array(goals), np.array(jacobian))

    def position(self, pose: Array, joints: Array) -> Array:
        """Return its position (3,), m, at a pose of P (3,) and joints (n_joints,)."""
        model = self._model.robot.model
        pin.forwardKinematics(model, self._data, self._model.configuration(joints, pose))
        return pin.updateFramePlacement(model, self._data, self._frame).translation.copy()

    def jacobian(self, pose: Array, joints: Array) -> tuple[Array, Array]:
        """Return its position (3,), m, and the derivatives by pose and joints (3, 3 + n_joints)."""
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


def base_detour(
    target: Target, start: Array, obstacles: tuple[Obstacle, ...], radius: float, turns: bool
) -> Target:
    """Return the target with goals behind an obstacle replaced by a detour around it.

    Args:
        target: The reference ahead.
        start: Present position of P (2,), m.
        obstacles: Obstacles of the base.
        radius: Radius of the base, m.
        turns: Whether the base heads where it drives, or away from there if the reference reverses.
    """
    goals = target.pose[:, :2]
    for obstacle in obstacles:
        goals = obstacle.around(start, goals, radius)
    changed = (goals != target.pose[:, :2]).any(axis=1)
    if not changed.any():
        return target
    pose = target.pose.copy()
    pose[:, :2] = goals
    if turns:
        ahead = goals - start
        back = np.where(target.nu[:, 0] < 0.0, math.pi, 0.0)
        pose[:, 2] = np.where(changed, np.arctan2(ahead[:, 1], ahead[:, 0]) + back, pose[:, 2])
    return target._replace(pose=pose)


def arm_detour(
    end_effector: EndEffectorPoints, obstacles: tuple[Obstacle, ...], radius: float
) -> EndEffectorPoints:
    """Return the end effector with goals behind an obstacle replaced by a detour around it.

    Args:
        end_effector: The end effector and its goals.
        obstacles: Obstacles of the end effector.
        radius: Radius of the end effector, m.
    """
    goals = end_effector.goals.copy()
    for obstacle in obstacles:
        goals[:, :2] = obstacle.around(end_effector.positions[0, :2], goals[:, :2], radius)
    return end_effector._replace(goals=goals)
