"""Joints that the planar model holds at rest: passive suspensions, rollers, steering wheels."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.leftovers import MAX_LISTED
from rpctl.drive.wheel_size import rollers_of
from rpctl.drive.wheels import WheelCandidate, moved_below, turns_like_wheel, wheel_like
from rpctl.errors import Finding, listed

MAX_ROCKER_RANGE = 0.5 * math.pi  # rad; what tilts further may be an arm
MAX_STRUT_RADII = 2.0  # of its wheel's radius; what slides further may be a lift
MIN_STRUT_COSINE = math.cos(math.radians(45.0))  # between a strut's axis and the upright


@dataclass(frozen=True)
class HeldJoint:
    """A joint that is held at rest.

    Attributes:
        joint: The joint.
        position: Where, rad or m: at 0, or the nearest to it inside the limits.
        wheels: The wheels that it carries, or the wheel whose roller it is.
        what: ``"suspension"``, ``"roller"`` or ``"steering wheel"``.
    """

    joint: Joint
    position: float
    wheels: tuple[str, ...] = ()
    what: str = "suspension"


def hold_passive(
    tree: FrozenTree, kind: str | None, free: Collection[str]
) -> tuple[FrozenTree, tuple[Finding, ...]]:
    """Return a robot with its passive suspensions held at rest, and what is held, in findings.

    Args:
        tree: The robot, with the joints that the user locks.
        kind: Type of the drive that the user gives, or None; a fixed base has no suspension.
    """
    if kind == "fixed":
        return tree, ()
    held = find_held(tree, free)
    at_rest = {each.joint.name: each.position for each in held}
    return FrozenTree(tree.description, {**tree.locked, **at_rest}), held_findings(held)


def find_held(tree: FrozenTree, free: Collection[str]) -> tuple[HeldJoint, ...]:
    """Return the joints that are held at rest, in file order.

    The ground is flat and the base does not tilt, so that what springs under it does not move. A
    strut slides about upright and a rocker turns about a level axis; nothing drives it, it carries
    wheels on the ground and no arm, and its travel is small or springs oppose it. Where that is
    not clear it is left free. The rollers of a wheel turn with the contact, which the drive's
    rows of rolling describe. A driver's steering wheel moves none of the robot's.
    """
    wheels = _wheels(tree)
    ground = min((w.bottom for w in wheels if w.round), default=math.nan)
    carried: dict[str, list[WheelCandidate]] = {}
    for wheel in wheels:
        unknown = wheel.named and wheel.radius is None
        if unknown or (wheel.round and wheel.is_near(ground)):
            for carrier in _carriers(tree, wheel):
                carried.setdefault(carrier.name, []).append(wheel)
    rollers = dict(_rollers(tree, wheels))
    clear = {
        name
        for name, group in carried.items()
        if name not in free and _gives_way(tree, name, group, rollers)
    }
    held = {name for name in clear if _whole(tree, carried[name], clear)}
    return (
        *(_at_rest(tree, name, carried[name], held) for name in carried if name in held),
        *(
            HeldJoint(tree.description.joint[name], 0.0, (wheel,), "roller")
            for name, wheel in rollers.items()
            if name not in free
        ),
        *(
            HeldJoint(joint, joint.nearest_to_zero, what="steering wheel")
            for joint in _steering_wheels(tree, wheels, ground)
            if joint.name not in free
        ),
    )


def _wheels(tree: FrozenTree) -> list[WheelCandidate]:
    """Return the endless joints that look like wheels', but those on other such, as rollers are."""
    like = (wheel_like(tree, joint) for joint in tree.description.joints)
    turning = {w.joint.name: w for w in like if w is not None and turns_like_wheel(tree, w.joint)}
    return [
        wheel
        for wheel in turning.values()
        if not any(above.name in turning for above in tree.free_joints(wheel.joint.parent))
    ]


def _steering_wheels(
    tree: FrozenTree, wheels: list[WheelCandidate], ground: float
) -> Iterator[Joint]:
    """Yield the joints of steering wheels: so called, and higher than any wheel on the ground."""
    top = ground + 2.0 * max((w.radius for w in wheels if w.radius and w.round), default=math.nan)
    for joint in tree.description.joints:
        named = "steeringwheel" in f"{joint.name} {joint.child}".lower().replace("_", "")
        turns = tree.is_free(joint) and joint.kind != "prismatic" and not tree.is_upright(joint)
        high = float(tree.frame(joint)[2, 3]) > top
        if named and turns and high and not moved_below(tree, joint.child):
            yield joint


def held_findings(held: tuple[HeldJoint, ...]) -> tuple[Finding, ...]:
    """Return what is held, and how to have it otherwise, in findings."""
    findings = []
    for each in held:
        if each.what == "steering wheel":
            text = f'"{each.joint.name}" turns a steering wheel, which is held; --free lets it turn'
            findings.append(Finding("info", each.joint.line, text))
        if each.what == "suspension":
            unit = "m" if each.joint.kind == "prismatic" else "rad"
            text = (
                f'"{each.joint.name}" is a passive suspension of '
                f"{listed(each.wheels, MAX_LISTED)}; "
                f"the planar model holds it at rest ({each.position:g} {unit}), "
                f"--lock {each.joint.name}=POSITION holds it elsewhere"
            )
            findings.append(Finding("info", each.joint.line, text))
    rollers = [each for each in held if each.what == "roller"]
    if rollers:
        wheels = tuple(dict.fromkeys(name for each in rollers for name in each.wheels))
        text = (
            f"{len(rollers)} rollers of {listed(wheels, MAX_LISTED)} are held: how they roll is "
            "in the drive's constraints"
        )
        findings.append(Finding("info", rollers[0].joint.line, text))
    return tuple(findings)


def _carriers(tree: FrozenTree, wheel: WheelCandidate) -> list[Joint]:
    """Return the free joints above a wheel that are no swivels."""
    return [c for c in tree.free_joints(wheel.joint.parent) if not tree.is_upright(c)]


def _whole(tree: FrozenTree, wheels: list[WheelCandidate], clear: set[str]) -> bool:
    """Return whether each joint that could hold the wheels is clearly passive."""
    return all(c.name in clear for wheel in wheels for c in _carriers(tree, wheel))


def _gives_way(
    tree: FrozenTree,
    name: str,
    wheels: list[WheelCandidate],
    rollers: Collection[str],
) -> bool:
    """Return whether a joint is clearly a passive suspension of wheels."""
    joint = tree.description.joint[name]
    if name in tree.description.actuated or not _carries_wheels_only(tree, joint, wheels, rollers):
        return False
    travel = joint.upper - joint.lower
    undriven = any(
        wheel.joint.name in tree.description.actuated for wheel in wheels
    )  # the file names motors
    undriven = undriven or name in tree.description.sprung
    if joint.kind == "prismatic":
        radius = min((wheel.radius for wheel in wheels if wheel.radius), default=0.0)
        strut = abs(float(tree.axis(joint)[2])) >= MIN_STRUT_COSINE
        return strut and (undriven or travel <= MAX_STRUT_RADII * radius)
    springs = joint.damping > 0.0 and math.isfinite(travel)
    return tree.is_level(joint) and (undriven or springs or travel <= MAX_ROCKER_RANGE)


def _carries_wheels_only(
    tree: FrozenTree, joint: Joint, wheels: list[WheelCandidate], rollers: Collection[str]
) -> bool:
    """Return whether all that moves below a joint is wheels, their rollers and what holds them."""
    names = {wheel.joint.name for wheel in wheels} | {*rollers}
    holding = {c.name for wheel in wheels for c in tree.free_joints(wheel.joint.parent)}
    return all(below.name in names | holding for below in moved_below(tree, joint.child))


def _rollers(tree: FrozenTree, wheels: list[WheelCandidate]) -> Iterator[tuple[str, str]]:
    """Yield each roller of a wheel, and the wheel: endless joints, whatever a transmission says."""
    for wheel in wheels:
        rollers = rollers_of(tree, wheel.joint)
        if len(moved_below(tree, wheel.joint.child)) == len(rollers):
            yield from ((roller.name, wheel.joint.name) for roller in rollers)


def _at_rest(
    tree: FrozenTree, name: str, wheels: list[WheelCandidate], held: Collection[str]
) -> HeldJoint:
    """Return a suspension at rest; one that mimics another held one stands where that has it."""
    joint = tree.description.joint[name]
    position = joint.nearest_to_zero
    if joint.mimic is not None and joint.mimic.joint in held:
        leader = tree.description.joint[joint.mimic.joint]
        position = joint.mimic.multiplier * leader.nearest_to_zero + joint.mimic.offset
    return HeldJoint(joint, position, tuple(wheel.joint.name for wheel in wheels))
