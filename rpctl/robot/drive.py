"""Wheels and drives: what touches the ground, and how it is found in a description."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rpctl.errors import DriveError
from rpctl.robot.description import Array, Description, Joint, Shape

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, relative to the track
SHAPE_TILT = 0.02  # sine of the largest angle between a wheel's cylinder and its axle


BASE_SPEEDS = {
    "differential": ("v", "omega"),
    "skid-steer": ("v", "omega"),
    "omni": ("vx", "vy", "omega"),
    "mecanum": ("vx", "vy", "omega"),
    "fixed": (),
}


@dataclass(frozen=True)
class Wheel:
    """A wheel on the ground.

    Attributes:
        joint: Name of its joint.
        radius: m.
        source: Where the radius came from.
        axis: Unit axle (3,) in the wheel joint's frame.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        grip: What of the contact point stands still: ``"rolling"`` all of it, ``"sliding"`` only
            along the rolling direction (skid-steer), ``"roller"`` only along the roller's axis.
        roller: For ``"roller"``: angle from the axle to the axis of the roller that touches the
            ground, seen from above, rad; ±π/4 for a mecanum wheel, π/2 for an omni wheel.
        driven: Whether its joint has an actuator.
    """

    joint: str
    radius: float
    source: str
    axis: tuple[float, float, float]
    offset: float = 0.0
    grip: str = "rolling"
    roller: float = 0.0
    driven: bool = True


@dataclass(frozen=True)
class Drive:
    """How a robot meets the ground.

    Attributes:
        type: ``"differential"``, ``"skid-steer"``, ``"omni"``, ``"mecanum"`` or ``"fixed"``.
        wheels: The wheels, front before rear and left before right.
        swivels: Joints of passive casters; their rates follow from the base's motion.
        point: P (x, y) in the root link's frame, m: the midpoint of the fixed-wheel axle, of a
            skid-steer drive its centre of rotation.
        heading: Angle of the forward direction in the root link's frame, rad.
        track: Distance between the wheels' contact points, m.
        ground: Height of the ground in the root link's frame, m.
    """

    type: str
    wheels: tuple[Wheel, ...] = ()
    swivels: tuple[str, ...] = ()
    point: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    track: float = 0.0
    ground: float = 0.0

    @property
    def base_speeds(self) -> tuple[str, ...]:
        """Names of the quasi-velocities of the base."""
        return BASE_SPEEDS[self.type]


FIXED = Drive("fixed")


@dataclass(frozen=True)
class _Candidate:
    """A joint that could carry a wheel, placed in the root link's frame."""

    joint: Joint
    origin: Array  # (3,)
    axle: Array  # (3,)


def detect(description: Description, locked: dict[str, float]) -> Drive:
    """Find the differential drive of a robot.

    The drive is the one pair of unlimited joints, each held rigidly by the root link, that turn
    about one common horizontal axle.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m).

    Returns:
        The drive.

    Raises:
        DriveError: No pair of wheels fits, or more than one does; every candidate is named.
    """
    candidates = _candidates(description, locked)
    pairs = [pair for pair in combinations(candidates, 2) if _coaxial(*pair)]
    if len(pairs) != 1:
        raise DriveError(_why_not(description, candidates, pairs))
    return _differential(description, *pairs[0])


def _candidates(description: Description, locked: dict[str, float]) -> list[_Candidate]:
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
            found.append(_Candidate(joint, pose[:3, 3], axle))
    return found


def _coaxial(a: _Candidate, b: _Candidate) -> bool:
    between = b.origin - a.origin
    distance = float(np.linalg.norm(between))
    parallel = abs(float(a.axle @ b.axle)) > 1.0 - AXLE_TILT**2
    apart = float(np.linalg.norm(np.cross(a.axle, between)))
    return parallel and distance > 0.0 and apart <= AXLE_OFFSET * distance


def _why_not(
    description: Description,
    candidates: list[_Candidate],
    pairs: list[tuple[_Candidate, _Candidate]],
) -> str:
    where = f"{description.path}: "
    if pairs:
        listed = "; ".join(f"{a.joint.name} + {b.joint.name}" for a, b in pairs)
        return (
            f"{where}{len(pairs)} pairs of wheels share an axle ({listed}) where a differential "
            "drive has one; freeze the wheels that only roll along with --lock NAME"
        )
    if candidates:
        listed = ", ".join(
            f'"{c.joint.name}" (line {c.joint.line}, axle {np.round(c.axle, 3).tolist()} '
            f"at {np.round(c.origin, 3).tolist()})"
            for c in candidates
        )
        return f"{where}no two wheels share one axle; joints that turn on a level axis: {listed}"
    return (
        f"{where}no differential drive: it needs two continuous joints, held rigidly by the root "
        f'link "{description.root}", about one level axle; make the wheels\' joints '
        'type="continuous" with the axle as <axis>'
    )


def _differential(description: Description, a: _Candidate, b: _Candidate) -> Drive:
    across = a.axle * math.copysign(1.0, _mostly_left(a.axle))
    left, right = (a, b) if across @ (a.origin - b.origin) > 0 else (b, a)
    heading = math.atan2(-across[0], across[1]) + 0.0  # no negative zero
    wheels, centres = [], []
    for candidate in (left, right):
        offset = _offset(description, candidate.joint)
        centres.append(candidate.origin + offset * candidate.axle)
        radius, source = _radius(description, candidate)
        x, y, z = candidate.joint.axis.tolist()
        wheels.append(Wheel(candidate.joint.name, radius, source, (x, y, z), offset))
    middle = 0.5 * (centres[0] + centres[1])
    return Drive(
        type="differential",
        wheels=tuple(wheels),
        point=(float(middle[0]), float(middle[1])),
        heading=heading,
        track=float(np.linalg.norm((centres[0] - centres[1])[:2])),
        ground=float(middle[2]) - 0.5 * (wheels[0].radius + wheels[1].radius),
    )


def _mostly_left(axle: Array) -> float:
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


def _offset(description: Description, joint: Joint) -> float:
    """Return how far along the axle the wheel's centre lies from the joint's origin."""
    shapes = _round_shapes(description, joint)
    return float(shapes[0][0].origin[:3, 3] @ joint.axis) if shapes else 0.0


def _radius(description: Description, candidate: _Candidate) -> tuple[float, str]:
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
