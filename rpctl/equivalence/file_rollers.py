"""The rollers that the user's file has as joints on its wheels: how far they reach, how they lie.

Rollers are three or more frozen joints that turn on a wheel, those of ``rpctl.drive.rollers`` seen
anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.raw_file import TURNING, RawFile, RawJoint

MIN_ROLLERS = 3
ROUND_KINDS = ("sphere", "cylinder", "capsule")
MAX_TILT_SINE = 0.02  # between a roller's shape and its axis
MECANUM_COSINES = math.cos(math.radians(70.0)), math.cos(math.radians(20.0))


def reach(raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]) -> tuple[float, float] | None:
    """Return a wheel's radius over its rollers, and their middle along its axle, m; None without.

    Args:
        raw: The file as it was read for the proof.
        wheel: The wheel's joint.
        locked: Positions of the frozen joints, rad or m.
    """
    poses = raw.poses(locked, wheel.child)
    radii, along = [], []
    for roller in _rollers(raw, wheel, locked):
        pose = poses[roller.child]
        shapes = [
            (shape.size[0], (pose @ shape.origin)[:3, 3])
            for role in ("collision", "visual")
            for shape in raw.link[roller.child].shapes
            if shape.role == role
            and shape.kind in ROUND_KINDS
            and (shape.kind == "sphere" or _sine(shape.origin[:3, 2], roller.axis) <= MAX_TILT_SINE)
        ]
        if shapes:
            middle = shapes[0][1]
            radii.append(max(size for size, _ in shapes) + _sine(middle, wheel.axis))
            along.append(float(middle @ wheel.axis))
    return (max(radii), float(np.mean(along))) if radii else None


def on_the_ground(
    raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]
) -> tuple[float, float] | None:
    """Return the direction (x, y) of a mecanum wheel's lowest roller; None without rollers.

    Args:
        raw: The file as it was read for the proof.
        wheel: The wheel's joint.
        locked: Positions of the frozen joints, rad or m.
    """
    poses = raw.poses(locked)
    axle = poses[wheel.parent][:3, :3] @ wheel.origin[:3, :3] @ wheel.axis
    found = (poses[roller.child] for roller in _rollers(raw, wheel, locked))
    axes = (roller.axis for roller in _rollers(raw, wheel, locked))
    rollers = [(pose, pose[:3, :3] @ axis) for pose, axis in zip(found, axes, strict=True)]
    low, high = MECANUM_COSINES
    if not rollers or not all(low < abs(float(axis @ axle)) < high for _, axis in rollers):
        return None
    _, along = min(rollers, key=lambda roller: float(roller[0][2, 3]))
    return float(along[0]), float(along[1])


def _rollers(raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]) -> list[RawJoint]:
    """Return the rollers of a wheel; none, if they are too few."""
    found, links = [], [wheel.child]
    while links:
        for joint in raw.below[links.pop()]:
            turns = joint.type in TURNING and joint.name in locked
            found += [joint] * turns
            links += [joint.child] * (joint.type == "fixed")
    return found if len(found) >= MIN_ROLLERS else []


def _sine(a: Array, b: Array) -> float:
    """Return the distance of a point (3,) from the line through the origin along a unit (3,)."""
    return float(np.linalg.norm(np.cross(a, b)))
