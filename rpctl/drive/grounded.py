"""Which wheels stand: the ground is where the lowest of them ends, if the body lets them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rpctl.description.records import Description, Joint
from rpctl.drive.drive_file import suggest
from rpctl.drive.wheels import WheelCandidate
from rpctl.errors import DriveError

GROUND_TOLERANCE_M = 5e-3  # m; wheels reach the ground together to within this,
GROUND_TOLERANCE_RADII = 0.1  # or within this share of the radius, whichever is more
MAX_RADIUS_RATIO = (
    2.0  # a wheel of unknown size is at most so much larger than the known or lowest one
)


def lowest(description: Description, locked: Mapping[str, float], link: str) -> float:
    """Return the height of a link's lowest point, m; inf where it has meshes alone, or nothing."""
    return min((low for low, _ in _heights(description, locked, link)), default=math.inf)


def _heights(
    description: Description, locked: Mapping[str, float], link: str
) -> Iterator[tuple[float, float]]:
    """Yield the heights of the lowest and the highest point of a link's shapes but meshes, m."""
    body = description.link[link]
    shapes = [shape for shape in body.collisions + body.visuals if shape.kind != "mesh"]
    pose = description.pose(link, dict(locked)) if shapes else np.eye(4)  # it walks up the tree
    for shape in shapes:
        place = pose @ shape.origin
        size, up = shape.size, np.abs(place[2, :3])
        reach = size[0]
        if shape.kind == "box":
            reach = 0.5 * float(up @ size)
        elif shape.kind == "capsule":
            reach = size[0] + 0.5 * size[1] * float(up[2])
        elif shape.kind == "cylinder":
            reach = size[0] * math.sqrt(max(0.0, 1.0 - up[2] ** 2)) + 0.5 * size[1] * float(up[2])
        yield float(place[2, 3]) - reach, float(place[2, 3]) + reach


@dataclass(frozen=True)
class GroundedWheels:
    """Which candidates stand on the ground.

    Attributes:
        wheels: Those that do, with their radii.
        rejected: Why each of the others does not, in sentences.
        doubts: What was assumed of their sizes, in sentences.
    """

    wheels: tuple[WheelCandidate, ...]
    rejected: tuple[str, ...]
    doubts: tuple[str, ...]


def find_grounded(
    description: Description,
    locked: Mapping[str, float],
    candidates: list[WheelCandidate],
    declared: bool,
) -> GroundedWheels:
    """Tell which candidates reach the ground, which is where the lowest of them ends.

    A wheel whose size nothing tells has its axle's height over the ground for a radius; where no
    size is known, the ground is at the root link's origin. One joint alone is no wheel, nor is
    one that ends more than its radius above the lowest part of the body.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m).
        candidates: Joints that could carry wheels.
        declared: Whether the user says that all of them are wheels.

    Raises:
        DriveError: A wheel's radius is not known, and its axle is not above the root link.
    """
    rejected: list[str] = []
    if not declared:
        candidates, rejected = _clear_of_body(description, locked, candidates)
    known = [c for c in candidates if c.radius is not None]
    ground = min((c.bottom for c in known), default=0.0)
    least = min((float(c.centre[2]) - ground for c in candidates), default=0.0)
    widest = max((float(c.radius) for c in known if c.radius is not None), default=least)
    place = "the other wheels' ground" if known else f'the root link "{description.root}"'
    wheels, doubts = [], []
    for candidate in candidates:
        height, name = float(candidate.centre[2]) - ground, candidate.joint.name
        if candidate.radius is None:
            if height <= 0.0:
                raise _unknown_radius(description, candidate.joint, candidates)
            if height > MAX_RADIUS_RATIO * widest and not declared:
                rejected.append(f'"{name}": its axle is {height:.3g} m above the ground: no wheel')
                continue
            source = f"axle height over {place}"
            doubts.append(
                f'no shape tells the size of wheel "{name}"{_radius_note(candidate)}: its radius, '
                f"{height:.4g} m, is the {source}; give its radius in a drive file if it is another"
            )
            candidate = replace(candidate, radius=height, source=source)
        gap, radius = candidate.bottom - ground, candidate.radius or 0.0
        if gap > max(GROUND_TOLERANCE_M, GROUND_TOLERANCE_RADII * radius) and not declared:
            rejected.append(f'"{name}": it ends {gap:.3g} m above the ground: no wheel')
            continue
        wheels.append(candidate)
    return GroundedWheels(tuple(wheels), tuple(rejected), tuple(doubts))


def _clear_of_body(
    description: Description, locked: Mapping[str, float], candidates: list[WheelCandidate]
) -> tuple[list[WheelCandidate], list[str]]:
    """Return the candidates that the body lets reach the ground, and why the others cannot."""
    body = [
        link.name
        for link in description.links
        if not any(j.moving and j.name not in locked for j in description.chain(link.name))
    ]
    heights = [ends for link in body for ends in _heights(description, locked, link)]
    foot = min((c.bottom for c in candidates if c.radius is not None), default=math.nan)
    # A shape that the lowest wheel stands on is the ground, as files of simulators have it.
    floor = min(
        (low for low, high in heights if not abs(high - foot) <= GROUND_TOLERANCE_M),
        default=math.inf,
    )
    kept, rejected = [], []
    for candidate in candidates:
        name, radius = candidate.joint.name, candidate.radius
        if radius is not None and candidate.bottom - floor > radius:
            gap = candidate.bottom - floor
            rejected.append(f'"{name}": the body reaches {gap:.3g} m lower: no wheel')
        elif len(candidates) == 1:
            rejected.append(
                f'"{name}": no other joint turns about a level axle: one alone is no wheel'
            )
        else:
            kept.append(candidate)
    return kept, rejected


def _radius_note(candidate: WheelCandidate) -> str:
    return f" ({candidate.source})" if candidate.source else ""


def _unknown_radius(
    description: Description, joint: Joint, candidates: list[WheelCandidate]
) -> DriveError:
    start = suggest("differential", {c.joint.name: c.radius for c in candidates})
    return DriveError(
        f'{description.path}:{joint.line}: the radius of wheel "{joint.child}" is not known: no '
        "cylinder or sphere among its shapes, no mesh that can be read, and its axle is not above "
        'the root link; give the link a <collision> with <cylinder radius="..." length="..."/> '
        f"along the axle, or its radius in a drive file (--drive FILE):\n{start}"
    )
