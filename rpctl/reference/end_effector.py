"""The end effector's reference: where it is when base and arm are on theirs."""

from __future__ import annotations

import pinocchio as pin

from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot


def end_effector_reference(robot: Robot, data: pin.Data, state: ReferenceState) -> pin.SE3:
    """Return the end effector's pose in the world along a reference.

    Args:
        robot: The robot.
        data: Pinocchio's workspace; overwritten.
        state: The reference at one time.

    Raises:
        RpctlError: The robot has no end effector.
    """
    return robot.end_effector_pose(data, robot.configuration_at(state.pose, state.joints))
