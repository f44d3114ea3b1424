"""Joints that look like wheels and were not taken for any: why, and what would settle it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import takewhile

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_LEAN_DEG, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.wheel_size import rollers_of
from rpctl.drive.wheels import (
    WheelCandidate,
    ground_tolerance,
    is_named_caster,
    is_named_wheel,
    moved_below,
    wheel_like,
)

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
    like = [
        each
        for each in (wheel_like(tree, joint) for joint in tree.description.joints)
        if each is not None
        and each.joint.name not in taken
        and each.joint.name not in free
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
    found += _idle_casters(tree, taken, free, ground + (usual or 0.0)) if taken else []
    found += _unrolling(tree, taken, free, ground) if taken else []
    left = [each for each in found if each is not None]
    known = taken | {*free} | {each.joint.name for each in left}
    return (*left, *_driven(tree, [name for name in driven if name not in known]))


def _is_roller(tree: FrozenTree, like: WheelCandidate, wheel: Joint) -> bool:
    """Return whether a joint on a wheel is its roller: what is called a wheel is one of several."""
    several = any(roller.name == like.joint.name for roller in rollers_of(tree, wheel))
    return wheel.endless and not tree.is_upright(wheel) and (several or not like.named)


def _is_foot(tree: FrozenTree, like: WheelCandidate) -> bool:
    """Return whether it is round, the last of its limb, and ends no higher than all else."""
    reaches = like.bottom - tree.floor <= ground_tolerance(like.radius or 0.0)
    return like.round and reaches and not moved_below(tree, like.joint.child)


def _leftover(
    tree: FrozenTree, like: WheelCandidate, ground: float, usual: float | None, foot: bool
) -> Leftover | None:
    """Return why a joint that looks like a wheel's was not taken; None if it is no wheel.

    ``usual`` is the radius (m) of one whose shapes tell none; ``foot`` is whether it ends one of
    several legs, where no wheel was taken.
    """
    joint = like.joint
    moving = _tilting(tree, joint)
    like = like if like.radius is not None else replace(like, radius=usual)
    if not tree.is_level(joint) and not like.is_near(ground):
        return None
    near = like.is_near(ground) if not moving or _is_strut(moving) else like.stands(ground)
    if math.isnan(ground) and _is_strut(moving):  # no wheel was taken, so all may hang on struts
        near = like.is_near(tree.floor)
    if not (like.named or (like.round and near) or foot):
        return None
    if not joint.endless:
        if not (like.stands(ground) or (like.named and math.isnan(ground))):
            return None
        return Leftover(joint, "has limits", edit=f'make it "continuous" (line {joint.line})')
    return _fault(tree, joint, moving) or _left_by_height(joint, like.bottom - ground)


def _fault(tree: FrozenTree, joint: Joint, moving: Sequence[Joint]) -> Leftover | None:
    """Return why an endless joint cannot carry a wheel of the drive, but for its height."""
    above, below = tree.free_joints(joint.parent), moved_below(tree, joint.child)
    leaning = [c for c in moving if tree.is_leaning(c) or (c.endless and is_named_caster(c))]
    if leaning:
        edits = (f'"{c.name}" (line {c.line}) {_upright_axis(tree, c)}' for c in leaning)
        why = f"is steered about an axis more than {MAX_LEAN_DEG:g}° off the upright"
        return Leftover(joint, why, edit=f"give {', '.join(edits)}", steered=True)
    if moving:
        still = [carrier.name for carrier in moving]
        still += [carrier.name for carrier in above if tree.is_upright(carrier)][:-1]
        names = tuple(c.name for c in above if c.name in still and not _carries_wheel(tree, c))
        why = f"hangs on {_quoted(names)}, which can move and may be no suspension"
        return Leftover(joint, why, hold=names)
    if len(above) > 1:
        names = tuple(carrier.name for carrier in above[:-1])
        return Leftover(joint, f"swivels about {len(above)} upright axes", hold=names)
    if joint.mimic is not None:
        edit = f"take its <mimic> out (line {joint.line}) if it rolls on the ground"
        return Leftover(joint, f'mimics "{joint.mimic.joint}"', edit=edit)
    if not tree.is_level(joint):
        tilt = math.degrees(math.asin(min(1.0, abs(float(tree.axis(joint)[2])))))
        edit = f"level its <axis> (line {joint.line})"
        return Leftover(joint, f"has an axle {tilt:.2g}° off the level", edit=edit)
    if below:
        names = tuple(each.name for each in below)
        return Leftover(joint, f"moves other joints, {_quoted(names)}", hold=names)
    return None


def _carries_wheel(tree: FrozenTree, carrier: Joint) -> bool:
    """Return whether wheels hang on an upright joint itself, as a trailer's do on its hitch."""
    wheels = [j for j in tree.description.joints if tree.is_free(j) and j.endless]
    above = [tree.free_joints(joint.parent)[-1:] for joint in wheels if tree.is_level(joint)]
    return tree.is_upright(carrier) and any(j.name == carrier.name for last in above for j in last)


def _upright_axis(tree: FrozenTree, joint: Joint) -> str:
    """Return the element of a joint that stands upright, and points up or down as it does."""
    up = np.array([0.0, 0.0, math.copysign(1.0, tree.axis(joint)[2])])
    return axis_element(tree.frame(joint)[:3, :3].T @ up)


def axis_element(axis: Array) -> str:
    """Return the <axis> of a joint along a direction (3,) in its own frame."""
    numbers = np.round(axis, 6) + 0.0
    return f'<axis xyz="{" ".join(f"{value:.6g}" for value in numbers)}"/>'


def _left_by_height(joint: Joint, gap: float) -> Leftover:
    """Return how far (m) above the ground a joint ends; NaN where there is none."""
    if math.isnan(gap):
        return Leftover(joint, "has no other beside it that stands on the ground")
    return Leftover(joint, f"ends {1e3 * gap:.3g} mm above the ground")


def _idle_casters(
    tree: FrozenTree, taken: Collection[str], free: Collection[str], top: float
) -> list[Leftover]:
    """Return the upright joints that are called casters, and carry nothing that turns.

    What is drawn above a height (m), such as a head that swivels, is none.
    """
    return [
        Leftover(joint, "is called a caster, and its wheel does not turn")
        for joint in tree.description.joints
        if tree.is_free(joint)
        and joint.endless
        and tree.is_upright(joint)
        and joint.name not in taken
        and joint.name not in free
        and is_named_caster(joint)
        and not moved_below(tree, joint.child)
        and not top < tree.lowest(joint.child) < math.inf
    ]


def _unrolling(
    tree: FrozenTree, taken: Collection[str], free: Collection[str], ground: float
) -> list[Leftover]:
    """Return the upright joints that turn what is called a wheel, which stands and cannot roll."""
    return [
        Leftover(
            joint,
            "steers a wheel that does not roll",
            edit=f'put a "continuous" joint about its axle between "{joint.name}" '
            f'(line {joint.line}) and "{joint.child}"',
            steered=True,
        )
        for joint in tree.description.joints
        if tree.is_free(joint)
        and joint.kind != "prismatic"
        and tree.is_upright(joint)
        and is_named_wheel(joint)
        and joint.name not in taken
        and joint.name not in free
        and not moved_below(tree, joint.child)
        and abs(tree.lowest(joint.child) - ground) <= ground_tolerance(0.0)
    ]


def _driven(tree: FrozenTree, names: Sequence[str]) -> list[Leftover]:
    """Return the joints of these names that turn; something drives them as wheels."""
    joints = [tree.description.joint[n] for n in names if n in tree.description.joint]
    why = "is driven as a wheel by a plugin or a controller, and does not stand as one"
    return [
        Leftover(joint, why, hold=tuple(c.name for c in _tilting(tree, joint)))
        for joint in joints
        if tree.is_free(joint) and joint.kind != "prismatic"
    ]


def _tilting(tree: FrozenTree, joint: Joint) -> list[Joint]:
    """Return the free joints above one that are no swivels."""
    return [carrier for carrier in tree.free_joints(joint.parent) if not tree.is_upright(carrier)]


def _is_strut(moving: Sequence[Joint]) -> bool:
    return len(moving) == 1 and moving[0].kind == "prismatic"


def explain_leftovers(tree: FrozenTree, kind: str, leftovers: Sequence[Leftover]) -> str:
    """Return the message that a drive leaves out what looks like wheels, and what to say.

    Args:
        leftovers: What it leaves out; at least one.
    """
    first = leftovers[0].joint
    reasons: dict[str, list[str]] = {}
    for each in leftovers:
        reasons.setdefault(each.why, []).append(each.joint.name)
    listed = "; ".join(f"{_quoted(names)} {why}" for why, names in reasons.items())
    lead = f"{tree.description.path}:{first.line}: the {kind} drive leaves out what looks like "
    return f"{lead}a wheel: {listed}; say which it is:\n" + "\n".join(ways_out(tree, leftovers))


def ways_out(tree: FrozenTree, leftovers: Sequence[Leftover]) -> list[str]:
    """Return what would settle what leftovers are, one way a line."""
    hold = dict.fromkeys(name for each in leftovers for name in each.hold)
    names = [each.joint.name for each in leftovers if not each.steered]
    lines = []
    if hold:
        lines.append(f"  {lock_option(tree, list(hold))}  (holds it at 0; NAME=POSITION elsewhere)")
    lines += dict.fromkeys(f"  {each.edit}" for each in leftovers if each.edit)
    if names:
        lines.append(f"  {lock_option(tree, names)}  (part of the body, it does not turn)")
        lines.append(f"  {option(tree, '--free', names)}  (no wheel: a joint of the arm)")
    return lines


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
    start, end = _start(names), _start([name[::-1] for name in names])[::-1]
    start, end = start[: start.rfind("_") + 1], end[end.find("_") :] if "_" in end else ""
    yield from (f"{start}*", f"*{end}", f"{start}*{end}")
    words = names[0].split("_") if len(names) > 2 else []  # of two, names are clearer
    runs = [words[i:j] for i in range(len(words)) for j in range(i + 1, len(words) + 1)]
    for run in sorted(runs, key=len, reverse=True):
        inside = "_".join(run)
        if all(inside in name for name in names):
            yield f"*{inside}*"


def _start(names: Sequence[str]) -> str:
    """Return the letters that all names begin with."""
    first, last = min(names), max(names)
    alike = takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    return "".join(letter for letter, _ in alike)


def _quoted(names: Sequence[str]) -> str:
    more = len(names) - MAX_LISTED
    listed = ", ".join(f'"{name}"' for name in names[:MAX_LISTED])
    return listed + (f" and {more} more" if more > 0 else "")
