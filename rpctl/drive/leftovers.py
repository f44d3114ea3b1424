"""Joints that look like wheels and were not taken for any: why, and what would settle it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from os.path import commonprefix

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_LEAN_DEG, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.wheel_size import rollers_of
from rpctl.drive.wheels import (
    CASTER_WORDS,
    WHEEL_WORDS,
    WheelCandidate,
    ground_tolerance,
    is_called,
    moved_below,
    tilting,
    wheel_like,
)
from rpctl.errors import listed

MIN_LETTERS = 3  # of a pattern beside its star
MAX_LISTED = 8  # joints that a message lists


@dataclass(frozen=True)
class Leftover:
    """A joint that looks like a wheel's, and is none of the drive's.

    Attributes:
        joint: The joint.
        why: Why it was not taken, in words that follow its name.
        hold: Joints to lock so that it can be taken; empty if no lock would do.
        edit: What to change in the file instead; empty if nothing.
        steered: Whether what holds it steers, so that it is a wheel whatever else may be said.
    """

    joint: Joint
    why: str
    hold: tuple[str, ...] = ()
    edit: str = ""
    steered: bool = False


def find_leftovers(
    tree: FrozenTree,
    wheels: Sequence[WheelCandidate],
    free: Collection[str],
    driven: Collection[str] = (),
) -> tuple[Leftover, ...]:
    """Return the joints that look like wheels and were not taken, in file order.

    What is called a wheel counts wherever it is, but for steering wheels, which are not level and
    high up; other round things, if they end on the ground, and what the root link or a strut
    holds, if it ends near it. So does what a plugin or a controller drives as a wheel. Rollers are
    of their wheels.

    Args:
        free: Joints that the user wants free: they are no wheels.
        driven: Joints that plugins and controllers of the base drive as wheels.
    """
    taken = {wheel.joint.name for wheel in wheels}
    taken |= {wheel.swivel.name for wheel in wheels if wheel.swivel is not None}
    others = [
        joint
        for joint in tree.description.joints
        if tree.is_free(joint) and joint.name not in taken and joint.name not in free
    ]
    like = [
        each
        for each in (wheel_like(tree, joint) for joint in others)
        if each is not None
        and not any(above.name in taken and _is_roller(tree, each, above)
                    for above in tree.free_joints(each.joint.parent))
    ]  # fmt: skip
    ground = min((wheel.bottom for wheel in wheels), default=math.nan)
    usual = max((wheel.radius or 0.0 for wheel in wheels), default=None)
    feet = [] if taken else [each for each in like if _is_foot(tree, each)]
    found = [
        _leftover(tree, each, ground, usual, len(feet) > 1 and any(each is foot for foot in feet))
        for each in like
    ]
    if taken:
        found += [_unrolling(tree, joint, ground, usual or 0.0) for joint in others]
    left = [each for each in found if each is not None]
    known = {each.joint.name for each in left}
    why = "a plugin or a controller drives it as a wheel, but it does not stand like one"
    left += [
        Leftover(joint, why, hold=_names(tilting(tree, joint)))
        for joint in others
        if joint.name in driven and joint.name not in known and joint.kind != "prismatic"
    ]
    return tuple(left)


def _is_roller(tree: FrozenTree, like: WheelCandidate, wheel: Joint) -> bool:
    """Return whether a joint on a wheel is its roller: what is called a wheel is one of several."""
    several = any(roller.name == like.joint.name for roller in rollers_of(tree, wheel))
    return wheel.endless and not tree.is_upright(wheel) and (several or not like.named)


def _is_foot(tree: FrozenTree, like: WheelCandidate) -> bool:
    """Return whether it is round, the last of its limb, and ends no higher than all else."""
    reaches = like.bottom - tree.floor <= ground_tolerance(like.radius or 0.0)
    return like.round and reaches and not moved_below(tree, like.joint)


def _leftover(
    tree: FrozenTree, like: WheelCandidate, ground: float, usual: float | None, foot: bool
) -> Leftover | None:
    """Return why a joint that looks like a wheel's was not taken; None if it is no wheel.

    ``usual`` is the radius (m) of one whose shapes tell none; ``foot`` is whether it ends one of
    several legs, where no wheel was taken.
    """
    joint, moving = like.joint, tilting(tree, like.joint)
    strut = len(moving) == 1 and moving[0].kind == "prismatic"
    like = like if like.radius is not None else replace(like, radius=usual)
    if not tree.is_level(joint) and not like.is_near(ground):
        return None
    near = like.stands(ground) if moving and not strut else like.is_near(ground)
    if math.isnan(ground) and strut:  # no wheel was taken, so all may hang on struts
        near = like.is_near(tree.floor)
    if not (like.named or (like.round and near) or foot):
        return None
    if joint.endless:
        return next(_faults(tree, joint, moving, like.bottom - ground))
    if like.stands(ground) or (like.named and math.isnan(ground)):
        return Leftover(joint, "has limits", edit=f'make it "continuous" (line {joint.line})')
    return None


def _faults(
    tree: FrozenTree, joint: Joint, moving: Sequence[Joint], gap: float
) -> Iterator[Leftover]:
    """Yield why an endless joint carries no wheel of the drive, what matters most first.

    ``moving`` are the joints that tilt it; ``gap`` is how far above the ground it ends, m.
    """
    above, below = tree.free_joints(joint.parent), moved_below(tree, joint)
    leaning = [
        carrier
        for carrier in moving
        if tree.is_leaning(carrier) or (carrier.endless and is_called(carrier, CASTER_WORDS))
    ]
    if leaning:
        ends = ((c, math.copysign(1.0, tree.axis(c)[2])) for c in leaning)
        upright = (axis_edit(tree, c, np.array([0.0, 0.0, up])) for c, up in ends)
        why = f"is steered about an axis more than {MAX_LEAN_DEG:g}° off the upright"
        yield Leftover(joint, why, edit=f"give {', '.join(upright)}", steered=True)
    if moving:
        still = [*moving, *[carrier for carrier in above if tree.is_upright(carrier)][:-1]]
        still = [c for c in above if c in still and not _carries_wheel(tree, c)]
        why = f"hangs on {_quoted(_names(still))}, which can move and may not be a suspension"
        yield Leftover(joint, why, hold=_names(still))
    if len(above) > 1:
        yield Leftover(joint, f"swivels about {len(above)} upright axes", hold=_names(above[:-1]))
    if joint.mimic is not None:
        edit = f"remove its <mimic> (line {joint.line}) if it rolls on the ground"
        yield Leftover(joint, f'mimics "{joint.mimic.joint}"', edit=edit)
    if not tree.is_level(joint):
        tilt = math.degrees(math.asin(min(1.0, abs(float(tree.axis(joint)[2])))))
        edit = f"level its <axis> (line {joint.line})"
        yield Leftover(joint, f"has an axle {tilt:.2g}° off horizontal", edit=edit)
    if below:
        yield Leftover(joint, f"moves other joints, {_quoted(_names(below))}", hold=_names(below))
    if math.isnan(gap):
        yield Leftover(joint, "has no other wheel beside it on the ground")
    yield Leftover(joint, f"ends {1e3 * gap:.3g} mm above the ground")


def _carries_wheel(tree: FrozenTree, carrier: Joint) -> bool:
    """Return whether wheels hang on an upright joint itself, as a trailer's do on its hitch."""
    wheels = [j for j in tree.description.joints if tree.is_free(j) and j.endless]
    above = [tree.free_joints(joint.parent)[-1:] for joint in wheels if tree.is_level(joint)]
    return tree.is_upright(carrier) and any(carrier in last for last in above)


def axis_edit(tree: FrozenTree, joint: Joint, axis: Array, change: str = "") -> str:
    """Return what to write of a joint: its <axis> along a direction (3,) of the root link's frame.

    Args:
        change: What else, before it.
    """
    own = tree.frame(joint)[:3, :3].T @ (axis / np.linalg.norm(axis))
    numbers = " ".join(f"{value:.6g}" for value in np.round(own, 6) + 0.0)
    return f'"{joint.name}" (line {joint.line}) {change}<axis xyz="{numbers}"/>'


def _unrolling(tree: FrozenTree, joint: Joint, ground: float, usual: float) -> Leftover | None:
    """Return an upright joint that turns what is called a caster or a wheel, and cannot roll.

    A wheel stands on the ground; a caster that is drawn higher than a wheel's usual radius (m), as
    a head that swivels, is none.
    """
    if not tree.is_upright(joint) or moved_below(tree, joint):
        return None
    height = tree.lowest(joint.child) - ground
    if joint.endless and is_called(joint, CASTER_WORDS) and not usual < height < math.inf:
        return Leftover(joint, "is called a caster, but its wheel does not turn")
    if is_called(joint, WHEEL_WORDS) and abs(height) <= ground_tolerance(0.0):
        edit = f'put a "continuous" joint about its axle between "{joint.name}" '
        edit += f'(line {joint.line}) and "{joint.child}"'
        return Leftover(joint, "steers a wheel that does not roll", edit=edit, steered=True)
    return None


def _names(joints: Sequence[Joint]) -> tuple[str, ...]:
    return tuple(joint.name for joint in joints)


def explain_leftovers(tree: FrozenTree, kind: str, leftovers: Sequence[Leftover]) -> str:
    """Return the message that a drive leaves out what looks like wheels, and what to say.

    Args:
        leftovers: What it leaves out; at least one.
    """
    reasons: dict[str, list[str]] = {}
    for each in leftovers:
        reasons.setdefault(each.why, []).append(each.joint.name)
    looks = "; ".join(f"{_quoted(names)} {why}" for why, names in reasons.items())
    lead = f"{tree.description.path}:{leftovers[0].joint.line}: the {kind} drive ignores what "
    lead += f"looks like a wheel: {looks}; choose:"
    hold = dict.fromkeys(name for each in leftovers for name in each.hold)
    names = [each.joint.name for each in leftovers if not each.steered]
    lines = [lead]
    if hold:
        lines.append(f"{lock_option(tree, [*hold])}  (holds it at 0; NAME=POSITION elsewhere)")
    lines += dict.fromkeys(each.edit for each in leftovers if each.edit)
    if names:
        lines.append(f"{lock_option(tree, names)}  (part of the body, it does not turn)")
        lines.append(f"{option(tree, '--free', names)}  (no wheel: a joint of the arm)")
    return "\n  ".join(lines)


def lock_option(tree: FrozenTree, names: Sequence[str]) -> str:
    """Return the option that locks the joints of these names, as one pattern where one does it."""
    return option(tree, "--lock", names)


def option(tree: FrozenTree, flag: str, names: Sequence[str]) -> str:
    """Return an option for joints, as one pattern where it fits no other moving joint."""
    moving = {joint.name for joint in tree.description.joints if joint.moving}
    for pattern in _patterns(names) if len(names) > 1 else ():
        fits = {name for name in moving if fnmatchcase(name, pattern)}
        if len(pattern) > MIN_LETTERS and fits == set(names):
            return f"{flag} '{pattern}'"
    return " ".join(f"{flag} {name}" for name in names)


def _patterns(names: Sequence[str]) -> Iterator[str]:
    """Yield patterns that fit all names: of the words in front, behind, at both ends, inside."""
    turned = [name[::-1] for name in names]
    start, end = commonprefix(names), commonprefix(turned)[::-1]  # noqa: RUF071 - no paths
    start, end = start[: start.rfind("_") + 1], end[end.find("_") :] if "_" in end else ""
    yield from (f"{start}*", f"*{end}", f"{start}*{end}")
    words = names[0].split("_") if len(names) > 2 else []  # of two, names are clearer
    runs = [words[i:j] for i in range(len(words)) for j in range(i + 1, len(words) + 1)]
    for run in sorted(runs, key=len, reverse=True):
        inside = "_".join(run)
        if all(inside in name for name in names):
            yield f"*{inside}*"


def _quoted(names: Sequence[str]) -> str:
    return listed([f'"{name}"' for name in names], MAX_LISTED)
