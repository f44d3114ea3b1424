"""From wheels and swivels to a ``Drive``: places, directions, roles, and what drives what."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import TYPES_WITH_AXLE, Drive, Wheel
from rpctl.drive.drive_file import DriveSpec
from rpctl.drive.evidence import Evidence
from rpctl.drive.roles import assign_roles
from rpctl.drive.wheels import WheelCandidate, leftward

ROLLER_ANGLE = (
    0.25 * math.pi
)  # rad; how rollers of mecanum wheels lie unless a drive file says otherwise


def assemble(kind: str, evidence: Evidence) -> Drive:
    """Return a drive of a type, made of the wheels that were found.

    Args:
        kind: Its type.
        evidence: The wheels; they are enough for the type.

    Raises:
        DriveError: A swivel cannot have the role that the drive has for it.
    """
    heading = _heading(kind, evidence)
    forward = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    evidence = replace(evidence, swivels=tuple(s.towards(forward) for s in evidence.swivels))
    sliding = _sliding_wheels(kind, evidence)
    wheels = sorted(
        evidence.grounded.wheels,
        key=lambda wheel: (
            _on_caster(evidence, wheel) or wheel.joint.name in sliding,
            -round(float(wheel.centre[:2] @ forward), 3),
            -float(wheel.centre[:2] @ left),
        ),
    )
    driven, doubt = _driven(kind, evidence)
    point = _point(kind, evidence)
    track = _track(evidence, left)
    swivels = assign_roles(kind, evidence, forward, driven)
    ground = float(np.mean([wheel.bottom for wheel in wheels]))
    records = [
        _wheel(kind, evidence, wheel, heading, driven, ground, rank)
        for rank, wheel in enumerate(wheels)
    ]
    if kind == "skid-steer" and evidence.spec.track is not None:
        widening, track = 0.5 * (evidence.spec.track - track), evidence.spec.track
        aside = [float((wheel.centre[:2] - point) @ left) for wheel in wheels]
        records = [_with_grip_offset(*each, widening) for each in zip(records, aside, strict=True)]
    return Drive(
        type=kind,
        wheels=tuple(records),
        point=(float(point[0]), float(point[1])),
        heading=0.0 if kind not in TYPES_WITH_AXLE else heading,
        track=track,
        ground=ground,
        swivels=swivels,
        evidence=_evidence_sentences(kind, evidence),
        doubts=(*evidence.grounded.doubts, *_doubts(evidence), *doubt),
        declared=_declared(evidence.spec),
    )


def _with_grip_offset(wheel: Wheel, aside: float, widening: float) -> Wheel:
    """Return a wheel that grips further out, m; one that swivels or slides rolls where it is."""
    if wheel.swivel is not None or wheel.slides:
        return wheel
    return replace(wheel, shift=math.copysign(widening, aside))


def _declared(spec: DriveSpec) -> tuple[str, ...]:
    """Return which numbers of the drive are the drive file's; see :attr:`Drive.declared`."""
    wheels = spec.wheels.items()
    radii = [f"radius of {name}" for name, wheel in wheels if wheel.radius is not None]
    rollers = [f"direction of {name}" for name, wheel in wheels if wheel.roller is not None]
    whole = [key for key in ("track", "point") if getattr(spec, key) is not None]
    return (*radii, *rollers, *whole)


def _doubts(evidence: Evidence) -> tuple[str, ...]:
    """Return what was assumed of meshes, swivels and near misses, in sentences."""
    uneven = (
        f'the mesh of wheel "{wheel.joint.name}" is {wheel.uneven} across its axis, which no wheel '
        "is: correct the <axis>, or give its radius in a drive file"
        for wheel in evidence.grounded.wheels
        if wheel.uneven
    )
    sentences = (*uneven, *(swivel.doubt for swivel in evidence.swivels), *evidence.near_miss_notes)
    return tuple(filter(None, sentences))


def _heading(kind: str, evidence: Evidence) -> float:
    """Return the forward direction in the root link's frame, rad.

    It lies across the mean of the leftward unit axles (3,) of the fixed wheels that do not slide,
    each turned the way of the first of the longest line: atan2(−Σ a_x, Σ a_y). Where all wheels are
    steered it lies across the first one's axle. That of omni wheels is the root link's x axis.
    """
    if kind == "omni":
        return 0.0
    sliding = _sliding_wheels(kind, evidence)
    held = [wheel.axle for wheel in evidence.fixed if wheel.joint.name not in sliding]
    line = max(evidence.lines, key=len) if evidence.lines else evidence.steered[0].wheels
    left = leftward(line[0].axle)
    across = sum((axle * math.copysign(1.0, float(axle @ left)) for axle in held), np.zeros(3))
    across = across if held else left
    return math.atan2(-across[0], across[1]) + 0.0  # no negative zero


def _point(kind: str, evidence: Evidence) -> Array:
    """Return P (2,): the middle of the fixed wheels' axles, or the root link's origin."""
    if kind not in TYPES_WITH_AXLE:
        return np.zeros(2)
    if evidence.spec.point is not None:
        return np.array(evidence.spec.point)
    lines = evidence.pairs or evidence.lines
    return np.mean([_middle(line) for line in lines], axis=0)


def _middle(line: tuple[WheelCandidate, ...]) -> Array:
    """Return the middle (2,) between the outermost wheels of a line."""
    along = [float(wheel.centre @ line[0].axle) for wheel in line]
    ends = line[int(np.argmin(along))], line[int(np.argmax(along))]
    return 0.5 * (ends[0].centre[:2] + ends[1].centre[:2])


def _track(evidence: Evidence, left: Array) -> float:
    """Return how far apart the outermost wheels are, across the forward direction, m."""
    line = max(evidence.pairs, key=len) if evidence.pairs else evidence.grounded.wheels
    if evidence.pairs:
        ends = [wheel.centre[:2] for wheel in line]
        return float(max(np.linalg.norm(a - b) for a in ends for b in ends))
    return float(np.ptp([float(wheel.centre[:2] @ left) for wheel in line]))


def _driven(kind: str, evidence: Evidence) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the joints that are driven, and what was assumed to say so.

    The drive file tells; then the transmissions; then effort limits, where some have them; else
    the fixed wheels drive and the steered ones do not.
    """
    spec = evidence.spec
    specified = {
        name: wheel.driven for name, wheel in spec.wheels.items() if wheel.driven is not None
    }
    specified |= {
        name: turn.driven for name, turn in spec.swivels.items() if turn.driven is not None
    }
    sliding = _sliding_wheels(kind, evidence)
    names = {
        wheel.joint.name
        for wheel in evidence.grounded.wheels
        if not _on_caster(evidence, wheel) and wheel.joint.name not in sliding
    }
    rolling, doubts = _rolling(evidence, names)
    if specified.keys() >= names:
        doubts = ()
    driven = rolling | {s.joint.name for s in evidence.steered if s.joint.mimic is None}
    driven = {name for name in driven if specified.get(name, True)}
    return frozenset(driven | {name for name, yes in specified.items() if yes}), doubts


def _rolling(evidence: Evidence, names: set[str]) -> tuple[set[str], tuple[str, ...]]:
    """Return which of the wheels ``names`` the URDF tells are driven, and what was assumed."""
    if names & evidence.actuated:
        return names & evidence.actuated, ()
    wheels = evidence.grounded.wheels
    limited = names & {w.joint.name for w in wheels if math.isfinite(w.joint.effort)}
    pairs = ({wheel.joint.name for wheel in pair} for pair in evidence.pairs)
    whole = all(pair <= limited or not pair & limited for pair in pairs)
    if limited and limited != names and whole:
        return limited, ()
    if evidence.steered and evidence.fixed:
        doubt = (
            "no transmission tells which wheels are driven: the fixed ones are taken to be, the "
            "steered ones not; say driven = true or false of each [[wheel]] in a drive file"
        )
        return {wheel.joint.name for wheel in evidence.fixed}, (doubt,)
    return names, ()


def _on_caster(evidence: Evidence, wheel: WheelCandidate) -> bool:
    """Return whether a wheel is carried by a caster."""
    casters = {s.joint.name for s in evidence.swivels if s.role == "caster"}
    return wheel.swivel is not None and wheel.swivel.name in casters


def _sliding_wheels(kind: str, evidence: Evidence) -> set[str]:
    """Return the wheels that roll along, undriven, and slide sideways where they have to.

    Balls do, and so do wheels beside a differential drive's axle.
    """
    sliding = {wheel.joint.name for wheel in evidence.balls}
    if kind == "differential":
        sliding |= {line[0].joint.name for line in evidence.lines if len(line) == 1}
    return sliding


def _wheel(
    kind: str,
    evidence: Evidence,
    wheel: WheelCandidate,
    heading: float,
    driven: frozenset[str],
    ground: float,
    rank: int,
) -> Wheel:
    """Return the record of a wheel; ``rank`` counts from the front left."""
    name, radius = wheel.joint.name, wheel.radius or 0.0
    swivel = next((s for s in evidence.swivels if wheel in s.wheels), None)
    own = leftward(wheel.axle)
    direction = math.atan2(-own[0], own[1]) + 0.0
    if swivel is not None:
        direction = swivel.heading
    elif name in _sliding_wheels(kind, evidence):
        pass  # it rolls along its own direction
    elif kind == "mecanum":
        # The rollers on the ground lie along (1, −1) at the front left and the rear right, along
        # (1, 1) at the other two: seen from above, those on top form an X.
        specified = evidence.spec.wheels.get(name)
        roller_angle = (
            specified.roller if specified is not None and specified.roller is not None else None
        )
        direction = heading + (
            roller_angle
            if roller_angle is not None
            else (-ROLLER_ANGLE, ROLLER_ANGLE, ROLLER_ANGLE, -ROLLER_ANGLE)[rank]
        )
    elif kind in TYPES_WITH_AXLE:
        direction = heading
    x, y, z = wheel.joint.axis.tolist()
    return Wheel(
        joint=name,
        radius=radius,
        source=wheel.source,
        axis=(x, y, z),
        offset=wheel.offset,
        direction=(math.cos(direction), math.sin(direction)),
        driven=name in driven,
        swivel=wheel.swivel.name if wheel.swivel else None,
        lateral=swivel.lateral(wheel) if swivel else 0.0,
        slides=name in _sliding_wheels(kind, evidence),
        why=_why(kind, evidence, wheel, ground),
    )


def _why(kind: str, evidence: Evidence, wheel: WheelCandidate, ground: float) -> str:
    """Return why a wheel is one, in words."""
    gap = 1e3 * (wheel.bottom - ground)
    foot = "ends on the ground"
    if abs(gap) >= 0.05:
        foot = f"ends {abs(gap):.2g} mm {'above' if gap > 0.0 else 'below'} the ground"
    why = f"turns without limits about a level axle and {foot}"
    if wheel in evidence.balls:
        return f"{why}; a ball, which slides sideways, too"
    if wheel.joint.name in _sliding_wheels(kind, evidence):
        return f"{why}; off the axle, so it rolls along, and slides sideways in bends"
    return why


def _evidence_sentences(kind: str, evidence: Evidence) -> tuple[str, ...]:
    """Return how the drive was found, in sentences."""
    sentences = []
    if evidence.spec.type is not None:
        sentences.append(f"{kind}, for the drive file or option says so")
    for line in evidence.pairs:
        names = ", ".join(wheel.joint.name for wheel in line)
        sentences.append(f"{len(line)} wheels on one axle, held by the root link: {names}")
    lone = [line[0].joint.name for line in evidence.lines if len(line) == 1]
    balls = [wheel.joint.name for wheel in evidence.balls]
    for what, group in (("on axles of their own", lone), ("balls", balls)):
        sentences += [f"{what}, held by the root link: {', '.join(group)}"] if group else []
    for role in ("steered", "caster"):
        names = ", ".join(s.joint.name for s in evidence.swivels if s.role == role)
        sentences += [f"wheels on upright joints, {role}: {names}"] if names else []
    return (*sentences, *evidence.grounded.rejected)
