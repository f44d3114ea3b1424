"""Robots like another one: tighter limits, other masses, more friction or none, a load."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array, read_only
from rpctl.description.density import inertial_element
from rpctl.description.records import Description, Joint, Link
from rpctl.errors import RpctlError, UnknownNameError, require_known, require_positive
from rpctl.robot.load_settings import Payload
from rpctl.robot.losses import find_losses
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern

Element = Any
JOINT = "_joint"  # what the joint of a load is called behind the load's own name


def scale_limits(robot: Robot, *, effort: float = 1.0, velocity: float = 1.0) -> Robot:
    """Return a copy of a robot with scaled effort and velocity limits.

    Args:
        robot: The robot.
        effort: Scale of all effort limits, positive.
        velocity: Scale of all velocity limits, positive.

    Raises:
        RpctlError: A scale is not positive.
    """
    require_positive("effort", effort)
    require_positive("velocity", velocity)
    return _with_joints(
        robot, lambda j: replace(j, effort=effort * j.effort, velocity=velocity * j.velocity)
    )


def set_limits(
    robot: Robot,
    *,
    effort: Mapping[str, float] | None = None,
    velocity: Mapping[str, float] | None = None,
) -> Robot:
    """Return a copy of a robot with other effort and velocity limits.

    Args:
        robot: The robot.
        effort: Effort limits (N·m or N) by pattern of joint names (``"arm_*"``); the last match
            counts.
        velocity: Velocity limits (rad/s or m/s), likewise.

    Raises:
        RpctlError: A limit is not positive, or a pattern matches no joint.
    """
    if not effort and not velocity:
        return robot
    for kind, limits in (("effort", effort), ("velocity", velocity)):
        for pattern, limit in (limits or {}).items():
            require_positive(f"the {kind} limit of {pattern}", limit)
    names = robot.moving_joint_names
    efforts, rates = (by_pattern(limits or {}, names, "joint") for limits in (effort, velocity))
    return _with_joints(
        robot,
        lambda joint: replace(
            joint,
            effort=efforts.get(joint.name, joint.effort),
            velocity=rates.get(joint.name, joint.velocity),
        ),
    )


def scale_masses(robot: Robot, joints: str, scale: float) -> Robot:
    """Return a copy of a robot with some masses and inertias scaled in its model.

    The description keeps the masses of the file, so ``verify`` detects the difference.

    Args:
        robot: The robot.
        joints: Pattern of joint names (``"arm_*"``): the bodies that these joints move directly.
        scale: Scale of the masses and inertias, positive.

    Raises:
        RpctlError: The scale is not positive.
        UnknownNameError: The pattern matches no joint.
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


def with_losses(robot: Robot, damping: Array, friction: Array) -> Robot:
    """Return a robot whose joints have other damping and dry friction; its description, too.

    Args:
        robot: The robot; itself if these are its own.
        damping: Of its joints (nv,), N·m·s/rad or N·s/m.
        friction: Likewise, N·m or N.
    """
    known = np.zeros((2, robot.nv))
    if robot.losses is not None:
        known = np.array([robot.losses.damping, robot.losses.friction])
    if np.array_equal(known, [damping, friction]):
        return robot
    joints = {
        name: replace(
            robot.description.joint[name],
            damping=float(damping[robot.velocity_index(name)]),
            friction=float(friction[robot.velocity_index(name)]),
        )
        for name in robot.entries
    }
    description = robot.description.edited(
        None,
        lambda root: _write_losses(root, joints),
        joints=tuple(joints.get(joint.name, joint) for joint in robot.description.joints),
    )
    return replace(
        robot,
        description=description,
        joints=tuple(joints.get(joint.name, joint) for joint in robot.joints),
        losses=find_losses(description, robot.model),
        loaded_with=replace(robot.loaded_with, losses=True),
    )


def without_losses(robot: Robot) -> Robot:
    """Return a robot whose joints lose nothing, like [MS21]'s."""
    return replace(robot, losses=None, loaded_with=replace(robot.loaded_with, losses=False))


def _with_joints(robot: Robot, change: Callable[[Joint], Joint]) -> Robot:
    """Return a robot whose joints are another's, each changed."""
    joints = tuple(map(change, robot.description.joints))
    description = replace(robot.description, joints=joints)
    return replace(robot, description=description, joints=tuple(map(change, robot.joints)))


def _write_losses(root: Element, joints: Mapping[str, Joint]) -> None:
    for element in root.findall("joint"):
        joint = joints.get(element.get("name", ""))
        if joint is not None:
            for old in element.findall("dynamics"):
                element.remove(old)
            losses = {"damping": repr(joint.damping), "friction": repr(joint.friction)}
            etree.SubElement(element, "dynamics", losses)


def with_payload(
    robot: Robot,
    link: str,
    mass: float,
    *,
    com: Sequence[float] = (0.0, 0.0, 0.0),
    inertia: Sequence[Sequence[float]] | Array | None = None,
) -> Robot:
    """Return a copy of a robot that carries a load; ``verify`` checks its dynamics as well.

    The load is a link that is fixed to ``link``, in the description that all derivations read.

    Args:
        robot: The robot.
        link: Name of the link that carries the load.
        mass: Mass of the load, kg.
        com: Centre of mass of the load (3,) in the link's frame, m.
        inertia: Inertia of the load (3, 3) about its centre of mass, along the link's axes, kg·m²;
            None: a point mass.

    Raises:
        RpctlError: The mass is not positive, or a number is missing or not finite.
        UnknownNameError: The link is not known.
    """
    require_known("link", [link], robot.description.link)
    require_positive("the payload's mass", mass)
    centre = np.array(com, dtype=float)
    about = np.zeros((3, 3)) if inertia is None else np.array(inertia, dtype=float)
    if centre.shape != (3,) or not np.isfinite(centre).all():
        raise RpctlError(f"the payload's centre of mass is {com}; give x, y, z in m")
    if about.shape != (3, 3) or not np.allclose(about, about.T) or _is_no_body(about):
        raise RpctlError(
            "the payload's inertia is impossible for a rigid body; give a symmetric (3, 3) matrix"
        )
    description = _attached(robot.description, link, mass, centre, about)
    payload = Payload(link, mass, tuple(centre.tolist()), tuple(map(tuple, about.tolist())))
    settings = replace(robot.loaded_with, payloads=(*robot.loaded_with.payloads, payload))
    model, frame = robot.model.copy(), robot.frame(link)
    model.appendBodyToJoint(frame.parentJoint, pin.Inertia(mass, centre, about), frame.placement)
    return replace(robot, description=description, model=model, loaded_with=settings)


def _is_no_body(inertia: Array) -> bool:
    """Return whether a matrix is none of a body's: each moment is at most the sum of the others."""
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9))


def _attached(
    description: Description, carrier: str, mass: float, com: Array, inertia: Array
) -> Description:
    """Return a description with a further link, fixed to one of its links."""
    name, line = f"{carrier}_payload", description.link[carrier].line
    while name in description.link or name + JOINT in description.joint:
        name += "_"
    link = Link(name, line, mass, read_only(com), read_only(inertia), (), ())
    inf, place = math.inf, (read_only(np.eye(4)), read_only([1.0, 0.0, 0.0]))
    ends, limits = (carrier, name), (-inf, inf, inf, inf)
    joint = Joint(name + JOINT, line, "fixed", *ends, *place, *limits, None, 0.0, 0.0)
    write = partial(_write_payload, link=link, joint=joint)
    return description.edited(
        write,
        write,
        links=(*description.links, link),
        joints=(*description.joints, joint),
    )


def _write_payload(root: Element, link: Link, joint: Joint) -> None:
    etree.SubElement(root, "link", name=link.name).append(inertial_element(link))
    fixed = etree.SubElement(root, "joint", name=joint.name, type=joint.kind)
    etree.SubElement(fixed, "parent", link=joint.parent)
    etree.SubElement(fixed, "child", link=joint.child)
