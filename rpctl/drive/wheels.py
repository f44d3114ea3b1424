"""Joints that could carry a wheel or steer one: where they are, how large, and what they do."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive import TRAILING, Swivel, SwivelSpec, WheelSpec
from rpctl.drive.wheel_size import rollers_of, round_parts, wheel_size

MAX_AXLE_OFFSET = 0.02  # of the distance between two wheels: so far apart axles of a pair may be

GROUND_TOLERANCE_M = 5.001e-3  # m; what is so near to the ground touches it (URDFs are in mm),
GROUND_TOLERANCE_RADII = 0.1  # and so is a wheel within this share of its radius
MECANUM_DEG = (20.0, 70.0)  # between a mecanum wheel's rollers and its axle; of an omni wheel 90
WHEEL_WORDS = ("wheel", "tyre", "tire")
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
        frame: Its rotation (3, 3).
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
    frame: Array
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
        return is_named_wheel(self.joint)

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
        _candidate(tree, tree.description.joint[name], specs.get(name, WheelSpec(name)))
        for name, above in held.items()
        if all(each.name in carrying for each in above)
    ]


def _candidate(tree: FrozenTree, joint: Joint, spec: WheelSpec) -> WheelCandidate:
    size = wheel_size(tree, joint)
    if spec.radius is not None:
        size = size._replace(radius=spec.radius, source="drive file", uneven="", unread="")
    frame = tree.frame(joint)
    parts = round_parts(tree, joint)
    return WheelCandidate(
        joint=joint,
        origin=frame[:3, 3],
        axle=tree.axis(joint),
        frame=frame[:3, :3],
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
    child_joints = tree.description.child_joints
    stack = [(below, 0) for below in child_joints[joint.child]]
    while stack:
        below, depth = stack.pop()
        if tree.is_free(below):
            depth += 1
            if depth > 1 or not below.endless:
                return True
        stack.extend((further, depth) for further in child_joints[below.child])
    return False


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
    named = is_named_wheel(joint)
    if not tree.is_free(joint) or joint.kind == "prismatic" or not (named or joint.endless):
        return None
    if abs(float(tree.axis(joint)[2])) > (MAX_CAMBER_SINE if named else MAX_TILT_SINE):
        return None
    return _candidate(tree, joint, WheelSpec(joint.name))


def is_named_wheel(joint: Joint) -> bool:
    """Return whether the name of a joint, or of the link that it moves, is a wheel's."""
    return any(word in f"{joint.name} {joint.child}".lower() for word in WHEEL_WORDS)


def is_named_caster(joint: Joint) -> bool:
    """Return whether the name of a joint, or of the link that it moves, is a caster's."""
    return any(word in f"{joint.name} {joint.child}".lower() for word in CASTER_WORDS)


def moved_below(tree: FrozenTree, link: str) -> list[Joint]:
    """Return the free joints below a link, in the order of the tree."""
    found, stack = [], [*reversed(tree.description.child_joints[link])]
    while stack:
        joint = stack.pop()
        found += [joint] * tree.is_free(joint)
        stack += reversed(tree.description.child_joints[joint.child])
    return found


MIN_TRAIL_M = 5e-3  # m, or
MIN_TRAIL_RADII = 0.1  # of the radius: a contact nearer to the swivel's axis does not trail
CASTER_WORDS = ("caster", "castor", "swivel")  # in a joint's name they end the doubt
TRAILER_WORDS = ("trailer", "hitch", "drawbar")
MIN_TRACK_RADII = 3.0  # between the wheels of a trailer; twin wheels of a caster stand closer
SHARED_TRAIL_ROUNDING_M = 2e-3  # m; rounding of a file: a smaller trail of one of several
TRAIL_ROUNDING_M = 1e-9  # m; a smaller one is that of numbers


@dataclass(frozen=True)
class SwivelCandidate:
    """A swivel joint of a description: its pivot, heading, trail and role, at position 0.

    Attributes:
        joint: The joint.
        wheels: The wheels that it carries.
        pivot: Where its axis meets the ground (x, y) in the root link's frame, m.
        sign: 1 where its axis points up, −1 where it points down.
        ahead: Rolling direction of its wheels (2,), forward, or away from the contact of a caster.
        trail: Distance of the contact ahead of the axis, m.
        parent: The upright joint that carries it, or None where the root link does.
        role: ``"steered"``, ``"caster"`` or ``"trailer"``.
        trails: Whether its contact is so far off its axis that it would trail.
        body: Whether it carries a pair of wheels so wide, or another swivel, as no caster does.
        why: The reason for the role, in words.
        doubt: The evidence for the other role, in words; empty if there is none.
    """

    joint: Joint
    wheels: tuple[WheelCandidate, ...]
    pivot: Array
    sign: float
    ahead: Array
    trail: float
    parent: Joint | None
    role: str
    trails: bool
    body: bool
    why: str
    doubt: str

    @property
    def heading(self) -> float:
        """Rolling direction at position 0 in the root link's frame, rad."""
        return math.atan2(self.ahead[1], self.ahead[0])

    def lateral(self, wheel: WheelCandidate) -> float:
        """Return the distance of a wheel's contact to the left of the axis, m."""
        left = np.array([-self.ahead[1], self.ahead[0]])
        return float(left @ (wheel.centre[:2] - self.pivot))

    def towards(self, forward: Array) -> SwivelCandidate:
        """Return the swivel with wheels that roll towards a direction (2,), unless they trail.

        Swivels that share a lateral force take its mean over one left.
        """
        if self.role in TRAILING or float(self.ahead @ forward) >= 0.0:
            return self
        return replace(self, ahead=-self.ahead, trail=-self.trail)

    def trailing(self) -> SwivelCandidate:
        """Return the swivel as a caster: its contact lies behind its axis."""
        side, doubt, why = 1.0 if self.trail < 0.0 else -1.0, "", self.why
        if self.role != "caster":
            why = f"contact {1e3 * abs(self.trail):.3g} mm off its axis; {why}"
        if math.isfinite(self.joint.upper - self.joint.lower):
            doubt = f'"{self.joint.name}" is a caster, yet it has limits, into which it would run'
        return replace(
            self,
            ahead=side * self.ahead,
            trail=side * self.trail,
            role="caster",
            why=why,
            doubt=doubt,
        )

    def record(self, role: str, driven: bool, shares: str | None = None) -> Swivel:
        """Return the drive's record of it.

        Args:
            role: Its role in the drive, see :class:`Swivel`.
            shares: Swivel with which it shares one lateral constraint, or None.
        """
        mimic = self.joint.mimic
        return Swivel(
            joint=self.joint.name,
            role=role,
            pivot=(float(self.pivot[0]), float(self.pivot[1])),
            heading=self.heading,
            sign=self.sign,
            trail=0.0 if abs(self.trail) < TRAIL_ROUNDING_M else self.trail,
            driven=driven,
            shares=shares,
            ratio=1.0 if mimic is None else mimic.multiplier,
            offset=0.0 if mimic is None else mimic.offset,
            parent=None if self.parent is None else self.parent.name,
            why=self.why,
        )


def find_swivels(
    tree: FrozenTree,
    wheels: tuple[WheelCandidate, ...],
    specs: Mapping[str, SwivelSpec],
) -> list[SwivelCandidate]:
    """Return the swivels that carry the given wheels, in file order, each after what carries it.

    Args:
        specs: What the user says of swivels, by joint.
    """
    groups: dict[str, list[WheelCandidate]] = {}
    for wheel in wheels:
        if wheel.swivel is not None:
            groups.setdefault(wheel.swivel.name, []).append(wheel)
    joints = {name: tree.description.joint[name] for name in groups}
    above = {name: tree.free_joints(joint.parent) for name, joint in joints.items()}
    towing = {each.name for carriers in above.values() for each in carriers}
    return [
        _swivel_candidate(tree, tuple(groups[name]), specs.get(name, SwivelSpec(name)), towing)
        for name in sorted(groups, key=lambda name: len(above[name]))
    ]


def _swivel_candidate(
    tree: FrozenTree, wheels: tuple[WheelCandidate, ...], spec: SwivelSpec, towing: Collection[str]
) -> SwivelCandidate:
    joint = wheels[0].swivel
    assert joint is not None
    origin, axis = tree.frame(joint)[:3, 3], tree.axis(joint)
    pivot = origin[:2]
    if tree.is_leaning(joint):
        height = origin[2] - np.mean([wheel.bottom for wheel in wheels])
        pivot = pivot - height / axis[2] * axis[:2]
    left = leftward(wheels[0].axle)
    ahead = np.array([left[1], -left[0]]) / math.hypot(left[0], left[1])
    contact = np.mean([wheel.centre[:2] for wheel in wheels], axis=0)
    trail = float(ahead @ (contact - pivot))
    radius = max(wheel.radius or 0.0 for wheel in wheels)
    trails = abs(trail) > max(MIN_TRAIL_M, MIN_TRAIL_RADII * radius)
    apart = np.ptp([float(wheel.centre @ left) for wheel in wheels])
    body = joint.name in towing or apart > MIN_TRACK_RADII * radius
    role, why, doubt = _role(joint, trail, trails, body, spec, tree.description.actuated)
    if role in TRAILING and trail > 0.0:
        ahead, trail = -ahead, -trail
    return SwivelCandidate(
        joint=joint,
        wheels=wheels,
        pivot=pivot,
        sign=math.copysign(1.0, axis[2]),
        ahead=ahead,
        trail=trail,
        parent=next(reversed(tree.free_joints(joint.parent)), None),
        role=role,
        trails=trails,
        body=trails and body,
        why=why,
        doubt=doubt,
    )


def _role(
    joint: Joint,
    trail: float,
    trails: bool,
    body: bool,
    spec: SwivelSpec,
    actuated: Collection[str],
) -> tuple[str, str, str]:
    """Return whether a swivel steers or trails, why, and what speaks against it.

    ``body`` is whether it carries a pair of wheels so wide, or another swivel, as no caster does.
    """
    limited = math.isfinite(joint.upper - joint.lower)
    distance = f"contact {1e3 * abs(trail):.3g} mm off its axis"
    if abs(trail) < SHARED_TRAIL_ROUNDING_M:
        distance = "contact below its axis"
    if spec.role is not None:
        return spec.role, "the drive file says so", ""
    if joint.mimic is not None:
        return "steered", f'it mimics "{joint.mimic.joint}"', ""
    caster = trails and any(word in joint.name.lower() for word in CASTER_WORDS)
    if joint.name in actuated and not caster:
        return "steered", "a transmission drives it", ""
    choice = 'say role = "steered" of its [[swivel]] in a drive file if it steers'
    named = any(word in f"{joint.name} {joint.child}".lower() for word in TRAILER_WORDS)
    if trails and (named or (body and not (limited and joint.effort))):
        why = f"{distance}, {'its name' if named else 'a pair of wheels or a further body'}"
        doubt = (
            f'"{joint.name}" is taken for the hitch of a trailer, which no motor turns; {choice}'
        )
        return "trailer", why, "" if named or not joint.effort else doubt
    doubt = f'"{joint.name}" is taken for a caster; {choice}, "caster" if not'
    if caster and joint.name in actuated:
        why = f"{distance}, its name; but a transmission drives it"
        return "caster", why, f"{doubt}; a transmission drives it"
    if trails and not limited:
        return "caster", f"{distance}, no limits", "" if caster else doubt
    if caster:
        why = f"{distance}, its name; but it has limits"
        return "caster", why, f"{doubt}; a caster would run into its limits"
    return "steered", f"{distance}, {'limits' if limited else 'no limits'}", ""
