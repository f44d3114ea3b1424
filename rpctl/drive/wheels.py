"""Joints that could carry a wheel or steer one: where they are, how large, and what they do."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive import Swivel, SwivelSpec, WheelSpec
from rpctl.drive.rows import unit_ahead, unit_left
from rpctl.drive.wheel_size import rollers_of, round_parts, wheel_size

MAX_AXLE_OFFSET = 0.02  # of the distance between two wheels: so far apart axles of a pair may be

GROUND_TOLERANCE_M = 5.001e-3  # m; what is so near to the ground touches it (URDFs are in mm),
GROUND_TOLERANCE_RADII = 0.1  # and so is a wheel within this share of its radius
MECANUM_DEG = (20.0, 70.0)  # between a mecanum wheel's rollers and its axle; of an omni wheel 90
WHEEL_WORDS = ("wheel", "tyre", "tire")  # in names, see `is_called`
CASTER_WORDS = ("caster", "castor", "swivel")
TRAILER_WORDS = ("trailer", "hitch", "drawbar")
MAX_CAMBER_SINE = 0.9  # of a wheel's axle off the level; a steeper one steers
NEAR_RADII = 1.0  # so many of its radii above the ground a wheel may end that hangs in a suspension


def ground_tolerance(radius: float) -> float:
    """Return how far (m) above the ground a wheel of a radius (m) may end and still touch it."""
    return max(GROUND_TOLERANCE_M, GROUND_TOLERANCE_RADII * radius)


@dataclass(frozen=True)
class WheelCandidate:
    """A joint that could carry a wheel. Vectors are in the root link's frame, see `FrozenTree`.

    Attributes:
        joint: The joint.
        origin: Its origin (3,), m.
        axle: Its unit axis (3,).
        swivel: The upright joint that carries it, or None where the root link does.
        radius: m; None if it is unknown.
        source: Where the radius came from.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        ball: Whether its shape is a sphere: a ball, unless nothing else is a wheel.
        uneven: The two extents of its mesh across the axle, in words, if they differ too much.
        unread: Which mesh of it cannot be read, and why, in words, where others tell its radius.
        round: Whether its shapes are round about its axle.
    """

    joint: Joint
    origin: Array
    axle: Array
    swivel: Joint | None
    radius: float | None
    source: str
    offset: float
    ball: bool
    uneven: str
    unread: str = ""
    round: bool = True

    @property
    def centre(self) -> Array:
        """The wheel's centre (3,) in the root link's frame, m."""
        return self.origin + self.offset * self.axle

    @property
    def bottom(self) -> float:
        """Height of its lowest point in the root link's frame, m; NaN without a radius."""
        return float(self.centre[2]) - (math.nan if self.radius is None else self.radius)

    @property
    def named(self) -> bool:
        """Whether a name says that it is a wheel."""
        return is_called(self.joint, WHEEL_WORDS)

    def stands(self, ground: float) -> bool:
        """Return whether it ends on the ground, whose height is given in m."""
        return abs(self.bottom - ground) <= ground_tolerance(self.radius or 0.0)

    def is_near(self, ground: float) -> bool:
        """Return whether it ends near the ground, whose height is given in m."""
        return self.bottom - ground <= NEAR_RADII * (self.radius or 0.0)


def find_candidates(tree: FrozenTree, specs: Mapping[str, WheelSpec]) -> list[WheelCandidate]:
    """Return the joints that could carry wheels.

    Such a joint turns without limits about a level axis, and is held by the root link, rigidly, by
    an upright joint, or by more of them, each of whose links carries wheels: trailers.

    Args:
        tree: The robot; its locked joints hold as fixed ones do.
        specs: What the user says of wheels, by joint.
    """
    held: dict[str, list[Joint]] = {}  # what carries each joint
    for joint in tree.description.joints:
        above = tree.free_joints(joint.parent)
        if (
            turns_like_wheel(tree, joint)
            and all(map(tree.is_upright, above))
            and not _carries_arm(tree, joint)
            and tree.is_level(joint)
        ):
            held[joint.name] = above
    carrying = {above[-1].name for above in held.values() if above}
    return [
        as_candidate(tree, tree.description.joint[name], specs.get(name))
        for name, above in held.items()
        if all(each.name in carrying for each in above)
    ]


def as_candidate(tree: FrozenTree, joint: Joint, spec: WheelSpec | None = None) -> WheelCandidate:
    """Return a joint with what its shapes, or the user, tell of it as a wheel's."""
    size = wheel_size(tree, joint)
    if spec is not None and spec.radius is not None:
        size = size._replace(radius=spec.radius, source="drive file", uneven="", unread="")
    parts = round_parts(tree, joint)
    return WheelCandidate(
        joint=joint,
        origin=tree.frame(joint)[:3, 3],
        axle=tree.axis(joint),
        swivel=next(reversed(tree.free_joints(joint.parent)), None),
        radius=size.radius,
        source=size.source,
        offset=size.offset,
        ball=bool(parts) and all(part.shape.kind == "sphere" for part in parts),
        uneven=size.uneven,
        unread=size.unread,
        round=bool(parts) or (size.radius is not None and not size.uneven),
    )


def turns_like_wheel(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint is free, turns without limits, and follows no other joint."""
    return tree.is_free(joint) and joint.endless and joint.mimic is None


def _carries_arm(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint moves others than the rollers of a wheel, which turn freely on it."""
    above = len(tree.free_joints(joint.child))
    return any(
        not below.endless or len(tree.free_joints(below.parent)) > above
        for below in moved_below(tree, joint)
    )


def coaxial(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels turn about one line seen from above, but for a file's rounding.

    Wheels of two sizes have axles of two heights; only where they stand matters.
    """
    between = (b.centre - a.centre)[:2]
    distance = math.hypot(*between)
    apart = abs(float(a.axle[0] * between[1] - a.axle[1] * between[0]))
    return parallel(a, b) and distance > 0.0 and apart <= MAX_AXLE_OFFSET * distance


def parallel(a: WheelCandidate, b: WheelCandidate) -> bool:
    """Return whether two wheels' axles are parallel, apart from a file's rounding."""
    return abs(float(a.axle @ b.axle)) > 1.0 - MAX_TILT_SINE**2


def mostly_left(axle: Array) -> float:
    """Positive when the axle points left of forward; forward is +x, or +y for an axle along x."""
    return float(axle[1]) if abs(axle[1]) > MAX_TILT_SINE else -float(axle[0])


def leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right."""
    return axle * math.copysign(1.0, mostly_left(axle))


def has_mecanum_rollers(tree: FrozenTree, wheel: WheelCandidate) -> bool:
    """Return whether a wheel's rollers lie askew to its axle, as a mecanum wheel's do."""
    rollers = rollers_of(tree, wheel.joint)
    cosines = [min(1.0, abs(float(tree.axis(roller) @ wheel.axle))) for roller in rollers]
    low, high = MECANUM_DEG
    return bool(cosines) and all(low < math.degrees(math.acos(c)) < high for c in cosines)


def contact_roller(tree: FrozenTree, wheel: WheelCandidate) -> Array | None:
    """Return a vector (2,) along the roller on the ground, of a mecanum wheel with rollers.

    It is the lowest one's; in the root link's frame, of no certain length and way.
    """
    if not has_mecanum_rollers(tree, wheel):
        return None
    rollers = rollers_of(tree, wheel.joint)
    lowest = min(rollers, key=lambda roller: float(tree.pose(roller.child)[2, 3]))
    return np.asarray(tree.axis(lowest)[:2])


def wheel_like(tree: FrozenTree, joint: Joint) -> WheelCandidate | None:
    """Return a free joint that looks like a wheel's, whatever holds it; None if it does not.

    Its axis is about level, and it turns without limits, or is called a wheel.
    """
    named = is_called(joint, WHEEL_WORDS)
    if not tree.is_free(joint) or joint.kind == "prismatic" or not (named or joint.endless):
        return None
    if abs(float(tree.axis(joint)[2])) > (MAX_CAMBER_SINE if named else MAX_TILT_SINE):
        return None
    return as_candidate(tree, joint)


def is_called(joint: Joint, words: Iterable[str]) -> bool:
    """Return whether the name of a joint, or of the link that it moves, has one of these words."""
    return any(word in f"{joint.name} {joint.child}".lower() for word in words)


def moved_below(tree: FrozenTree, joint: Joint) -> list[Joint]:
    """Return the free joints below a joint, in the order of the tree."""
    return [below for below in tree.description.below(joint)[1:] if tree.is_free(below)]


def tilting(tree: FrozenTree, joint: Joint) -> list[Joint]:
    """Return the free joints above one that are no swivels."""
    return [carrier for carrier in tree.free_joints(joint.parent) if not tree.is_upright(carrier)]


MIN_TRAIL_M = 5e-3  # m, or
MIN_TRAIL_RADII = 0.1  # of the radius: a contact nearer to the swivel's axis does not trail
MIN_TRACK_RADII = 3.0  # between the wheels of a trailer; twin wheels of a caster stand closer
SHARED_TRAIL_ROUNDING_M = 2e-3  # m; rounding of a file: a smaller trail of one of several
TRAIL_ROUNDING_M = 1e-9  # m; a smaller one is that of numbers


@dataclass(frozen=True)
class SwivelCandidate:
    """An upright joint of a description that carries wheels.

    Attributes:
        joint: The joint.
        wheels: The wheels that it carries.
        swivel: What a drive has of it, its role seen by itself: steered, a caster or a trailer.
        off_axis: Whether its contact is so far off its axis that it would trail.
        body: Whether it trails and carries a pair of wheels so wide, or another swivel, as no
            caster does.
        doubt: The evidence for another role, in words; empty if there is none.
    """

    joint: Joint
    wheels: tuple[WheelCandidate, ...]
    swivel: Swivel
    off_axis: bool
    body: bool
    doubt: str

    @property
    def role(self) -> str:
        """Its role seen by itself."""
        return self.swivel.role

    def lateral(self, wheel: WheelCandidate) -> float:
        """Return the distance of a wheel's contact to the left of the axis, m."""
        return float(unit_left(self.swivel.heading) @ (wheel.centre[:2] - self.swivel.pivot))

    def towards(self, forward: Array) -> SwivelCandidate:
        """Return the swivel with wheels that roll towards a direction (2,), unless they trail.

        Swivels that share a lateral force take its mean over one left.
        """
        if self.swivel.trails or float(unit_ahead(self.swivel.heading) @ forward) >= 0.0:
            return self
        return replace(self, swivel=self.swivel.reversed())

    def trailing(self) -> SwivelCandidate:
        """Return the swivel as a caster: its contact lies behind its axis."""
        doubt, why, swivel = "", self.swivel.why, self.swivel.behind()
        if self.role != "caster":
            why = f"contact {1e3 * abs(swivel.trail):.3g} mm off its axis; {why}"
        if math.isfinite(self.joint.upper - self.joint.lower):
            doubt = f'"{self.joint.name}" is a caster but has limits, which it would reach'
        return replace(self, swivel=replace(swivel, role="caster", why=why), doubt=doubt)


def find_swivels(
    tree: FrozenTree,
    wheels: tuple[WheelCandidate, ...],
    specs: Mapping[str, SwivelSpec],
) -> tuple[SwivelCandidate, ...]:
    """Return the swivels that carry the given wheels, in file order, each after what carries it.

    Args:
        specs: What the user says of swivels, by joint.
    """
    groups: dict[str, list[WheelCandidate]] = {}
    for wheel in wheels:
        if wheel.swivel is not None:
            groups.setdefault(wheel.swivel.name, []).append(wheel)
    above = {name: tree.free_joints(tree.description.joint[name].parent) for name in groups}
    towing = {each.name for carriers in above.values() for each in carriers}
    return tuple(
        _swivel_candidate(tree, tuple(groups[name]), specs.get(name, SwivelSpec(name)), towing)
        for name in sorted(groups, key=lambda name: len(above[name]))
    )


def _swivel_candidate(
    tree: FrozenTree, wheels: tuple[WheelCandidate, ...], spec: SwivelSpec, towing: Collection[str]
) -> SwivelCandidate:
    joint = tree.description.joint[spec.joint]
    origin, axis = tree.frame(joint)[:3, 3], tree.axis(joint)
    pivot = origin[:2]
    if tree.is_leaning(joint):
        height = origin[2] - np.mean([wheel.bottom for wheel in wheels])
        pivot = pivot - height / axis[2] * axis[:2]
    left = leftward(wheels[0].axle)
    heading = math.atan2(-left[0], left[1])
    contact = np.mean([wheel.centre[:2] for wheel in wheels], axis=0)
    trail = float(unit_ahead(heading) @ (contact - pivot))
    radius = max(wheel.radius or 0.0 for wheel in wheels)
    off_axis = abs(trail) > max(MIN_TRAIL_M, MIN_TRAIL_RADII * radius)
    apart = np.ptp([float(wheel.centre @ left) for wheel in wheels])
    body = off_axis and bool(joint.name in towing or apart > MIN_TRACK_RADII * radius)
    actuated = joint.name in tree.description.actuated
    role, why, doubt = _role(joint, trail, off_axis, body, spec, actuated)
    swivel = Swivel(
        joint=joint.name,
        role=role,
        pivot=(float(pivot[0]), float(pivot[1])),
        heading=heading,
        sign=math.copysign(1.0, axis[2]),
        trail=0.0 if abs(trail) < TRAIL_ROUNDING_M else trail,
        ratio=1.0 if joint.mimic is None else joint.mimic.multiplier,
        offset=0.0 if joint.mimic is None else joint.mimic.offset,
        parent=next((above.name for above in reversed(tree.free_joints(joint.parent))), None),
        why=why,
    )
    swivel = swivel.behind() if swivel.trails else swivel
    return SwivelCandidate(joint, wheels, swivel, off_axis, body, doubt)


def _role(
    joint: Joint, trail: float, off_axis: bool, body: bool, spec: SwivelSpec, actuated: bool
) -> tuple[str, str, str]:
    """Return whether a swivel steers or trails, why, and what speaks against it.

    ``off_axis`` and ``body`` are those of :class:`SwivelCandidate`.
    """
    if spec.role is not None:
        return spec.role, "the drive file says so", ""
    if joint.mimic is not None:
        return "steered", f'it mimics "{joint.mimic.joint}"', ""
    caster = off_axis and any(word in joint.name.lower() for word in CASTER_WORDS)
    if actuated and not caster:
        return "steered", "a transmission drives it", ""
    limited = math.isfinite(joint.upper - joint.lower)
    below = abs(trail) < SHARED_TRAIL_ROUNDING_M
    why = "contact below its axis" if below else f"contact {1e3 * abs(trail):.3g} mm off its axis"
    choice = 'if it steers, set role = "steered" of its [[swivel]] in a drive file'
    named = off_axis and is_called(joint, TRAILER_WORDS)
    if named or (body and not (limited and joint.effort)):
        why += ", its name" if named else ", a pair of wheels or a further body"
        doubt = (
            f'"{joint.name}" is treated as the hitch of a trailer, which no motor turns; {choice}'
        )
        return "trailer", why, "" if named or not joint.effort else doubt
    doubt = f'"{joint.name}" is treated as a caster; {choice}, "caster" if not'
    if caster and actuated:
        but = "a transmission drives it"
        return "caster", f"{why}, its name; but {but}", f"{doubt}; {but}"
    if off_axis and not limited:
        return "caster", f"{why}, no limits", "" if caster else doubt
    if caster:
        doubt += "; a caster would run into its limits"
        return "caster", f"{why}, its name; but it has limits", doubt
    return "steered", f"{why}, {'limits' if limited else 'no limits'}", ""
