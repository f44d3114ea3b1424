"""Wheels and drives: what touches the ground, and how it is found in a description."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rpctl.errors import DriveError, UnknownNameError
from rpctl.robot.description import Array, Description, Joint, Shape

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, relative to the track
DETECTED = ("differential", "skid-steer", "mecanum", "fixed")
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
        direction: Direction (x, y) in the root link's frame along which the contact point stands
            still: forward for an ordinary wheel, along the roller for a mecanum or omni wheel.
        driven: Whether its joint has an actuator.
    """

    joint: str
    radius: float
    source: str
    axis: tuple[float, float, float]
    offset: float = 0.0
    direction: tuple[float, float] = (1.0, 0.0)
    driven: bool = True


@dataclass(frozen=True)
class Drive:
    """How a robot meets the ground.

    Attributes:
        type: ``"differential"``, ``"skid-steer"``, ``"omni"``, ``"mecanum"`` or ``"fixed"``.
        wheels: The wheels, front before rear and left before right.
        point: P (x, y) in the root link's frame, m: the midpoint of the fixed-wheel axle, of a
            skid-steer drive its centre of rotation.
        heading: Angle of the forward direction in the root link's frame, rad.
        track: Distance between the left and the right wheels' contact points, m.
        ground: Height of the ground in the root link's frame, m.
    """

    type: str
    wheels: tuple[Wheel, ...] = ()
    point: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    track: float = 0.0
    ground: float = 0.0

    @property
    def base_speeds(self) -> tuple[str, ...]:
        """Names of the quasi-velocities of the base."""
        return BASE_SPEEDS[self.type]

    @property
    def has_axle(self) -> bool:
        """Whether P moves along the heading only."""
        return self.base_speeds == ("v", "omega")


FIXED = Drive("fixed")


@dataclass(frozen=True)
class _Candidate:
    """A joint that could carry a wheel, placed in the root link's frame."""

    joint: Joint
    origin: Array  # (3,)
    axle: Array  # (3,)


def detect(description: Description, locked: dict[str, float], kind: str | None = None) -> Drive:
    """Find the drive of a robot.

    A wheel turns without limits about a level axle and is held rigidly by the root link. Two on
    one axle are a differential drive. Two such axles are a skid-steer or a mecanum drive; nothing
    in a URDF tells the two apart, so ``kind`` has to.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m).
        kind: Type of the drive, or None.

    Returns:
        The drive.

    Raises:
        DriveError: No wheels fit, or nothing tells which drive they are; every candidate is named.
        UnknownNameError: There is no such type.
    """
    if kind is not None and kind not in DETECTED:
        raise UnknownNameError("drive", kind, DETECTED)
    if kind == "fixed":
        return FIXED
    candidates = _candidates(description, locked)
    pairs = [pair for pair in combinations(candidates, 2) if _coaxial(*pair)]
    if len(pairs) == 1 and kind in (None, "differential"):
        return _differential(description, *pairs[0])
    if len(pairs) == 2 and kind in ("skid-steer", "mecanum"):
        return _four_wheels(description, kind, pairs)
    raise DriveError(_why_not(description, candidates, pairs, kind))


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
    kind: str | None,
) -> str:
    where = f"{description.path}: "
    wanted = f"no {kind or 'differential'} drive"
    if pairs:
        listed = "; ".join(f"{a.joint.name} + {b.joint.name}" for a, b in pairs)
        needs = {None: "", "differential": "", "skid-steer": "two", "mecanum": "two"}[kind]
        fix = (
            f"a {kind} drive has two such axles"
            if needs
            else "a differential drive has one; say --drive skid-steer or --drive mecanum, or "
            "freeze the wheels that only roll along with --lock NAME"
        )
        axles = f"{len(pairs)} pair{'s' * (len(pairs) > 1)} of wheels on one axle"
        return f"{where}{wanted}: {axles} ({listed}), where {fix}"
    if candidates:
        listed = ", ".join(
            f'"{c.joint.name}" (line {c.joint.line}, axle {np.round(c.axle, 3).tolist()} '
            f"at {np.round(c.origin, 3).tolist()})"
            for c in candidates
        )
        return f"{where}{wanted}: no two wheels share one axle; joints on a level axis: {listed}"
    return (
        f"{where}{wanted}: it needs two continuous joints, held rigidly by the root "
        f'link "{description.root}", about one level axle; make the wheels\' joints '
        'type="continuous" with the axle as <axis>'
    )


@dataclass(frozen=True)
class _Axle:
    """A left and a right wheel about one axle: its unit direction to the left, and centres."""

    left: _Candidate
    right: _Candidate
    across: Array  # (3,)

    def middle(self, description: Description) -> Array:
        """Return the midpoint (3,) of the wheels' centres."""
        return 0.5 * (_centre(description, self.left) + _centre(description, self.right))


def _axle(a: _Candidate, b: _Candidate) -> _Axle:
    across = a.axle * math.copysign(1.0, _mostly_left(a.axle))
    left, right = (a, b) if across @ (a.origin - b.origin) > 0 else (b, a)
    return _Axle(left, right, across)


def _heading(across: Array) -> float:
    return math.atan2(-across[0], across[1]) + 0.0  # no negative zero


def _centre(description: Description, candidate: _Candidate) -> Array:
    """Return a wheel's centre (3,) in the root link's frame."""
    return candidate.origin + _offset(description, candidate.joint) * candidate.axle


def _wheel(description: Description, candidate: _Candidate, direction: float) -> Wheel:
    """Return a wheel whose contact stands still along a direction (angle in the root's frame)."""
    radius, source = _radius(description, candidate)
    x, y, z = candidate.joint.axis.tolist()
    return Wheel(
        joint=candidate.joint.name,
        radius=radius,
        source=source,
        axis=(x, y, z),
        offset=_offset(description, candidate.joint),
        direction=(math.cos(direction), math.sin(direction)),
    )


def _differential(description: Description, a: _Candidate, b: _Candidate) -> Drive:
    axle = _axle(a, b)
    heading = _heading(axle.across)
    wheels = tuple(_wheel(description, c, heading) for c in (axle.left, axle.right))
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
    description: Description, kind: str, pairs: list[tuple[_Candidate, _Candidate]]
) -> Drive:
    """Return a skid-steer drive about the middle of its wheels, or a mecanum drive.

    The rollers that touch the ground of a mecanum drive lie along (1, −1) at the front left and
    the rear right, along (1, 1) at the other two: seen from above, those on top form an X.
    """
    axles = [_axle(*pair) for pair in pairs]
    heading = _heading(axles[0].across)
    forward = np.array([math.cos(heading), math.sin(heading), 0.0])
    axles.sort(key=lambda axle: -float(axle.middle(description) @ forward))
    candidates = [c for axle in axles for c in (axle.left, axle.right)]
    turns = (-1, 1, 1, -1) if kind == "mecanum" else (0, 0, 0, 0)
    wheels = tuple(
        _wheel(description, candidate, heading + turn * math.pi / 4)
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
