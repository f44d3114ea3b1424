"""Assemble a ``Drive`` from the evidence: places, directions, driven joints, roles of swivels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive import (
    POWERED_CASTERS,
    SWIVEL_ROLES,
    TYPES_WITH_AXLE,
    Drive,
    DriveSpec,
    Swivel,
    Wheel,
)
from rpctl.drive.evidence import Evidence
from rpctl.drive.leftovers import lock_option
from rpctl.drive.no_drive import drive_file_draft
from rpctl.drive.rows import unit_ahead, unit_left
from rpctl.drive.wheels import (
    SHARED_TRAIL_ROUNDING_M,
    SwivelCandidate,
    WheelCandidate,
    contact_roller,
    leftward,
)
from rpctl.errors import DriveError

ROLLER_ANGLE = 0.25 * math.pi  # rad; of mecanum wheels, unless a drive file gives another
MIN_GAP_MM = 0.05  # between a wheel and the ground; a smaller one is not worth a word


def assemble(kind: str, evidence: Evidence) -> Drive:
    """Return a drive of a type, made of the wheels that were found.

    Args:
        evidence: The wheels; they are enough for the type.

    Raises:
        DriveError: A swivel cannot have the role that the drive has for it.
    """
    base, forward = _Base(kind, evidence), unit_ahead(_Base(kind, evidence).heading)
    swivels = tuple(
        swivel.trailing() if kind == POWERED_CASTERS else swivel.towards(forward)
        for swivel in evidence.swivels
    )
    base = replace(base, evidence=replace(evidence, swivels=swivels))
    driven, doubts = _driven(base)
    return Drive(
        type=kind,
        wheels=tuple(_wheel(base, wheel, driven) for wheel in base.wheels),
        point=(float(base.point[0]), float(base.point[1])),
        heading=base.heading if kind in TYPES_WITH_AXLE else 0.0,
        track=base.effective_track,
        ground=base.ground,
        swivels=_assign_roles(kind, base.evidence, forward, driven),
        evidence=_evidence_sentences(kind, base.evidence),
        doubts=(*evidence.grounded.doubts, *_doubts(base.evidence), *doubts),
        declared=_declared(evidence.spec),
    )


@dataclass(frozen=True)
class _Base:
    """The wheels of a base as a drive of some type has them, in the root link's frame."""

    kind: str
    evidence: Evidence

    @cached_property
    def sliding(self) -> set[str]:
        """Joints of the undriven wheels that may slide sideways.

        These are balls, and wheels beside the axle of a differential drive.
        """
        sliding = {wheel.joint.name for wheel in self.evidence.balls}
        if self.kind == "differential":
            lines = self.evidence.lines
            sliding |= {line[0].joint.name for line in lines if len(line) == 1}
        return sliding

    @cached_property
    def heading(self) -> float:
        """The forward direction, rad.

        It lies across the mean of the leftward unit axles (3,) of the fixed wheels that do not
        slide, each turned the way of the first of the longest line: atan2(−Σ a_x, Σ a_y). Where
        all wheels are steered it lies across the first one's axle. That of omni wheels and of
        powered casters is the root link's x axis.
        """
        if self.kind in ("omni", POWERED_CASTERS):
            return 0.0
        evidence = self.evidence
        held = [wheel.axle for wheel in evidence.fixed if wheel.joint.name not in self.sliding]
        line = max(evidence.lines, key=len) if evidence.lines else evidence.steered[0].wheels
        left = leftward(line[0].axle)
        across = sum((axle * math.copysign(1.0, float(axle @ left)) for axle in held), np.zeros(3))
        return _direction(across if held else left)

    @cached_property
    def wheels(self) -> list[WheelCandidate]:
        """Front before rear and left before right; those of casters and sliding ones last."""
        forward, left = unit_ahead(self.heading), unit_left(self.heading)
        return sorted(
            self.evidence.grounded.wheels,
            key=lambda wheel: (
                self.evidence.on_caster(wheel) or wheel.joint.name in self.sliding,
                -round(float(wheel.centre[:2] @ forward), 3),
                -float(wheel.centre[:2] @ left),
            ),
        )

    @cached_property
    def ground(self) -> float:
        """Height of the ground, m: the mean of the wheels' lowest points."""
        return float(np.mean([wheel.bottom for wheel in self.wheels]))

    @cached_property
    def point(self) -> Array:
        """P (2,), m: the middle of the fixed wheels' axles, or the root link's origin."""
        evidence = self.evidence
        if self.kind not in TYPES_WITH_AXLE:
            return np.zeros(2)
        if evidence.spec.point is not None:
            return np.array(evidence.spec.point)
        return np.mean([_middle(line) for line in evidence.pairs or evidence.lines], axis=0)

    @cached_property
    def track(self) -> float:
        """Distance between the outermost wheels across the heading, m, as the file has it."""
        pairs = self.evidence.pairs
        if pairs:
            ends = [wheel.centre[:2] for wheel in max(pairs, key=len)]
            return float(max(np.linalg.norm(a - b) for a in ends for b in ends))
        left = unit_left(self.heading)
        return float(np.ptp([float(wheel.centre[:2] @ left) for wheel in self.wheels]))

    @cached_property
    def effective_track(self) -> float:
        """The track, m, or what the drive file gives for a skid-steer drive."""
        given = self.evidence.spec.track
        return self.track if self.kind != "skid-steer" or given is None else given


def _direction(axle: Array) -> float:
    """Return the angle (rad) of the direction to whose left an axle (3,) points."""
    return math.atan2(-axle[0], axle[1]) + 0.0  # no negative zero


def _middle(line: tuple[WheelCandidate, ...]) -> Array:
    """Return the middle (2,) between the outermost wheels of a line."""
    along = sorted(line, key=lambda wheel: float(wheel.centre @ line[0].axle))
    return 0.5 * (along[0].centre[:2] + along[-1].centre[:2])


def _wheel(base: _Base, wheel: WheelCandidate, driven: frozenset[str]) -> Wheel:
    """Return the record of a wheel; ``driven`` are the driven joints."""
    name, swivel = wheel.joint.name, base.evidence.swivel_of(wheel)
    slides = name in base.sliding
    direction = _direction(leftward(wheel.axle))
    if swivel is not None:
        direction = swivel.swivel.heading
    elif base.kind == "mecanum" and not slides:
        direction = base.heading + _roller_angle(base, wheel)
    elif base.kind in TYPES_WITH_AXLE and not slides:
        direction = base.heading
    beside = float((wheel.centre[:2] - base.point) @ unit_left(base.heading))
    shift = math.copysign(0.5, beside) * (base.effective_track - base.track) + 0.0
    x, y, z = wheel.joint.axis.tolist()
    return Wheel(
        joint=name,
        radius=wheel.radius or 0.0,
        source=wheel.source,
        axis=(x, y, z),
        offset=wheel.offset,
        direction=(math.cos(direction), math.sin(direction)),
        driven=name in driven,
        swivel=wheel.swivel.name if wheel.swivel else None,
        lateral=swivel.lateral(wheel) if swivel else 0.0,
        shift=0.0 if swivel or slides else shift,
        slides=slides,
        why=_why(base, wheel),
    )


def _roller_angle(base: _Base, wheel: WheelCandidate) -> float:
    """Return the angle (rad) from the heading to the roller that is on the ground.

    Those on the ground lie along (1, −1) at the front left and the rear right, along (1, 1) at the
    other two: seen from above, those on top form an X. Rollers that the file has lie as they do.
    """
    given = base.evidence.spec.wheels.get(wheel.joint.name)
    if given is not None and given.roller is not None:
        return given.roller
    contact = contact_roller(base.evidence.tree, wheel)
    if contact is not None:
        ahead, left = (unit(base.heading) @ contact for unit in (unit_ahead, unit_left))
        return math.atan(float(left) / float(ahead))
    on_diagonal = base.wheels.index(wheel) in (0, 3)  # from the front left
    return -ROLLER_ANGLE if on_diagonal else ROLLER_ANGLE


def _why(base: _Base, wheel: WheelCandidate) -> str:
    """Return why a wheel is one, in words."""
    gap = 1e3 * (wheel.bottom - base.ground)
    foot = f"ends {abs(gap):.2g} mm {'above' if gap > 0.0 else 'below'} the ground"
    if abs(gap) < MIN_GAP_MM:
        foot = "ends on the ground"
    slides = ""
    if wheel in base.evidence.balls:
        slides = "; a ball, which also slides sideways"
    elif wheel.joint.name in base.sliding:
        slides = "; off the axle, so it rolls along, and slides sideways in bends"
    return f"turns without limits about a level axle and {foot}{slides}"


def _driven(base: _Base) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the driven joints, and the assumptions behind that choice, in sentences.

    The first of these that says so decides: the drive file, the transmissions, effort limits that
    only some joints have. Otherwise the fixed wheels drive, and the steered ones do not; of powered
    casters all wheels and swivels do. Whatever has the effort limit 0 is undriven, unless a drive
    file, a transmission or a plugin has a motor there.
    """
    evidence, spec = base.evidence, base.evidence.spec
    given = {name: wheel.driven for name, wheel in spec.wheels.items()}
    given |= {name: swivel.driven for name, swivel in spec.swivels.items()}
    said = {name: driven for name, driven in given.items() if driven is not None}
    casters = base.kind == POWERED_CASTERS
    names = {
        wheel.joint.name
        for wheel in evidence.grounded.wheels
        if casters or not (evidence.on_caster(wheel) or wheel.joint.name in base.sliding)
    }
    names |= {swivel.joint.name for swivel in evidence.swivels if casters}
    driven, doubts = _driven_joints(evidence, names - evidence.idle)
    steering = {s.joint.name for s in evidence.steered if s.joint.mimic is None}
    driven |= steering - evidence.idle | {name for name, yes in said.items() if yes}
    driven -= {name for name, yes in said.items() if not yes}
    return frozenset(driven), () if said.keys() >= names else doubts


def _driven_joints(evidence: Evidence, names: set[str]) -> tuple[set[str], tuple[str, ...]]:
    """Return which of the joints ``names`` are driven, as the URDF has it, and the assumptions."""
    if names & evidence.actuated:
        return names & evidence.actuated, ()
    joints = evidence.description.joint
    limited = {name for name in names if math.isfinite(joints[name].effort)}
    pairs = ({wheel.joint.name for wheel in pair} for pair in evidence.pairs)
    whole = all(pair <= limited or not pair & limited for pair in pairs)
    if limited and limited != names and whole:
        return limited, ()
    if names and evidence.steered and evidence.fixed:
        doubt = (
            "no transmission says which wheels are driven: rpctl assumes the fixed ones, not the "
            "steered ones; set driven = true or false of each [[wheel]] in a drive file"
        )
        return names & {wheel.joint.name for wheel in evidence.fixed}, (doubt,)
    if names and not evidence.lines and not evidence.steered:
        doubt = (
            "no transmission says which joints of the casters are driven: rpctl assumes all, "
            "wheels and swivels; set driven = true or false of each [[wheel]] and [[swivel]] in "
            "a drive file"
        )
        return names, (doubt,)
    return names, ()


def _declared(spec: DriveSpec) -> tuple[str, ...]:
    """Return which numbers of the drive are the drive file's; see :attr:`Drive.declared`."""
    given = [
        *((f"radius of {wheel.joint}", wheel.radius) for wheel in spec.wheel),
        *((f"direction of {wheel.joint}", wheel.roller) for wheel in spec.wheel),
        ("track", spec.track),
        ("point", spec.point),
    ]
    return tuple(what for what, value in given if value is not None)


def _doubts(evidence: Evidence) -> tuple[str, ...]:
    """Return the assumptions about meshes and swivels, in sentences."""
    uneven = (
        f'the mesh of wheel "{wheel.joint.name}" is {wheel.uneven} across its axis, so it is not '
        "a wheel: correct the <axis>, or give its radius in a drive file"
        for wheel in evidence.grounded.wheels
        if wheel.uneven
    )
    unread = (
        f'wheel "{wheel.joint.name}": {wheel.unread}, so its radius, {wheel.radius:.4g} m, is that '
        "of its other meshes; a drive file gives another"
        for wheel in evidence.grounded.wheels
        if wheel.unread
    )
    return tuple(filter(None, (*uneven, *unread, *(swivel.doubt for swivel in evidence.swivels))))


def _evidence_sentences(kind: str, evidence: Evidence) -> tuple[str, ...]:
    """Return how the drive was found, in sentences."""
    root = "held by the root link"
    swivels = {role: [s for s in evidence.swivels if s.role == role] for role in SWIVEL_ROLES}
    groups: list[tuple[str, Sequence[WheelCandidate | SwivelCandidate]]] = [
        *((f"{len(pair)} wheels on one axle, {root}", pair) for pair in evidence.pairs),
        (f"on axles of their own, {root}", [line[0] for line in evidence.lines if len(line) == 1]),
        (f"balls, {root}", evidence.balls),
        *((f"wheels on upright joints, {role}", each) for role, each in swivels.items()),
    ]
    said = [f"{kind}, as the drive file or option says"] if evidence.spec.type else []
    found = (f"{what}: {', '.join(e.joint.name for e in each)}" for what, each in groups if each)
    return (*said, *found, *evidence.grounded.rejected)


def _assign_roles(
    kind: str, evidence: Evidence, forward: Array, driven: frozenset[str]
) -> tuple[Swivel, ...]:
    """Return the swivels, each with its role in a drive.

    Args:
        evidence: The swivels, and what the user says of them.
        forward: Its forward direction (2,) in the root link's frame.

    Raises:
        DriveError: A swivel cannot have the role that the drive has for it.
    """
    steered = _leading(kind, evidence, forward)
    leaders = steered[: 2 if kind == "steered" else 1]
    swivels = []
    for each in (*steered, *(each for each in evidence.swivels if each.swivel.trails)):
        swivel = replace(each.swivel, driven=each.joint.name in driven)
        if each.joint.mimic is not None:
            swivel = replace(swivel, role="mimic", shares=_leader(evidence, each.joint))
        elif each in steered and each not in leaders and evidence.spec.steering == "free":
            swivel = replace(swivel, shares=leaders[0].joint.name)
        elif each in steered and each not in leaders:
            swivel = replace(swivel, role="follower")
        swivels.append(swivel)
    if kind == "steered" or any(swivel.role == "follower" for swivel in swivels):
        swivels = [  # those that share a centre, without the trail that rounding makes
            replace(each, trail=0.0)
            if not each.trails and abs(each.trail) < SHARED_TRAIL_ROUNDING_M
            else each
            for each in swivels
        ]
    for swivel, fault in _faults(kind, evidence, swivels):
        line = evidence.description.joint[swivel.joint].line
        raise DriveError(f"{evidence.description.path}:{line}: {fault}")
    return tuple(swivels)


def _leader(evidence: Evidence, joint: Joint) -> str:
    """Return the joint that one mimics in the end."""
    while joint.mimic is not None:
        joint = evidence.description.joint[joint.mimic.joint]
    return joint.name


def _faults(
    kind: str, evidence: Evidence, swivels: Sequence[Swivel]
) -> Iterator[tuple[Swivel, str]]:
    """Yield the swivels that cannot have their role in a drive, why not, and the way out."""
    draft = drive_file_draft(evidence, kind)
    leaders = {swivel.joint for swivel in swivels if swivel.role == "steered"}
    for swivel in swivels:
        if swivel.parent is not None and not swivel.trails:
            yield (
                swivel,
                f'"{swivel.joint}" steers on "{swivel.parent}", which also turns; a steered joint '
                'must be held by the root link; set role = "trailer" of its [[swivel]] in a '
                "drive file if no motor turns it, or hold it at 0: "
                f"{lock_option(evidence.tree, [swivel.joint])}{draft}",
            )
        mimics = f'the swivel "{swivel.joint}" mimics "{swivel.shares}"'
        if swivel.role == "mimic" and kind == "steered":
            yield (
                swivel,
                f"{mimics}, but no multiple keeps all wheels on one centre of rotation; remove "
                "its <mimic>, and it follows the others exactly",
            )
        elif swivel.role == "mimic" and swivel.shares not in leaders:
            yield (
                swivel,
                f"{mimics}, which steers no wheel; let it mimic another swivel, or remove its "
                "<mimic>",
            )
        elif swivel.trails and not swivel.trail:
            yield (
                swivel,
                f'the wheels of "{swivel.joint}" stand under its axis, so it has no trail and is '
                'no caster; move their contact off the axis, or set role = "steered" of its '
                f"[[swivel]] in a drive file{draft}",
            )
    shared = {
        swivel.joint: swivel
        for swivel in swivels
        if swivel.trail and (swivel.role == "follower" or (kind == "steered" and not swivel.trails))
    }
    for swivel in shared.values():
        edits = (
            _under_axis(evidence.tree, wheel, each)
            for each in shared.values()
            for wheel in evidence.grounded.wheels
            if wheel.swivel is not None and wheel.swivel.name == each.joint
        )
        yield (
            swivel,
            f'the wheels of "{swivel.joint}" stand {1e3 * abs(swivel.trail):.3g} mm off its axis, '
            "where several steered wheels are to share one centre of rotation; put what stands off "
            f'under it: {", ".join(edits)}; or set role = "caster" of its [[swivel]] in a drive '
            f"file if it trails{draft}",
        )


def _leading(kind: str, evidence: Evidence, forward: Array) -> list[SwivelCandidate]:
    """Return the steered swivels, those first whose rates are quasi-velocities.

    Of several axles two wheels one behind the other lead: their axles fix one centre of rotation
    but where both point at each other, and straight ahead, in bends and on the spot they do not.
    """
    axes = np.array([forward, [-forward[1], forward[0]]])
    places = {each.joint.name: axes @ each.swivel.pivot for each in evidence.steered}

    def order(each: SwivelCandidate) -> tuple[bool, float, float]:
        ahead, beside = places[each.joint.name]
        return each.joint.mimic is not None, -round(float(ahead), 3), -float(beside)

    def spacing(pair: tuple[SwivelCandidate, SwivelCandidate]) -> float:
        """Return how much further one swivel is ahead of another than beside it, m."""
        ahead, beside = np.abs(places[pair[0].joint.name] - places[pair[1].joint.name])
        return float(ahead - beside)

    steered = sorted(evidence.steered, key=order)
    if kind != "steered":
        return steered
    leaders = max(combinations(steered, 2), key=spacing)
    return [*leaders, *(swivel for swivel in steered if swivel not in leaders)]


def _under_axis(tree: FrozenTree, wheel: WheelCandidate, swivel: Swivel) -> str:
    """Return the place of a wheel's joint that takes it below the axis of its swivel."""
    ahead = np.append(unit_ahead(swivel.heading), 0.0)
    held = tree.pose(wheel.joint.parent)
    place = held[:3, :3].T @ (wheel.origin - swivel.trail * ahead - held[:3, 3])
    numbers = " ".join(f"{number:.6g}" for number in np.round(place, 6) + 0.0)
    return f'"{wheel.joint.name}" (line {wheel.joint.line}) to <origin xyz="{numbers}" .../>'
