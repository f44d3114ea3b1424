"""Robots like another one: tighter limits, other masses."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase

import pinocchio as pin

from rpctl.description.records import Joint
from rpctl.errors import UnknownNameError, require_positive
from rpctl.robot.model import Robot


def scale_limits(robot: Robot, effort: float = 1.0, velocity: float = 1.0) -> Robot:
    """Return a robot whose effort and velocity limits are those of another, scaled.

    Args:
        robot: The other one.
        effort: Scale of all effort limits.
        velocity: Scale of all velocity limits.

    Raises:
        RpctlError: A scale is not positive.
    """
    require_positive("effort", effort)
    require_positive("velocity", velocity)

    def scaled(joint: Joint) -> Joint:
        return replace(joint, effort=effort * joint.effort, velocity=velocity * joint.velocity)

    joints = tuple(map(scaled, robot.description.joints))
    description = replace(robot.description, joints=joints)
    return replace(robot, description=description, joints=tuple(map(scaled, robot.joints)))


def scale_masses(robot: Robot, joints: str, scale: float) -> Robot:
    """Return a robot that has some masses, and their inertias, scaled in its model.

    Its description keeps the file's, so ``verify`` tells the two apart.

    Args:
        robot: The robot to start from.
        joints: Pattern of joint names (``"arm_*"``): whatever each of them carries directly.
        scale: Scale of the masses.

    Raises:
        RpctlError: The scale is not positive, or no joint has such a name.
    """
    require_positive("scale", scale)
    model = robot.model.copy()
    matching = [i for i, name in enumerate(model.names) if i and fnmatchcase(name, joints)]
    if not matching:
        raise UnknownNameError("joint", joints, list(model.names)[2:])
    for index in matching:
        inertia = model.inertias[index]
        model.inertias[index] = pin.Inertia(
            scale * inertia.mass, inertia.lever, scale * inertia.inertia
        )
    return replace(robot, model=model)
