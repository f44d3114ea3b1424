"""``Reference``: where base and arm should be at a time, and the quasi-velocities that takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.rows import angle_of, rolling_row
from rpctl.drive.steering import steer, trailing_positions
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

MAX_SHOWN_CHARACTERS = 80  # of a value in a message


class ReferenceState(NamedTuple):
    """A reference at one time: base and arm, each with first and second derivatives.

    The twist is P's speed forward and to the left and the turning rate, in the axes of the
    reference itself; ``twist_dot`` holds the derivatives of these three numbers.

    ``direction`` (3, 3) is a vector along the twist that does not vanish where the reference
    stands still, and its first two derivatives by time: steered wheels point along it. None where
    the twist itself is all there is to know.
    """

    pose: Array  # (3,) of P: x, y in m, heading in rad
    twist: Array  # (3,) m/s, m/s, rad/s
    twist_dot: Array  # (3,) m/s², m/s², rad/s²
    joints: Array  # (n_joints,) rad or m
    joint_rates: Array  # (n_joints,)
    joint_accelerations: Array  # (n_joints,)
    direction: Array | None = None


Reference = Callable[[float], ReferenceState]


def end_effector_reference(robot: Robot, data: pin.Data, state: ReferenceState) -> pin.SE3:
    """Return the end effector's pose in the world where base and arm are on their reference.

    Raises:
        RpctlError: The robot has no end effector.
    """
    return robot.end_effector_pose(data, robot.configuration_at(state.pose, state.joints))


class WrongAnswerError(RpctlError):
    """What a reference or a law returned has not the form that it should have."""


class NotFiniteError(RpctlError):
    """What a reference or a law returned has the right form, and numbers that are not finite."""


def require_state(robot: Robot, state: object, t: float) -> ReferenceState:
    """Return what a reference returned, if it is a ``ReferenceState`` that fits the robot.

    Raises:
        WrongAnswerError: It is something else; what to return is said.
    """
    if not isinstance(state, ReferenceState):
        raise WrongAnswerError(
            f"the reference returns {shown(state)} at t = {t:g} s; return a rpctl.ReferenceState, "
            "or let rpctl.as_reference(function) make one of x, y, heading and joints"
        )
    if np.ndim(state.joints) == 1 and len(state.joints) != len(robot.joints):
        raise WrongAnswerError(
            f"the reference has {len(state.joints)} joints, {robot.name} has {len(robot.joints)}"
        )
    for index, name in enumerate(ReferenceState._fields[:6]):
        length = 3 if index < 3 else len(robot.joints)
        require_numbers(name, " of the reference", state[index], length)
    return state


def require_numbers(name: str, whose: str, values: Any, length: int) -> None:
    """Refuse what is no array of this many finite numbers.

    Args:
        whose: Whose it is, in words that follow the name.
        length: How many numbers it has to hold.

    Raises:
        NotFiniteError: A number is not finite.
        WrongAnswerError: It is something else; what to give is said.
    """
    if not isinstance(values, np.ndarray):
        raise WrongAnswerError(
            f"{name}{whose} is {shown(values)}; give an array of {length} numbers"
        )
    if values.shape != (length,) or values.dtype.kind not in "fiu":
        raise WrongAnswerError(
            f"{name}{whose} is an array {values.shape} of {values.dtype}; "
            f"give {length} real numbers"
        )
    if not math.isfinite(values @ values):  # of so few numbers the fastest
        raise NotFiniteError(f"{name}{whose} is {shown(values)}; give finite numbers")


def shown(value: object) -> str:
    """Return a value and its type, in a few characters."""
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = f"{text[:MAX_SHOWN_CHARACTERS]}..."
    return f"{text} ({type(value).__name__})"


class ReferenceRates(NamedTuple):
    """Quasi-velocities and their derivatives."""

    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)


def reference_rates(robot: Robot, state: ReferenceState) -> ReferenceRates:
    """Return ν and ν̇ of a reference.

    Args:
        state: The reference. Where no wheel is steered its arrays may have a row an instant; so
            have those returned, then.
    """
    drive = robot.drive
    speeds = np.stack([state.twist, state.twist_dot], axis=-2)  # (..., 2, 3)
    if drive.has_axle and drive.steered:
        base = np.hstack([speeds[:, :1], steering(robot, state)[1:]])
    elif drive.steered:
        turned = steering(robot, state)
        base = np.hstack([_rolling_speed(robot, speeds, turned)[:, None], turned[1:]])
    else:
        count = len(drive.base_speeds)
        base = speeds[..., [0, 2]] if drive.has_axle else speeds[..., :count]
    arm = np.stack([state.joint_rates, state.joint_accelerations], axis=-2)
    found = np.concatenate([base, arm], axis=-1)
    return ReferenceRates(found[..., 0, :], found[..., 1, :])


def steering(robot: Robot, state: ReferenceState) -> Array:
    """Return positions, rates and accelerations (3, n_steered) of a reference's steered joints."""
    if not robot.drive.steered:
        return np.zeros((3, 0))
    return steer(robot.drive, direction(state) @ robot.root_velocity.T)


def trailing(robot: Robot, state: ReferenceState) -> Array:
    """Return the positions (n_powered_casters,) at which a reference's casters trail, rad."""
    if not robot.drive.powered_casters:
        return np.zeros(0)
    return trailing_positions(robot.drive, robot.root_velocity @ direction(state)[0])


def configuration_along(robot: Robot, state: ReferenceState, pose: Array | None = None) -> Array:
    """Return q (nq,) of a reference: arm and steering as it has them, powered casters trailing.

    Args:
        pose: Pose of P (3,); None takes the reference's.
    """
    place = state.pose if pose is None else pose
    q = robot.configuration_at(place, state.joints, steering(robot, state)[0])
    casters = zip(robot.drive.powered_casters, trailing(robot, state).tolist(), strict=True)
    for swivel, position in casters:
        robot.set_joint(q, swivel.joint, position)
    return q


def direction(state: ReferenceState) -> Array:
    """Return a reference's direction of travel (3, 3); of one that gives none, its twist.

    Where there is neither, wheels point ahead.
    """
    if state.direction is not None and state.direction[0].any():
        return state.direction
    if state.twist.any():
        return np.vstack([state.twist, state.twist_dot, np.zeros(3)])
    return np.eye(3) * [[1.0], [0.0], [0.0]]


def _rolling_speed(robot: Robot, speeds: Array, turned: Array) -> Array:
    """Return the rolling speed of the first steered swivel's wheels and its derivative (2,).

    k·T − y (ω + φ̇), with y the wheels' mean place beside the swivel; along the heading k̇·T = 0.
    """
    swivel = robot.drive.steered[0]
    beside = [robot.drive.wheels[wheel].lateral for wheel in robot.drive.carried(swivel)]
    row = rolling_row(swivel.pivot, angle_of(swivel, turned[0, 0]))
    turning = speeds[:, 2] + swivel.sign * turned[1:, 0]
    return speeds @ robot.root_velocity.T @ row - np.mean(beside) * turning


def configurations(robot: Robot, pose: Array, joints: Array) -> Array:
    """Return q (K, nq) for poses of P and positions of the arm; wheels and swivels at 0.

    Joints that mimic one of the arm, and swivels that follow, are where those put them.

    Args:
        pose: Poses (K, 3), m and rad.
        joints: Positions (K, n_joints), rad or m.
    """
    if robot.mimics or robot.drive.followers:
        rows = zip(pose, joints, strict=True)
        return np.array([robot.configuration_at(*row) for row in rows]).reshape(-1, robot.nq)
    q = np.tile(pin.neutral(robot.model), (len(pose), 1))
    heading, (px, py) = pose[:, 2] - robot.drive.heading, robot.drive.point
    cos, sin = np.cos(heading), np.sin(heading)
    q[:, 0], q[:, 1] = pose[:, 0] - cos * px + sin * py, pose[:, 1] - sin * px - cos * py
    q[:, 2], q[:, 3] = cos, sin
    for name, positions in zip(robot.joint_names, joints.T, strict=True):
        robot.entries[name].write_all(q, positions)
    return q
