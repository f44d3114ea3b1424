"""``Reference``: where base and arm should be at a time, with first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.model import Robot


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

    Args:
        robot: The robot.
        data: Pinocchio's workspace; overwritten.
        state: The reference at one time.

    Raises:
        RpctlError: The robot has no end effector.
    """
    return robot.end_effector_pose(data, robot.configuration_at(state.pose, state.joints))
