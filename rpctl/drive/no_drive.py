"""Why a robot has no detectable drive, which joints are almost wheels, and what to write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive import POWERED_CASTERS, suggest
from rpctl.drive.evidence import Evidence
from rpctl.drive.leftovers import MAX_LISTED, axis_edit, lock_option
from rpctl.drive.wheel_size import round_parts
from rpctl.drive.wheels import (
    CASTER_WORDS,
    WHEEL_WORDS,
    WheelCandidate,
    ground_tolerance,
    is_called,
    leftward,
    moved_below,
    parallel,
)

NEEDS: dict[str, tuple[str, Callable[[Evidence], bool]]] = {  # of wheels, by the drive's type
    "differential": (
        "one pair of wheels on one axle, held by the root link, and none steered",
        lambda found: len(found.pairs) == 1 and not found.steered,
    ),
    "skid-steer": (
        "two or more pairs of wheels, held by the root link, and none steered",
        lambda found: len(found.pairs) > 1 and not found.steered,
    ),
    "mecanum": (
        "two pairs of wheels, held by the root link, and none steered",
        lambda found: len(found.pairs) == 2 and len(found.fixed) == 4 and not found.steered,
    ),
    "omni": (
        "three or more wheels, held by the root link, and none steered",
        lambda found: len(found.fixed) > 2 and not found.steered,
    ),
    "bicycle": (
        "a wheel that the root link holds, and a steered one",
        lambda found: bool(found.fixed) and len(found.steered) == 1,
    ),
    "tricycle": (
        "a pair of wheels that the root link holds, and a steered wheel",
        lambda found: bool(found.pairs) and len(found.steered) == 1,
    ),
    "articulated": (
        "a pair of wheels that the root link holds, and one on a driven hitch behind it",
        lambda found: bool(found.pairs) and [each.off_axis for each in found.steered] == [True],
    ),
    "car-like": (
        "wheels that the root link holds, and two or more steered ones",
        lambda found: bool(found.fixed) and len(found.steered) > 1,
    ),
    "steered": (
        "two or more steered wheels, and none that the root link holds",
        lambda found: not found.fixed and len(found.steered) > 1,
    ),
    POWERED_CASTERS: (
        "wheels that all trail upright joints, and none that the root link holds",
        lambda found: found.trailing,
    ),
}
MIN_APART_M = 1e-3  # joints nearer to each other than this lie on no line
STEERING_WORDS = ("steer", "hinge", "kingpin", "knuckle")
LEFT, UP = np.eye(3)[1:]
UNSTEERED = ("differential", "skid-steer", "mecanum", "omni")


def fits(kind: str, evidence: Evidence) -> bool:
    """Return whether there are the wheels that a drive of a type needs."""
    _, enough = NEEDS[kind]
    return enough(evidence)


def explain_no_drive(evidence: Evidence, kind: str | None) -> str:
    """Return why no drive was found, and what to write to have one.

    Args:
        kind: Type of the drive that was asked for, or None.
    """
    wheels = evidence.grounded.wheels
    needs = "" if kind is None else f"it takes {NEEDS[kind][0]}; "
    found = "no joint can carry a wheel"
    if evidence.pairs or evidence.swivels:
        found = _counts(evidence)
    elif wheels:
        places = (
            f'"{c.joint.name}" (line {c.joint.line}, axle {(np.round(c.axle, 3) + 0.0).tolist()} '
            f"at {(np.round(c.origin, 3) + 0.0).tolist()})"
            for c in wheels[:MAX_LISTED]
        )
        found = f"no two wheels share one axle; joints on a level axis: {', '.join(places)}"
    faults = (f"{needs}{found}", *evidence.grounded.rejected, *_ways_out(evidence, kind))
    return f"{evidence.description.path}: no {kind or 'known'} drive: {'; '.join(faults)}"


def _ways_out(evidence: Evidence, kind: str | None) -> Iterator[str]:
    """Yield what to write to have a drive."""
    wheels, fixes = evidence.grounded.wheels, [*_fixes(evidence)]
    yield from fixes
    if fixes and not wheels:
        yield "or give --drive fixed for an arm"
    elif not wheels:
        yield (
            "it needs continuous joints about level axles that reach the ground, held by the "
            f'root link "{evidence.description.root}"; make the wheels\' joints '
            'type="continuous" with the axle as <axis>, or give --drive fixed for an arm'
        )
    if fixes or not wheels:
        return
    if kind in UNSTEERED and evidence.steered:
        names = [swivel.joint.name for swivel in evidence.steered]
        yield f"{lock_option(evidence.tree, names)} holds what steers"
    if kind is None and evidence.trailing:
        yield (
            "all of them trail, and nothing says that motors drive them: give --drive "
            f"{POWERED_CASTERS} if motors do"
        )
    if kind is None and len(evidence.pairs) > 1 and not evidence.steered:
        yield "a URDF does not distinguish skid-steer from mecanum wheels"
    yield f"choose one{drive_file_draft(evidence, kind)}"


def _counts(evidence: Evidence) -> str:
    """Return the pairs and the swivels, in words."""
    pairs = evidence.pairs
    listed = "; ".join(" + ".join(w.joint.name for w in pair) for pair in pairs[:MAX_LISTED])
    axles = f"{len(pairs)} pair{'s' * (len(pairs) != 1)} of wheels on one axle"
    axles += f" ({listed})" if pairs else ""
    lone = [line[0].joint.name for line in evidence.lines if len(line) == 1]
    axles += f", on their own: {', '.join(lone[:MAX_LISTED])}" if lone else ""
    turning = [f"{s.joint.name} ({s.role})" for s in evidence.swivels[:MAX_LISTED]]
    return axles + (f", wheels on swivels: {', '.join(turning)}" if turning else "")


def _fixes(evidence: Evidence) -> Iterator[str]:
    """Yield changes to the URDF or the options that would let a drive be detected."""
    tree, left = evidence.tree, evidence.leftovers
    if not evidence.pairs:
        yield from _turned_axes(tree, evidence.fixed)
    still = [] if evidence.pairs else wheels_on_fixed_joints(tree)
    if still:
        yield f"wheels are held by fixed joints; make {'; '.join(still)}"
    spinners = [] if evidence.grounded.wheels else upright_spinners(tree)
    if spinners:
        axes = (axis_edit(tree, joint, LEFT) for joint in spinners)
        yield (
            f"joints turn upright side by side; if they carry wheels, give {', '.join(axes)}, or "
            "the axle as it lies"
        )
    yield from (f'"{each.joint.name}" {each.why}; {each.edit}' for each in left if each.edit)
    for swivel in evidence.swivels:
        if len(swivel.wheels) == len(evidence.grounded.wheels):
            option = lock_option(tree, [swivel.joint.name])
            yield f"{swivel.joint.name} carries all wheels and so steers none: {option}"
    holding = dict.fromkeys(name for each in left for name in each.hold)
    if holding:
        hanging = [each.joint.name for each in left if each.hold]
        verb, option = "hang" if len(hanging) > 1 else "hangs", lock_option(tree, list(holding))
        yield f"{', '.join(hanging)} {verb} on joints that can move; hold these: {option}"


def upright_spinners(tree: FrozenTree) -> list[Joint]:
    """Return the endless joints side by side that turn upright and move nothing else, if several.

    An arm has one joint after another; these are wheels whose axles stand, or rotors.
    """
    joints = [
        joint
        for joint in filter(tree.is_free, tree.description.joints)
        if joint.endless
        and joint.mimic is None
        and (tree.is_upright(joint) or tree.is_leaning(joint))
        and not tree.free_joints(joint.parent)
        and not moved_below(tree, joint)
    ]
    return joints if len(joints) > 1 else []


def _turned_axes(tree: FrozenTree, wheels: Sequence[WheelCandidate]) -> Iterator[str]:
    """Yield what to write where the axles of two wheels lie across the line that joins them."""
    for a, b in combinations(wheels, 2):
        line = a.origin - b.origin
        apart = float(np.linalg.norm(line))
        across = max(abs(float(a.axle @ line)), abs(line[2])) < MAX_TILT_SINE * apart
        if apart >= MIN_APART_M and across and parallel(a, b):
            axes = ", ".join(axis_edit(tree, each.joint, leftward(line)) for each in (a, b))
            yield f"their axles lie across the line that joins them: give {axes}"


def explain_unknown_radius(evidence: Evidence, kind: str | None) -> str:
    """Return that no shape tells the radius of a wheel, and what to write.

    Args:
        kind: Type of the drive that was found, or None.
    """
    joint = next(wheel.joint for wheel in evidence.grounded.wheels if wheel.radius is None)
    return (
        f'{evidence.description.path}:{joint.line}: the radius of wheel "{joint.child}" is '
        "not known: no cylinder or sphere among its shapes, no mesh that can be read, and its axle "
        'is not above the root link; give the link a <collision> with <cylinder radius="..." '
        'length="..."/> along the axle, or its radius in a drive '
        f"file{drive_file_draft(evidence, kind)}"
    )


def drive_file_draft(evidence: Evidence, kind: str | None) -> str:
    """Return the end of a message that asks for a drive file: one of what was found."""
    guess = "skid-steer" if len(evidence.pairs) > 1 else "differential"
    if not evidence.pairs:
        guess = POWERED_CASTERS if evidence.trailing else "steered"
    roles = {swivel.joint.name: swivel.role for swivel in evidence.swivels}
    radii = {wheel.joint.name: wheel.radius for wheel in evidence.grounded.wheels}
    return f"; to start from (--drive FILE):\n{suggest(kind or guess, radii, roles)}"


def wheels_on_fixed_joints(tree: FrozenTree, wheels: Sequence[WheelCandidate] = ()) -> list[str]:
    """Return the change that turns each wheel on a fixed joint into a continuous joint.

    Such a wheel is a leaf of the tree that the root link holds, rigidly or by upright joints: a
    level cylinder on the ground, or meshes and spheres that a name calls a wheel. A caster may
    slide. What holds it and is called steering, or a caster, follows.

    Args:
        wheels: The wheels on the ground, which turn; meshes count at the height of theirs alone.
    """
    advice, still = [], []
    floor = min((wheel.bottom for wheel in wheels), default=tree.floor)
    for joint in tree.description.joints:
        place = tree.pose(joint.child)[:3, 3]
        if (
            joint.kind != "fixed"
            or tree.description.child_joints[joint.child]
            or is_called(joint, CASTER_WORDS)
            or any(np.linalg.norm(place - w.centre) < 2.0 * (w.radius or 0.0) for w in wheels)
            or not all(map(tree.is_upright, tree.free_joints(joint.parent)))
        ):
            continue
        kinds = {shape.kind for shape in tree.description.link[joint.child].shapes}
        drawn = is_called(joint, WHEEL_WORDS) and bool(kinds) and kinds <= {"mesh", "sphere"}
        heights = [(abs(place[2] - w.centre[2]), w.radius or 0.0) for w in wheels]
        axle = _level_cylinder(tree, joint, floor)
        if axle is not None:
            advice.append(axis_edit(tree, joint, leftward(axle), 'type="continuous" with '))
        elif drawn and (not wheels or any(off < 0.5 * radius for off, radius in heights)):
            change = 'type="continuous" with its axle as <axis>'
            advice.append(f'"{joint.name}" (line {joint.line}) {change}')
        else:
            continue
        still.append(joint)
    return advice + fixed_swivels(tree, still)


def fixed_swivels(tree: FrozenTree, wheels: Sequence[Joint]) -> list[str]:
    """Return the change that lets what holds each wheel turn, and is fixed though it should.

    It is called steering, or a caster, or has an upright <axis>, of which a fixed joint has no
    need. What also carries other wheels turns none of them.

    Args:
        wheels: Joints of wheels.
    """
    chains = [tree.description.chain(j.parent) for j in wheels if not tree.free_joints(j.parent)]
    carried = Counter(joint.name for chain in chains for joint in chain)
    advice = []
    for joint in (joint for chain in chains for joint in chain):
        steers = is_called(joint, STEERING_WORDS)
        turns = steers or is_called(joint, CASTER_WORDS) or tree.is_upright(joint)
        if joint.kind == "fixed" and carried[joint.name] == 1 and turns:
            kind = "revolute" if steers else "continuous"
            change = axis_edit(tree, joint, UP, f'type="{kind}" with ')
            advice.append(change + (" and its <limit>" if steers else ""))
    return advice


def misaligned_axes(tree: FrozenTree, wheels: Sequence[WheelCandidate]) -> list[str]:
    """Return a corrected <axis> for each wheel whose joint axis lies across its cylinder's axis.

    A URDF without an <axis> has (1 0 0), wherever the wheel points.
    """
    advice = []
    for wheel in wheels:
        link = tree.description.link[wheel.joint.child]
        cylinders = (shape for shape in link.shapes if shape.kind == "cylinder")
        axles = [(tree.pose(link.name) @ shape.origin)[:3, 2] for shape in cylinders]
        across = [a for a in axles if max(abs(a @ wheel.axle), abs(a[2])) <= MAX_TILT_SINE]
        if across and not round_parts(tree, wheel.joint):
            advice.append(axis_edit(tree, wheel.joint, leftward(across[0])))
    return advice


def _level_cylinder(tree: FrozenTree, joint: Joint, floor: float) -> Array | None:
    """Return the axle (3,) of a link's level cylinder that reaches the floor (m), or None."""
    for shape in tree.description.link[joint.child].shapes:
        place, radius = tree.pose(joint.child) @ shape.origin, shape.size[0]
        level = shape.kind == "cylinder" and abs(place[2, 2]) <= MAX_TILT_SINE
        if level and place[2, 3] - radius - floor <= ground_tolerance(radius):
            return np.asarray(place[:3, 2])
    return None
