"""Detection: what drive the wheels of a description make."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rpctl.description.records import Array, Description
from rpctl.errors import DriveError, UnknownNameError
from rpctl.robot.advice import why_not
from rpctl.robot.drive import FIXED, Drive, Wheel
from rpctl.robot.drive_file import DriveSpec
from rpctl.robot.wheels import (
    Candidate,
    coaxial,
    find_candidates,
    mostly_left,
    offset_of,
    radius_of,
)


def detect(
    description: Description, locked: dict[str, float], spec: DriveSpec | None = None
) -> Drive:
    """Find the drive of a robot.

    A wheel turns without limits about a level axle and is held rigidly by the root link. Two on
    one axle are a differential drive. Two such axles are a skid-steer or a mecanum drive; nothing
    in a URDF tells the two apart, so the specification has to.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m).
        spec: What the user says of the drive.

    Returns:
        The drive.

    Raises:
        DriveError: No wheels fit, or nothing tells which drive they are; every candidate is named.
        UnknownNameError: A wheel's joint is not known.
    """
    spec = spec or DriveSpec()
    if spec.type == "fixed":
        return FIXED
    candidates = find_candidates(description, locked)
    if spec.radii is not None:
        candidates = _named(description, candidates, spec.radii)
    pairs = [pair for pair in combinations(candidates, 2) if coaxial(*pair)]
    if len(pairs) == 1 and spec.type in (None, "differential"):
        return _differential(description, *pairs[0], spec)
    if len(pairs) == 2 and spec.type in ("skid-steer", "mecanum"):
        return _four_wheels(description, pairs, spec)
    raise DriveError(why_not(description, candidates, pairs, spec.type))


def _named(
    description: Description, candidates: list[Candidate], wheels: dict[str, float | None]
) -> list[Candidate]:
    """Return the candidates that a specification names.

    Raises:
        UnknownNameError: A joint is not known.
        DriveError: A joint cannot carry a wheel.
    """
    for name in wheels:
        if name not in description.joint:
            raise UnknownNameError("wheel joint", name, description.joint)
    fit = {candidate.joint.name: candidate for candidate in candidates}
    for name in wheels.keys() - fit.keys():
        joint = description.joint[name]
        raise DriveError(
            f'{description.path}:{joint.line}: joint "{name}" cannot carry a wheel: it has to be '
            "continuous, about a level axis, and held rigidly by the root link"
        )
    return [fit[name] for name in wheels]


@dataclass(frozen=True)
class _Axle:
    """A left and a right wheel about one axle: its unit direction to the left, and centres."""

    left: Candidate
    right: Candidate
    across: Array  # (3,)

    def middle(self, description: Description) -> Array:
        """Return the midpoint (3,) of the wheels' centres."""
        return 0.5 * (_centre(description, self.left) + _centre(description, self.right))


def _axle(a: Candidate, b: Candidate) -> _Axle:
    across = a.axle * math.copysign(1.0, mostly_left(a.axle))
    left, right = (a, b) if across @ (a.origin - b.origin) > 0 else (b, a)
    return _Axle(left, right, across)


def _heading(across: Array) -> float:
    return math.atan2(-across[0], across[1]) + 0.0  # no negative zero


def _centre(description: Description, candidate: Candidate) -> Array:
    """Return a wheel's centre (3,) in the root link's frame."""
    return candidate.origin + offset_of(description, candidate.joint) * candidate.axle


def _wheel(
    description: Description, candidate: Candidate, direction: float, spec: DriveSpec
) -> Wheel:
    """Return a wheel whose contact stands still along a direction (angle in the root's frame)."""
    given = (spec.radii or {}).get(candidate.joint.name)
    radius, source = (given, "drive file") if given else radius_of(description, candidate)
    x, y, z = candidate.joint.axis.tolist()
    return Wheel(
        joint=candidate.joint.name,
        radius=radius,
        source=source,
        axis=(x, y, z),
        offset=offset_of(description, candidate.joint),
        direction=(math.cos(direction), math.sin(direction)),
    )


def _differential(description: Description, a: Candidate, b: Candidate, spec: DriveSpec) -> Drive:
    axle = _axle(a, b)
    heading = _heading(axle.across)
    wheels = tuple(_wheel(description, c, heading, spec) for c in (axle.left, axle.right))
    middle = axle.middle(description)
    centres = [_centre(description, c) for c in (axle.left, axle.right)]
    return Drive(
        type="differential",
        wheels=wheels,
        point=(float(middle[0]), float(middle[1])),
        heading=heading,
        track=float(np.linalg.norm((centres[0] - centres[1])[:2])),
        ground=float(middle[2]) - 0.5 * (wheels[0].radius + wheels[1].radius),
    )


def _four_wheels(
    description: Description, pairs: list[tuple[Candidate, Candidate]], spec: DriveSpec
) -> Drive:
    """Return a skid-steer drive about the middle of its wheels, or a mecanum drive.

    The rollers that touch the ground of a mecanum drive lie along (1, −1) at the front left and
    the rear right, along (1, 1) at the other two: seen from above, those on top form an X.
    """
    kind = str(spec.type)
    axles = [_axle(*pair) for pair in pairs]
    heading = _heading(axles[0].across)
    forward = np.array([math.cos(heading), math.sin(heading), 0.0])
    axles.sort(key=lambda axle: -float(axle.middle(description) @ forward))
    candidates = [c for axle in axles for c in (axle.left, axle.right)]
    turns = (-1, 1, 1, -1) if kind == "mecanum" else (0, 0, 0, 0)
    wheels = tuple(
        _wheel(description, candidate, heading + turn * math.pi / 4, spec)
        for candidate, turn in zip(candidates, turns, strict=True)
    )
    middle = 0.5 * (axles[0].middle(description) + axles[1].middle(description))
    centres = [_centre(description, c) for c in candidates]
    P = middle if kind == "skid-steer" else np.zeros(3)
    return Drive(
        type=kind,
        wheels=wheels,
        point=(float(P[0]), float(P[1])),
        heading=heading if kind == "skid-steer" else 0.0,
        track=float(np.linalg.norm((centres[0] - centres[1])[:2])),
        ground=float(middle[2]) - sum(wheel.radius for wheel in wheels) / 4,
    )
