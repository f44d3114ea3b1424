"""The candidates that touch the ground, which is at the lowest wheel's bottom.

The body must not reach lower than the wheels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive_file import suggest
from rpctl.drive.wheels import WheelCandidate
from rpctl.errors import DriveError

GROUND_TOLERANCE_M = 5e-3  # m; what is so near to the ground touches it (URDFs are in mm),
GROUND_TOLERANCE_RADII = 0.1  # and so is a wheel within this share of its radius
MAX_RADIUS_RATIO = 2.0  # largest ratio of an unknown wheel's radius to the largest known radius


def ground_tolerance(radius: float) -> float:
    """Return how far (m) above the ground a wheel of a radius (m) may end and still touch it."""
    return max(GROUND_TOLERANCE_M, GROUND_TOLERANCE_RADII * radius)


@dataclass(frozen=True)
class GroundedWheels:
    """Which candidates touch the ground.

    Attributes:
        wheels: Those that do, with their radii.
        rejected: Why each of the others does not, in sentences.
        doubts: What was assumed of their sizes, in sentences.
    """

    wheels: tuple[WheelCandidate, ...]
    rejected: tuple[str, ...]
    doubts: tuple[str, ...]


def find_grounded(
    tree: FrozenTree, candidates: Sequence[WheelCandidate], declared: bool
) -> GroundedWheels:
    """Return which candidates reach the ground; the lowest of them defines its height.

    The radius of a wheel of unknown size is its axle's height above the ground; if no size is
    known, the ground is at the root link's origin. One joint alone is no wheel, nor is one that
    ends more than its radius above the lowest part of the body.

    Args:
        tree: The robot.
        candidates: Joints that could carry wheels.
        declared: Whether the user says that all of them are wheels.

    Raises:
        DriveError: A wheel's radius is not known, and its axle is not above the root link.
    """
    rejected: list[str] = []
    if not declared:
        candidates, rejected = _clear_of_body(tree, candidates)
    known = [c for c in candidates if c.radius is not None]
    ground = min((c.bottom for c in known), default=0.0)
    least = min((float(c.centre[2]) - ground for c in candidates), default=0.0)
    widest = max((float(c.radius) for c in known if c.radius is not None), default=least)
    place = "the other wheels' ground" if known else f'the root link "{tree.description.root}"'
    wheels, doubts = [], []
    for candidate in candidates:
        height, name = float(candidate.centre[2]) - ground, candidate.joint.name
        wheel = candidate
        if candidate.radius is None:
            if height <= 0.0:
                raise _unknown_radius(tree, candidate.joint, candidates)
            if height > MAX_RADIUS_RATIO * widest and not declared:
                rejected.append(f'"{name}": its axle is {height:.3g} m above the ground: no wheel')
                continue
            wheel = replace(candidate, radius=height, source=f"axle height over {place}")
            doubts.append(_radius_doubt(candidate, wheel))
        gap = wheel.bottom - ground
        if gap > ground_tolerance(wheel.radius or 0.0) and not declared:
            rejected.append(f'"{name}": it ends {gap:.3g} m above the ground: no wheel')
            continue
        wheels.append(wheel)
    return GroundedWheels(tuple(wheels), tuple(rejected), tuple(doubts))


def _clear_of_body(
    tree: FrozenTree, candidates: Sequence[WheelCandidate]
) -> tuple[list[WheelCandidate], list[str]]:
    """Return the candidates that reach below the body, and a reason for each of the others."""
    body = (link for link, _ in tree.rigid_links(tree.description.root))
    heights = [ends for link in body for ends in tree.heights(link)]
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


def _radius_doubt(candidate: WheelCandidate, wheel: WheelCandidate) -> str:
    """Return the doubt about a candidate of unknown radius that became a wheel."""
    note = f" ({candidate.source})" if candidate.source else ""
    return (
        f'no shape tells the size of wheel "{wheel.joint.name}"{note}: its radius, '
        f"{wheel.radius:.4g} m, is the {wheel.source}; give its radius in a drive file if it is "
        "another"
    )


def _unknown_radius(
    tree: FrozenTree, joint: Joint, candidates: Sequence[WheelCandidate]
) -> DriveError:
    start = suggest("differential", {c.joint.name: c.radius for c in candidates})
    return DriveError(
        f'{tree.description.path}:{joint.line}: the radius of wheel "{joint.child}" is not known: '
        "no cylinder or sphere among its shapes, no mesh that can be read, and its axle is not "
        'above the root link; give the link a <collision> with <cylinder radius="..." '
        f'length="..."/> along the axle, or its radius in a drive file (--drive FILE):\n{start}'
    )
