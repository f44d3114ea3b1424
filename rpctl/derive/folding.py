"""A tree with as few bodies and joints as the motion needs: what is rigid becomes one body."""

from __future__ import annotations

import copy
from dataclasses import astuple, dataclass, field, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.tree import (
    FLOATS,
    Body,
    JointLoss,
    Scalars,
    SwivelPart,
    Tree,
    TreeJoint,
    WheelPart,
)
from rpctl.robot.model import Robot

ROTATION_ROUNDING = 4e-16  # of a rotation's entries; one so near to 0 or ±1 is that
SYMMETRY_TOLERANCE = 1e-13  # relative; the inertia of a round wheel turns with it by no more


@dataclass
class _RigidGroup:
    """Links that move as one: what they weigh, in the axes of the first, and what hangs on them."""

    bodies: list[Body] = field(default_factory=list)
    hinges: list[TreeJoint] = field(default_factory=list)


def fold(robot: Robot, scalars: Scalars) -> Tree:
    """Return a robot's tree with every fixed or locked joint folded away.

    Args:
        robot: The robot.
        scalars: What the numbers become; they are folded as floats before.
    """
    tree = Tree(robot, FLOATS)
    parts = _collect(robot, tree)
    folded, numbers = copy.copy(tree), scalars.numbers
    folded.bodies = {
        name: _scalar_body(_as_one_body(part), scalars) for name, part in parts.items()
    }
    folded.below = {
        name: [_scalar_hinge(joint_part, scalars) for joint_part in part.hinges]
        for name, part in parts.items()
    }
    folded.moving = [joint_part.name for part in parts.values() for joint_part in part.hinges]
    folded.scalars = scalars
    folded.wheels = {name: _scalar_wheel(wheel, scalars) for name, wheel in tree.wheels.items()}
    folded.swivels = {name: _scalar_swivel(part, scalars) for name, part in tree.swivels.items()}
    folded.forward = numbers(_snapped(tree.forward), "direction", "")
    folded.point = numbers(tree.point, "length", "")
    folded.armature = {
        name: scalars.number(inertia, "inertia", "") for name, inertia in tree.armature.items()
    }
    folded.losses = {
        name: JointLoss(*(scalars.number(value, "number", "") for value in astuple(loss)))
        for name, loss in tree.losses.items()
    }
    return folded


def cyclic_joints(robot: Robot) -> frozenset[str]:
    """Return the joints whose angle the dynamics do not depend on: each turns one round body.

    Round means: its centre of mass is on the joint's axis, and its inertia is the same about all
    directions across it. The wheels of most robots are.
    """
    parts = _collect(robot, Tree(robot, FLOATS))
    hinges = [joint_part for part in parts.values() for joint_part in part.hinges]
    return frozenset(
        joint_part.name
        for joint_part in hinges
        if joint_part.kind != "prismatic"
        and not parts[joint_part.child].hinges
        and _is_round(_as_one_body(parts[joint_part.child]), joint_part.axis)
    )


def _collect(robot: Robot, tree: Tree) -> dict[str, _RigidGroup]:
    """Return the rigid parts by their first link, from the root outwards."""
    parts = {tree.root: _RigidGroup()}
    stack = [(tree.root, tree.root, np.eye(3), np.zeros(3))]
    while stack:
        link, first, R, p = stack.pop()
        part, body = parts[first], tree.bodies.get(link)
        if body is not None:
            part.bodies.append(replace(body, com=p + R @ body.com, R=R @ body.R))
        for joint_part in tree.below[link]:
            origin, turn = p + R @ joint_part.p, R @ joint_part.R
            if joint_part.kind != "fixed" and joint_part.name not in robot.locked:
                part.hinges.append(replace(joint_part, p=origin, R=_snapped(turn)))
                parts[joint_part.child] = _RigidGroup()
                stack.append((joint_part.child, joint_part.child, np.eye(3), np.zeros(3)))
                continue
            position = robot.locked.get(joint_part.name, 0.0)
            if joint_part.kind == "prismatic":
                origin = origin + turn @ (position * joint_part.axis)
            elif joint_part.kind != "fixed":
                turn = turn @ FLOATS.rotation(joint_part.axis, position)
            stack.append((joint_part.child, first, turn, origin))
    return parts


def _as_one_body(part: _RigidGroup) -> Body:
    """Return the one body, its inertia about its centre of mass in the part's axes."""
    mass = sum(body.mass for body in part.bodies)
    if not mass:
        return Body(0.0, np.zeros(3), np.eye(3), np.zeros((3, 3)))
    com = sum((body.mass * body.com for body in part.bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in part.bodies:
        arm = body.com - com
        inertia += body.R @ body.inertia @ body.R.T
        inertia += body.mass * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return Body(mass, _clean(com), np.eye(3), _clean(0.5 * (inertia + inertia.T)))


def _is_round(body: Body, axis: Array) -> bool:
    across = body.com - (body.com @ axis) * axis
    if np.abs(across).max() > SYMMETRY_TOLERANCE * max(1.0, float(np.abs(body.com).max())):
        return False
    turn = FLOATS.rotation(axis, 1.0)
    change = turn @ body.inertia @ turn.T - body.inertia
    return bool(np.abs(change).max() <= SYMMETRY_TOLERANCE * np.abs(body.inertia).max())


def _scalar_body(body: Body, scalars: Scalars) -> Body:
    return Body(
        mass=scalars.number(body.mass, "mass", ""),
        com=scalars.numbers(body.com, "length", ""),
        R=scalars.numbers(body.R, "direction", ""),
        inertia=scalars.numbers(body.inertia, "inertia", ""),
    )


def _scalar_wheel(wheel: WheelPart, scalars: Scalars) -> WheelPart:
    return replace(
        wheel,
        radius=scalars.number(wheel.radius, "length", ""),
        offset=scalars.number(wheel.offset, "length", ""),
        direction=scalars.numbers(_snapped(wheel.direction), "direction", ""),
        shift=scalars.numbers(wheel.shift, "length", ""),
        lever=scalars.number(wheel.lever, "length", ""),
        left=scalars.number(wheel.left, "length", ""),
    )


def _scalar_swivel(part: SwivelPart, scalars: Scalars) -> SwivelPart:
    return replace(
        part,
        pivot=scalars.numbers(part.pivot, "length", ""),
        ahead=scalars.numbers(_snapped(part.ahead), "direction", ""),
        sign=scalars.number(part.sign, "number", ""),
        trail=scalars.number(part.trail, "length", ""),
        left=scalars.number(part.left, "length", ""),
    )


def _scalar_hinge(joint_part: TreeJoint, scalars: Scalars) -> TreeJoint:
    return replace(
        joint_part,
        p=scalars.numbers(_clean(joint_part.p), "length", ""),
        R=scalars.numbers(joint_part.R, "direction", ""),
        axis=scalars.numbers(_snapped(joint_part.axis), "direction", ""),
        factor=scalars.number(joint_part.factor, "number", ""),
    )


def _snapped(directions: Array) -> Array:
    nearest = np.round(directions)
    return np.where(np.abs(directions - nearest) <= ROTATION_ROUNDING, nearest, directions) + 0.0


def _clean(values: Array) -> Array:
    """Return values with those that are rounding beside the largest made 0."""
    return np.where(np.abs(values) <= ROTATION_ROUNDING * np.abs(values).max(), 0.0, values)
