"""Kinematics of the end effector: reference motion, Jacobian and tracking velocity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.box_least_squares import WithRate
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import BASE_NV, Robot

WORLD_ALIGNED = pin.LOCAL_WORLD_ALIGNED  # velocities of the frame's origin, in world axes


class FrameMotion(NamedTuple):
    """A frame's motion in the world: linear, then angular."""

    pose: pin.SE3
    velocity: Array  # (6,) m/s, rad/s
    acceleration: Array  # (6,) m/s² of the origin, rad/s²


class FrameJacobian(NamedTuple):
    """A frame's pose, its Jacobian and the Jacobian's derivative along a motion."""

    pose: pin.SE3
    J: Array  # (6, nv)
    J_dot: Array  # (6, nv)


def end_effector_frame(robot: Robot) -> int:
    """Return Pinocchio's index of the end effector.

    Raises:
        RpctlError: The robot has none.
    """
    if robot.end_effector is None or not robot.joints:
        raise RpctlError(
            f"{robot.name} has no arm, so no end effector to put first; take a kinematic law of "
            'the base alone, such as "paper"'
        )
    return int(robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY))


def reference_motion(
    dynamics: ReducedDynamics, state: ReferenceState, arm: Array, frame: int
) -> FrameMotion:
    """Return the motion of the end effector of a robot that is on its reference.

    Args:
        dynamics: The robot's dynamics; its workspace is overwritten.
        state: The reference.
        arm: The arm's columns of S (nv, n_joints), the same at every q.
        frame: Pinocchio's index of the end effector.
    """
    robot = dynamics.robot
    q = robot.configuration_at(state.pose, state.joints)
    v, a = arm @ state.joint_rates, arm @ state.joint_accelerations
    v[:BASE_NV] += robot.root_velocity @ state.twist
    a[:BASE_NV] += robot.root_velocity @ state.twist_dot
    model, data = robot.model, dynamics.placements(q)
    pin.forwardKinematics(model, data, q, v, a)
    return FrameMotion(
        pin.updateFramePlacement(model, data, frame).copy(),
        pin.getFrameVelocity(model, data, frame, WORLD_ALIGNED).vector,
        pin.getFrameClassicalAcceleration(model, data, frame, WORLD_ALIGNED).vector,
    )


def jacobian(dynamics: ReducedDynamics, q: Array, v: Array, frame: int) -> FrameJacobian:
    """Return a frame's Jacobian and its derivative along a motion.

    Args:
        dynamics: The robot's dynamics; its workspace is overwritten.
        q: Configuration (nq,).
        v: Velocity (nv,).
        frame: Pinocchio's index of the frame.
    """
    model, data = dynamics.robot.model, dynamics.placements(q)
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    return FrameJacobian(
        pin.updateFramePlacement(model, data, frame).copy(),
        pin.getFrameJacobian(model, data, frame, WORLD_ALIGNED),
        pin.getFrameJacobianTimeVariation(model, data, frame, WORLD_ALIGNED),
    )


def tracking_velocity(
    target: FrameMotion, pose: pin.SE3, velocity: Array, horizon: float
) -> WithRate:
    """Return the velocity (6,) that makes the errors of a frame decay at 1/h, and its derivative.

    The position's is p* = ṗ_r + (p_r − p)/h. With the error e = log(E), E = R_r Rᵀ, of the
    orientation, a rotation vector in the world's axes, Ė = [w]× E for w = ω_r − E ω, and

        ω* = Eᵀ ω_r + e/h

    gives w = −e/h and so ė = −e/h: a rotation vector that only changes its length. At |e| = π it
    turns over; a frame that faces away from its reference may come back either way.

    Args:
        target: Reference motion of the frame.
        pose: Present pose of the frame in the world.
        velocity: Present velocity of the frame (6,), in world axes, m/s and rad/s.
        horizon: Prediction time h, s.
    """
    position_error = target.pose.translation - pose.translation
    position_error_rate = target.velocity[:3] - velocity[:3]
    E = target.pose.rotation @ pose.rotation.T
    omega_r, rotated_omega = target.velocity[3:], E @ velocity[3:]
    rotation_error = pin.log3(E)
    # The inverse left Jacobian is the transpose of the right one.
    rotation_error_rate = pin.Jlog3(E).T @ (omega_r - rotated_omega)
    value = np.concatenate(
        [target.velocity[:3] + position_error / horizon, E.T @ omega_r + rotation_error / horizon]
    )
    linear = target.acceleration[:3] + position_error_rate / horizon
    angular = (
        E.T @ (target.acceleration[3:] + pin.skew(rotated_omega) @ omega_r)
        + rotation_error_rate / horizon
    )
    return WithRate(value, np.concatenate([linear, angular]))
