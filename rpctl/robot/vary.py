"""Robots like another one: tighter limits, other masses, more friction or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import pinocchio as pin

from rpctl.description.records import Joint
from rpctl.errors import RpctlError, UnknownNameError, require_positive
from rpctl.robot.described import with_joint_losses
from rpctl.robot.losses import find_losses
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

    return _with_joints(robot, scaled)


def set_limits(
    robot: Robot,
    effort: Mapping[str, float] | None = None,
    velocity: Mapping[str, float] | None = None,
) -> Robot:
    """Return a robot with effort and velocity limits of its own, where another has the file's.

    Args:
        robot: The other one.
        effort: Effort limits (N·m or N) by pattern of joint names (``"arm_*"``); the last that
            matches counts.
        velocity: Velocity limits (rad/s or m/s), likewise.

    Raises:
        RpctlError: A limit is not positive, or no joint has such a name.
    """
    if not effort and not velocity:
        return robot
    names = robot.moving_joint_names
    given: dict[str, dict[str, Any]] = {name: {} for name in names}
    for kind, limits in (("effort", effort or {}), ("velocity", velocity or {})):
        for pattern, limit in limits.items():
            require_positive(f"the {kind} limit of {pattern}", limit)
            matching = [name for name in names if fnmatchcase(name, pattern)]
            if not matching:
                raise UnknownNameError("joint", pattern, names)
            for name in matching:
                given[name][kind] = limit
    return _with_joints(robot, lambda joint: replace(joint, **given.get(joint.name, {})))


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
        raise UnknownNameError("joint", joints, robot.moving_joint_names)
    for index in matching:
        inertia = model.inertias[index]
        model.inertias[index] = pin.Inertia(
            scale * inertia.mass, inertia.lever, scale * inertia.inertia
        )
    return replace(robot, model=model)


def add_friction(robot: Robot, friction: Mapping[str, float]) -> Robot:
    """Return a robot with more dry friction in some of its joints.

    Args:
        robot: The robot to start from.
        friction: What is added, N·m or N, by the names of joints.

    Raises:
        UnknownNameError: No joint has such a name.
    """
    return add_losses(robot, {}, friction)


def add_losses(robot: Robot, damping: Mapping[str, float], friction: Mapping[str, float]) -> Robot:
    """Return a robot with more damping and dry friction in some of its joints.

    Its description has them, too.

    Args:
        robot: The robot to start from.
        damping: What is added, N·m·s/rad or N·s/m, by the names of joints.
        friction: What is added, N·m or N, likewise.

    Raises:
        UnknownNameError: No joint has such a name.
    """
    for name in (*damping, *friction):
        if name not in robot.entries:
            raise UnknownNameError("joint", name, robot.entries)
    if not (any(damping.values()) or any(friction.values())):
        return robot
    known, changed = robot.losses, {}
    for name in robot.entries:
        index, joint = robot.velocity_index(name), robot.description.joint[name]
        d, f = (0.0, 0.0) if known is None else (known.damping[index], known.friction[index])
        changed[name] = replace(
            joint,
            damping=float(d + damping.get(name, 0.0)),
            friction=float(f + friction.get(name, 0.0)),
        )
    description = with_joint_losses(robot.description, changed)
    return replace(
        robot,
        description=description,
        joints=tuple(changed.get(joint.name, joint) for joint in robot.joints),
        losses=find_losses(description, robot.model),
        loaded_with=replace(robot.loaded_with, losses=True),
    )


def scale_losses(robot: Robot, scale: float) -> Robot:
    """Return a robot whose joints have another's damping and dry friction, scaled.

    Its description has them, too.

    Args:
        robot: The robot to start from; one that loses nothing stays as it is.
        scale: Of all of them, 0 or more.

    Raises:
        RpctlError: The scale is negative.
    """
    if not scale >= 0.0:
        raise RpctlError(f"the scale of losses is {scale:g}; give 0 or more")
    known = robot.losses
    if known is None or scale == 1.0:
        return robot
    entries = {name: robot.velocity_index(name) for name in robot.entries}
    more = scale - 1.0
    return add_losses(
        robot,
        {name: more * float(known.damping[index]) for name, index in entries.items()},
        {name: more * float(known.friction[index]) for name, index in entries.items()},
    )


def without_losses(robot: Robot) -> Robot:
    """Return a robot whose joints lose nothing, like [MS21]'s."""
    return replace(robot, losses=None, loaded_with=replace(robot.loaded_with, losses=False))


def _with_joints(robot: Robot, change: Callable[[Joint], Joint]) -> Robot:
    """Return a robot whose joints are another's, each changed."""
    joints = tuple(map(change, robot.description.joints))
    description = replace(robot.description, joints=joints)
    return replace(robot, description=description, joints=tuple(map(change, robot.joints)))
