"""A robot's kinematic tree as nested three.js groups, one moving group for each joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.scene import threejs


def skeleton(
    robot: Robot, prefix: str, nodes_of: Callable[[int], list[threejs.Json]]
) -> threejs.Json:
    """Return the group of the root link, all others nested below it.

    Group ``PREFIX-j`` holds all that joint j moves; its parent group ``PREFIX-seat-j`` holds the
    joint's fixed placement.

    Args:
        robot: The robot.
        prefix: Of the groups' names.
        nodes_of: Returns what else hangs on a joint, by its index in the model.
    """
    model = robot.model
    groups = {
        j: threejs.node("Group", f"{prefix}-{j}", children=nodes_of(j))
        for j in range(ROOT_JOINT, model.njoints)
    }
    for j in range(ROOT_JOINT + 1, model.njoints):
        place = threejs.fixed_matrix(model.jointPlacements[j].homogeneous)
        seat = threejs.node("Group", f"{prefix}-seat-{j}", children=[groups[j]], **place)
        groups[model.parents[j]]["children"].append(seat)
    return groups[ROOT_JOINT]


def joints(robot: Robot, q: Array) -> list[dict[str, Any]]:
    """Return the page's data of each joint after the root, in the model's order.

    Args:
        robot: The robot.
        q: Configuration (nq,) at which it stands.

    Returns:
        ``name``, ``node`` (its index), ``parent`` (index in this list, −1 for the root link),
        ``place`` (its fixed placement there, see :func:`pose`), ``slides``, ``axis``, ``role``
        (``"wheel"``, ``"arm"``, ``"mimic"`` or ``"other"``), ``position``, ``lower`` and
        ``upper`` (rad or m, None where there is none) and, of a mimic joint, ``mimic``
        (``follows``: index in this list or None where the joint that it follows is locked;
        ``multiplier``; ``offset``).
    """
    names = list(robot.moving_joint_names)
    wheels, arm = {w.joint for w in robot.drive.wheels}, set(robot.joint_names)
    mimics = {joint.name for joint in robot.mimics}
    entries = []
    for number, name in enumerate(names):
        joint = robot.description.joint[name]
        role = "wheel" if name in wheels else "arm" if name in arm else "other"
        entry: dict[str, Any] = {
            "name": name,
            "node": ROOT_JOINT + 1 + number,
            "parent": robot.model.parents[ROOT_JOINT + 1 + number] - ROOT_JOINT - 1,
            "place": pose(robot.model.jointPlacements[ROOT_JOINT + 1 + number]),
            "slides": joint.kind == "prismatic",
            "axis": joint.axis.tolist(),
            "role": "mimic" if name in mimics else role,
            "position": robot.joint_position(q, name),
            "lower": joint.lower if np.isfinite(joint.lower) else None,
            "upper": joint.upper if np.isfinite(joint.upper) else None,
        }
        if joint.mimic is not None and name in mimics:
            follows = joint.mimic.joint
            entry["mimic"] = {
                "name": follows,
                "follows": names.index(follows) if follows in names else None,
                "multiplier": joint.mimic.multiplier,
                "offset": joint.mimic.offset,
            }
        entries.append(entry)
    return entries


def hand(robot: Robot) -> dict[str, Any] | None:
    """Return the page's data of the end effector: its joint in :func:`joints`, its place there.

    None for a robot without an arm.
    """
    if robot.end_effector is None:
        return None
    frame = robot.model.frames[robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)]
    joint = frame.parentJoint - ROOT_JOINT - 1
    return {"link": robot.end_effector, "joint": joint, "place": pose(frame.placement)}


def pose(place: pin.SE3) -> dict[str, list[float]]:
    """Return a placement for the page: ``R``, its rotation row after row, and ``p``, m."""
    return {"R": place.rotation.ravel().tolist(), "p": place.translation.tolist()}
