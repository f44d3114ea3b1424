"""Joints that the planar model holds at rest: passive suspensions, rollers, steering wheels."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.leftovers import MAX_LISTED
from rpctl.drive.wheel_size import rollers_of
from rpctl.drive.wheels import WheelCandidate, moved_below, tilting, turns_like_wheel, wheel_like
from rpctl.errors import Finding, listed

MAX_ROCKER_RANGE = 0.5 * math.pi  # rad; what tilts further may be an arm
MAX_STRUT_RADII = 2.0  # of its wheel's radius; what slides further may be a lift
MIN_STRUT_COSINE = math.cos(math.radians(45.0))  # between a strut's axis and the upright


def hold_passive(
    tree: FrozenTree, kind: str | None, free: Collection[str]
) -> tuple[FrozenTree, tuple[Finding, ...]]:
    """Return a robot with what is passive in its wheels held at rest, and that in findings.

    The ground is flat and the base does not tilt, so that what springs under it does not move. A
    strut slides about upright and a rocker turns about a level axis; nothing drives it, it carries
    wheels on the ground and no arm, and its travel is small or springs oppose it. Where that is
    not clear it is left free. The rollers of a wheel turn with the contact, which the drive's
    rows of rolling describe. A driver's steering wheel moves none of the robot's.

    Args:
        tree: The robot, with the joints that the user locks.
        kind: Type of the drive that the user gives, or None; a fixed base has no suspension.
        free: Joints that are not to be held.
    """
    if kind == "fixed":
        return tree, ()
    wheels = _wheels(tree)
    ground = min((w.bottom for w in wheels if w.round), default=math.nan)
    rollers = _rollers(tree, wheels)
    findings, suspensions = [], _suspensions(tree, wheels, ground, rollers, free)
    rest = {name: tree.description.joint[name].nearest_to_zero for name in suspensions}
    for name, carried in suspensions.items():
        joint = tree.description.joint[name]
        if joint.mimic is not None and joint.mimic.joint in suspensions:
            leader = tree.description.joint[joint.mimic.joint]
            rest[name] = joint.mimic.multiplier * leader.nearest_to_zero + joint.mimic.offset
        unit = "m" if joint.kind == "prismatic" else "rad"
        text = f'"{name}" is a passive suspension of {listed(carried, MAX_LISTED)}; the planar '
        text += f"model holds it at rest ({rest[name]:g} {unit}), --lock {name}=POSITION holds it"
        findings.append(Finding("info", joint.line, f"{text} elsewhere"))
    rest |= {name: 0.0 for name in rollers if name not in free}
    for joint in _steering_wheels(tree, wheels, ground):
        if joint.name not in free:
            rest[joint.name] = joint.nearest_to_zero
            text = (
                f'"{joint.name}" turns a steering wheel, which rpctl freezes; --free lets it turn'
            )
            findings.append(Finding("info", joint.line, text))
    held = {name: wheel for name, wheel in rollers.items() if name not in free}
    if held:
        names = listed(dict.fromkeys(held.values()), MAX_LISTED)
        text = (
            f"{len(held)} rollers of {names} are frozen: the drive's constraints describe their "
            "rolling"
        )
        findings.append(Finding("info", tree.description.joint[next(iter(held))].line, text))
    return FrozenTree(tree.description, {**tree.locked, **rest}), tuple(findings)


def _suspensions(
    tree: FrozenTree,
    wheels: Sequence[WheelCandidate],
    ground: float,
    rollers: Collection[str],
    free: Collection[str],
) -> dict[str, tuple[str, ...]]:
    """Return the joints that are clearly passive suspensions, and the wheels of each.

    They are so if all that could hold these wheels is clear.
    """
    carried: dict[str, list[WheelCandidate]] = {}
    holding = {wheel.joint.name: tilting(tree, wheel.joint) for wheel in wheels}
    for wheel in wheels:
        unknown = wheel.named and wheel.radius is None
        if unknown or (wheel.round and wheel.is_near(ground)):
            for carrier in holding[wheel.joint.name]:
                carried.setdefault(carrier.name, []).append(wheel)
    clear = {
        name
        for name, group in carried.items()
        if name not in free and _gives_way(tree, tree.description.joint[name], group, rollers)
    }
    return {
        name: tuple(wheel.joint.name for wheel in group)
        for name, group in carried.items()
        if name in clear
        and all(each.name in clear for wheel in group for each in holding[wheel.joint.name])
    }


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
    tree: FrozenTree, wheels: Sequence[WheelCandidate], ground: float
) -> list[Joint]:
    """Return the joints of steering wheels: so called, and higher than any wheel on the ground."""
    top = ground + 2.0 * max((w.radius for w in wheels if w.radius and w.round), default=math.nan)
    return [
        joint
        for joint in tree.description.joints
        if "steeringwheel" in f"{joint.name} {joint.child}".lower().replace("_", "")
        and tree.is_free(joint)
        and joint.kind != "prismatic"
        and not tree.is_upright(joint)
        and float(tree.frame(joint)[2, 3]) > top
        and not moved_below(tree, joint)
    ]


def _gives_way(
    tree: FrozenTree, joint: Joint, wheels: Sequence[WheelCandidate], rollers: Collection[str]
) -> bool:
    """Return whether a joint is clearly a passive suspension of wheels.

    It moves wheels, their rollers and what holds them only.
    """
    names = {wheel.joint.name for wheel in wheels}
    holding = {c.name for wheel in wheels for c in tree.free_joints(wheel.joint.parent)}
    actuated, below = tree.description.actuated, {each.name for each in moved_below(tree, joint)}
    if joint.name in actuated or not below <= names | holding | {*rollers}:
        return False
    travel = joint.upper - joint.lower
    undriven = bool(names & actuated)  # the file names motors
    undriven = undriven or joint.name in tree.description.sprung
    if joint.kind == "prismatic":
        radius = min((wheel.radius for wheel in wheels if wheel.radius), default=0.0)
        strut = abs(float(tree.axis(joint)[2])) >= MIN_STRUT_COSINE
        return strut and (undriven or travel <= MAX_STRUT_RADII * radius)
    springs = joint.damping > 0.0 and math.isfinite(travel)
    return tree.is_level(joint) and (undriven or springs or travel <= MAX_ROCKER_RANGE)


def _rollers(tree: FrozenTree, wheels: Sequence[WheelCandidate]) -> dict[str, str]:
    """Return the rollers of wheels, and whose each is, whatever a transmission says."""
    whose: dict[str, str] = {}
    for wheel in wheels:
        rollers = rollers_of(tree, wheel.joint)
        if len(moved_below(tree, wheel.joint)) == len(rollers):
            whose |= {roller.name: wheel.joint.name for roller in rollers}
    return whose
