"""Wheel candidates: the joints that could carry a wheel, where it is and how large."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive_file import WheelSpec
from rpctl.drive.wheel_size import round_parts, wheel_size

MAX_AXLE_OFFSET = 0.02  # of the distance between two wheels: so far apart axles of a pair may be


@dataclass(frozen=True)
class WheelCandidate:
    """A joint that could carry a wheel. Vectors are in the root link's frame, see `FrozenTree`.

    Attributes:
        joint: The joint.
        origin: Its origin (3,), m.
        axle: Its unit axis (3,).
        frame: Its rotation (3, 3).
        swivel: The upright joint between it and the root link, or None.
        radius: m; None if it is unknown.
        source: Where the radius came from.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        ball: Whether its shape is a sphere: a ball, unless nothing else is a wheel.
        uneven: The two extents of its mesh across the axle, in words, if they differ too much.
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


def find_candidates(tree: FrozenTree, specs: Mapping[str, WheelSpec]) -> list[WheelCandidate]:
    """Return the joints that could carry wheels.

    Such a joint turns without limits about a level axis, and is held by the root link, rigidly or
    by one upright joint.

    Args:
        tree: The robot; its locked joints hold as fixed ones do.
        specs: What the user says of wheels, by joint.
    """
    return [
        _candidate(tree, joint, specs.get(joint.name, WheelSpec()))
        for joint in tree.description.joints
        if turns_like_wheel(tree, joint)
        and _is_held(tree, joint)
        and not _carries_arm(tree, joint)
        and tree.is_level(joint)
    ]


def _candidate(tree: FrozenTree, joint: Joint, spec: WheelSpec) -> WheelCandidate:
    size = wheel_size(tree, joint)
    if spec.radius is not None:
        size = size._replace(radius=spec.radius, source="drive file", uneven="")
    frame = tree.frame(joint)
    parts = round_parts(tree, joint)
    return WheelCandidate(
        joint=joint,
        origin=frame[:3, 3],
        axle=tree.axis(joint),
        frame=frame[:3, :3],
        swivel=next(iter(tree.free_joints(joint.parent)), None),
        radius=size.radius,
        source=size.source,
        offset=size.offset,
        ball=bool(parts) and all(part.shape.kind == "sphere" for part in parts),
        uneven=size.uneven,
    )


def turns_like_wheel(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint is free, turns without limits, and follows no other joint."""
    return tree.is_free(joint) and joint.endless and joint.mimic is None


def _is_held(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether the root link holds a joint, rigidly or by one upright joint."""
    carriers = tree.free_joints(joint.parent)
    return len(carriers) < 2 and all(map(tree.is_upright, carriers))


def _carries_arm(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint moves others than the rollers of a wheel, which turn freely on it."""
    child_joints = tree.description.child_joints
    stack = [(below, 0) for below in child_joints[joint.child]]
    while stack:
        below, depth = stack.pop()
        if tree.is_free(below):
            depth += 1
            if depth > 1 or not below.endless:
                return True
        stack.extend((further, depth) for further in child_joints[below.child])
    return False


def coaxial(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels turn about one line seen from above, but for a file's rounding.

    Wheels of two sizes have axles of two heights; only where they stand matters.
    """
    between = (b.centre - a.centre)[:2]
    distance = math.hypot(*between)
    apart = abs(float(a.axle[0] * between[1] - a.axle[1] * between[0]))
    return parallel(a, b) and distance > 0.0 and apart <= MAX_AXLE_OFFSET * distance


def parallel(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels' axles are parallel, apart from a file's rounding."""
    return abs(float(a.axle @ b.axle)) > 1.0 - MAX_TILT_SINE**2


def mostly_left(axle: Array) -> float:
    """Positive when the axle points left of forward; forward is +x, or +y for an axle along x."""
    return float(axle[1]) if abs(axle[1]) > MAX_TILT_SINE else -float(axle[0])


def leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right."""
    return axle * math.copysign(1.0, mostly_left(axle))
