"""Detection: which joints of a description are wheels, and what drive they make."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rpctl.description.records import Array, Description, Joint, Shape
from rpctl.errors import DriveError, UnknownNameError
from rpctl.robot.drive import FIXED, Drive, Wheel
from rpctl.robot.drive_file import DriveSpec, suggest

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, relative to the track
SHAPE_TILT = 0.02  # sine of the largest angle between a wheel's cylinder and its axle


@dataclass(frozen=True)
class _Candidate:
    """A joint that could carry a wheel, placed in the root link's frame."""

    joint: Joint
    origin: Array  # (3,)
    axle: Array  # (3,)


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
    candidates = _candidates(description, locked)
    if spec.radii is not None:
        candidates = _named(description, candidates, spec.radii)
    pairs = [pair for pair in combinations(candidates, 2) if _coaxial(*pair)]
    if len(pairs) == 1 and spec.type in (None, "differential"):
        return _differential(description, *pairs[0], spec)
    if len(pairs) == 2 and spec.type in ("skid-steer", "mecanum"):
        return _four_wheels(description, pairs, spec)
    raise DriveError(_why_not(description, candidates, pairs, spec.type))


def _named(
    description: Description, candidates: list[_Candidate], wheels: dict[str, float | None]
) -> list[_Candidate]:
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
    where = f"{description.path}: no {kind or 'differential'} drive"
    start = "a drive file to start from (--drive FILE):\n"
    if pairs:
        listed = "; ".join(f"{a.joint.name} + {b.joint.name}" for a, b in pairs)
        two = kind in ("skid-steer", "mecanum")
        wanted = "it has two such axles" if two else "it has one such axle"
        axles = f"{len(pairs)} pair{'s' * (len(pairs) > 1)} of wheels on one axle ({listed})"
        names = (c.joint.name for pair in pairs for c in pair)
        guess = "mecanum" if "mecanum" in description.xml else "skid-steer"
        advice = suggest(guess if len(pairs) == 2 else "differential", names)
        return f"{where}: {axles}, where {wanted}; say which it is, {start}{advice}"
    if candidates:
        listed = ", ".join(
            f'"{c.joint.name}" (line {c.joint.line}, axle {np.round(c.axle, 3).tolist()} '
            f"at {np.round(c.origin, 3).tolist()})"
            for c in candidates
        )
        return f"{where}: no two wheels share one axle; joints on a level axis: {listed}"
    return (
        f"{where}: it needs two continuous joints, held rigidly by the root link "
        f'"{description.root}", about one level axle; make the wheels\' joints '
        'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
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


def _wheel(
    description: Description, candidate: _Candidate, direction: float, spec: DriveSpec
) -> Wheel:
    """Return a wheel whose contact stands still along a direction (angle in the root's frame)."""
    given = (spec.radii or {}).get(candidate.joint.name)
    radius, source = (given, "drive file") if given else _radius(description, candidate)
    x, y, z = candidate.joint.axis.tolist()
    return Wheel(
        joint=candidate.joint.name,
        radius=radius,
        source=source,
        axis=(x, y, z),
        offset=_offset(description, candidate.joint),
        direction=(math.cos(direction), math.sin(direction)),
    )


def _differential(description: Description, a: _Candidate, b: _Candidate, spec: DriveSpec) -> Drive:
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
    description: Description, pairs: list[tuple[_Candidate, _Candidate]], spec: DriveSpec
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
