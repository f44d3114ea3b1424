"""Wheels one by one: the joints that could carry one, where, and how large it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.description.mesh_paths import MeshPaths
from rpctl.description.records import Description, Joint
from rpctl.drive.drive_file import WheelSpec
from rpctl.drive.wheel_size import round_parts, wheel_size

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, of that between the wheels


@dataclass(frozen=True)
class WheelCandidate:
    """A joint that could carry a wheel, placed in the root link's frame, joints at 0 or locked.

    Attributes:
        joint: The joint.
        origin: Its origin (3,), m.
        axle: Its unit axis (3,).
        frame: Its rotation (3, 3).
        swivel: The one moving joint between it and the root link, upright; or None.
        radius: m; None while it is not known.
        source: Where the radius came from.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        ball: Whether its shape is a sphere: a ball, unless nothing else is a wheel.
        uneven: The extents of its mesh across the axis, where they are not a wheel's, in words.
    """

    joint: Joint
    origin: Array
    axle: Array
    frame: Array
    swivel: Joint | None
    radius: float | None
    source: str
    offset: float
    ball: bool
    uneven: str

    @property
    def centre(self) -> Array:
        """The wheel's centre (3,) in the root link's frame, m."""
        return self.origin + self.offset * self.axle

    @property
    def bottom(self) -> float:
        """Height of its lowest point in the root link's frame, m; NaN without a radius."""
        return float(self.centre[2]) - (math.nan if self.radius is None else self.radius)


def find_candidates(
    description: Description, locked: Mapping[str, float], specs: Mapping[str, WheelSpec]
) -> list[WheelCandidate]:
    """Return the joints that could carry wheels.

    Such a joint turns without limits about a level axis, and is held by the root link, rigidly or
    by one upright joint.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m); they hold as fixed ones do.
        specs: What the user says of wheels, by joint.
    """
    found = []
    paths = MeshPaths(description.path, description.package_dirs)
    for joint in description.joints:
        if not is_endless(joint) or joint.name in locked or joint.mimic is not None:
            continue
        carriers = [j for j in description.chain(joint.parent) if j.moving and j.name not in locked]
        if len(carriers) > 1 or not all(is_upright(description, locked, j) for j in carriers):
            continue
        if _carries_arm(description, locked, joint):
            continue
        pose = description.pose(joint.parent, dict(locked)) @ joint.origin
        axle = pose[:3, :3] @ joint.axis
        if abs(axle[2]) > AXLE_TILT:
            continue
        size = wheel_size(description, locked, joint, paths)
        given = specs.get(joint.name, WheelSpec()).radius
        if given is not None:
            size = size._replace(radius=given, source="drive file", uneven="")
        swivel = carriers[0] if carriers else None
        place = (pose[:3, 3], axle, pose[:3, :3])
        parts = round_parts(description, locked, joint)
        ball = bool(parts) and all(part.shape.kind == "sphere" for part in parts)
        found.append(
            WheelCandidate(
                joint, *place, swivel, size.radius, size.source, size.offset, ball, size.uneven
            )
        )
    return found


def is_endless(joint: Joint) -> bool:
    """Return whether a joint turns without limits."""
    endless = joint.kind == "revolute" and math.isinf(joint.upper - joint.lower)
    return joint.kind == "continuous" or endless


def root_axis(description: Description, locked: Mapping[str, float], joint: Joint) -> Array:
    """Return a joint's unit axis (3,) in the root link's frame."""
    pose = description.pose(joint.parent, dict(locked)) @ joint.origin
    return np.asarray(pose[:3, :3] @ joint.axis)


def is_upright(description: Description, locked: Mapping[str, float], joint: Joint) -> bool:
    """Return whether a joint turns about an upright axis."""
    axis = root_axis(description, locked, joint)
    return joint.kind != "prismatic" and math.hypot(axis[0], axis[1]) <= AXLE_TILT


def _carries_arm(description: Description, locked: Mapping[str, float], joint: Joint) -> bool:
    """Return whether a joint moves others than the rollers of a wheel, which turn freely on it."""
    stack = [(below, 0) for below in description.child_joints[joint.child]]
    while stack:
        below, depth = stack.pop()
        if below.moving and below.name not in locked:
            depth += 1
            if depth > 1 or not is_endless(below):
                return True
        stack.extend((further, depth) for further in description.child_joints[below.child])
    return False


def coaxial(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels turn about one line seen from above, but for a file's rounding.

    Wheels of two sizes have axles of two heights; only where they stand matters.
    """
    between = (b.centre - a.centre)[:2]
    distance = math.hypot(*between)
    apart = abs(float(a.axle[0] * between[1] - a.axle[1] * between[0]))
    return parallel(a, b) and distance > 0.0 and apart <= AXLE_OFFSET * distance


def parallel(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels' axles are parallel, apart from a file's rounding."""
    return abs(float(a.axle @ b.axle)) > 1.0 - AXLE_TILT**2


def mostly_left(axle: Array) -> float:
    """Positive when the axle points left of forward; forward is +x, or +y for an axle along x."""
    return float(axle[1]) if abs(axle[1]) > AXLE_TILT else -float(axle[0])


def leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right."""
    return axle * math.copysign(1.0, mostly_left(axle))
