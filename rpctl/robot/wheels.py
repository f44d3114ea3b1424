"""Wheels one by one: the joints that could carry one, and how large it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.description.records import Array, Description, Joint, Shape
from rpctl.errors import DriveError

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, relative to the track
SHAPE_TILT = 0.02  # sine of the largest angle between a wheel's cylinder and its axle


@dataclass(frozen=True)
class Candidate:
    """A joint that could carry a wheel, placed in the root link's frame."""

    joint: Joint
    origin: Array  # (3,)
    axle: Array  # (3,)
    frame: Array  # (3, 3)


def find_candidates(description: Description, locked: dict[str, float]) -> list[Candidate]:
    """Return the joints that turn without limits about a level axis, held by the root link.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m); they hold as fixed ones do.
    """
    found = []
    for joint in description.joints:
        turns = joint.kind == "continuous" or (
            joint.kind == "revolute" and math.isinf(joint.upper - joint.lower)
        )
        carriers = description.chain(joint.parent)
        rigid = all(not j.moving or j.name in locked for j in carriers)
        if not turns or joint.name in locked or not rigid:
            continue
        pose = description.pose(joint.parent, locked) @ joint.origin
        axle = pose[:3, :3] @ joint.axis
        if abs(axle[2]) <= AXLE_TILT:
            found.append(Candidate(joint, pose[:3, 3], axle, pose[:3, :3]))
    return found


def coaxial(a: Candidate, b: Candidate) -> bool:
    """Return whether two wheels turn about one line, apart from a file's rounding."""
    between = b.origin - a.origin
    distance = float(np.linalg.norm(between))
    parallel = abs(float(a.axle @ b.axle)) > 1.0 - AXLE_TILT**2
    apart = float(np.linalg.norm(np.cross(a.axle, between)))
    return parallel and distance > 0.0 and apart <= AXLE_OFFSET * distance


def mostly_left(axle: Array) -> float:
    """Positive when the axle points left of forward; forward is +x, or +y for an axle along x."""
    return float(axle[1]) if abs(axle[1]) > AXLE_TILT else -float(axle[0])


def _round_shapes(description: Description, joint: Joint) -> list[tuple[Shape, str]]:
    """Return the shapes of a wheel that are round about its axle, collision before visual."""
    link = description.link[joint.child]
    shapes = [(s, "collision") for s in link.collisions] + [(s, "visual") for s in link.visuals]
    return [
        (shape, role)
        for shape, role in shapes
        if shape.kind == "sphere"
        or (
            shape.kind in ("cylinder", "capsule")
            and np.linalg.norm(np.cross(shape.origin[:3, 2], joint.axis)) <= SHAPE_TILT
        )
    ]


def offset_of(description: Description, joint: Joint) -> float:
    """Return how far along the axle the wheel's centre lies from the joint's origin."""
    shapes = _round_shapes(description, joint)
    return float(shapes[0][0].origin[:3, 3] @ joint.axis) if shapes else 0.0


def radius_of(description: Description, candidate: Candidate) -> tuple[float, str]:
    """Return a wheel's radius (m) and where it came from.

    Raises:
        DriveError: Nothing tells it.
    """
    shapes = _round_shapes(description, candidate.joint)
    if shapes:
        widest, role = max(shapes, key=lambda item: item[0].size[0])
        return widest.size[0], f"{role} {widest.kind}, line {widest.line}"
    height = float(candidate.origin[2])
    if height > 0.0:
        return height, f'axle height over the root link "{description.root}"'
    joint = candidate.joint
    raise DriveError(
        f'{description.path}:{joint.line}: the radius of wheel "{joint.child}" is not known: no '
        "cylinder or sphere among its shapes, and its axle is not above the root link; give the "
        'link a <collision> with <cylinder radius="..." length="..."/> along the axle'
    )
