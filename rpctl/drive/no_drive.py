"""Why a robot has no detectable drive, which joints are almost wheels, and what to write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint, Shape
from rpctl.drive.drive import POWERED_CASTERS, suggest
from rpctl.drive.evidence import Evidence
from rpctl.drive.leftovers import MAX_LISTED, axis_element, lock_option
from rpctl.drive.wheel_size import round_parts
from rpctl.drive.wheels import (
    WheelCandidate,
    ground_tolerance,
    is_named_caster,
    is_named_wheel,
    leftward,
    moved_below,
    parallel,
)

NEEDS = {
    "differential": "one pair of wheels on one axle, held by the root link, and none steered",
    "skid-steer": "two or more pairs of wheels, held by the root link, and none steered",
    "mecanum": "two pairs of wheels, held by the root link, and none steered",
    "omni": "three or more wheels, held by the root link, and none steered",
    "bicycle": "a wheel that the root link holds, and a steered one",
    "tricycle": "a pair of wheels that the root link holds, and a steered wheel",
    "articulated": "a pair of wheels that the root link holds, and one on a driven hitch behind it",
    "car-like": "wheels that the root link holds, and two or more steered ones",
    "steered": "two or more steered wheels, and none that the root link holds",
    POWERED_CASTERS: "wheels that all trail upright joints, and none that the root link holds",
}
MIN_APART_M = 1e-3  # joints nearer to each other than this lie on no line
STEERING_WORDS = ("steer", "hinge", "kingpin", "knuckle")
UNSTEERED = ("differential", "skid-steer", "mecanum", "omni")


def explain_no_drive(evidence: Evidence, kind: str | None) -> str:
    """Return why no drive was found, and what to write to have one.

    Args:
        kind: Type of the drive that was asked for, or None.
    """
    grounded = evidence.grounded
    message = f"{evidence.description.path}: no {kind or 'known'} drive: "
    if kind is not None:
        message += f"it takes {NEEDS[kind]}; "
    if evidence.pairs or evidence.swivels:
        message += _counts(evidence)
    elif grounded.wheels:
        message += (
            f"no two wheels share one axle; joints on a level axis: {_wheel_places(evidence)}"
        )
    else:
        message += "no joint could carry a wheel"
    message += "".join(f"; {reason}" for reason in grounded.rejected) + _ways_out(evidence, kind)
    return message


def _ways_out(evidence: Evidence, kind: str | None) -> str:
    """Return what to write to have a drive, as the end of the message."""
    message, grounded = "", evidence.grounded
    fix = _fixes(evidence)
    if fix:
        arm = "" if grounded.wheels else "; or say --drive fixed for an arm"
        return f"{message}; {fix}{arm}"
    if not grounded.wheels:
        return (
            f"{message}; it needs continuous joints about level axles that reach the ground, held "
            f'by the root link "{evidence.description.root}"; make the wheels\' joints '
            'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
        )
    if kind in UNSTEERED and evidence.steered:
        names = [swivel.joint.name for swivel in evidence.steered]
        message += f"; {lock_option(evidence.tree, names)} holds what steers"
    if kind is None and evidence.trailing:
        message += (
            "; all of them trail, and nothing tells that motors drive them: say --drive "
            f"{POWERED_CASTERS} if motors do"
        )
    if kind is None and len(evidence.pairs) > 1 and not evidence.steered:
        message += "; nothing in a URDF tells skid-steer from mecanum wheels"
    return f"{message}; say which it is{drive_file_draft(evidence, kind)}"


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


def _wheel_places(evidence: Evidence) -> str:
    return ", ".join(
        f'"{c.joint.name}" (line {c.joint.line}, axle {(np.round(c.axle, 3) + 0.0).tolist()} '
        f"at {(np.round(c.origin, 3) + 0.0).tolist()})"
        for c in evidence.grounded.wheels[:MAX_LISTED]
    )


def _fixes(evidence: Evidence) -> str:
    """Return changes to the URDF or the options that would let a drive be detected, or nothing."""
    ways = _turned_axes(evidence.fixed) if not evidence.pairs else []
    still = [] if evidence.pairs else wheels_on_fixed_joints(evidence.tree)
    if still:
        ways.append(f"wheels are held by fixed joints; make {'; '.join(still)}")
    spinners = [] if evidence.grounded.wheels else upright_spinners(evidence.tree)
    if spinners:
        axes = (
            f'"{j.name}" (line {j.line}) {axis_element(evidence.tree.frame(j)[:3, :3].T[:, 1])}'
            for j in spinners
        )
        ways.append(
            f"joints turn upright side by side; if they carry wheels, give {', '.join(axes)}, or "
            "the axle as it lies"
        )
    left = evidence.leftovers
    ways += [f'"{each.joint.name}" {each.why}; {each.edit}' for each in left if each.edit]
    for swivel in evidence.swivels:
        if len(swivel.wheels) == len(evidence.grounded.wheels):
            option = lock_option(evidence.tree, [swivel.joint.name])
            ways.append(f"{swivel.joint.name} carries all wheels and so steers none: {option}")
    holding = dict.fromkeys(name for each in left for name in each.hold)
    if holding:
        hanging = ", ".join(each.joint.name for each in left if each.hold)
        ways.append(
            f"{hanging} hang on joints that can move; hold these: "
            f"{lock_option(evidence.tree, list(holding))}"
        )
    return "; ".join(ways)


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
        and not moved_below(tree, joint.child)
    ]
    return joints if len(joints) > 1 else []


def _turned_axes(candidates: tuple[WheelCandidate, ...]) -> list[str]:
    """Return what to write where the axles of two wheels lie across the line that joins them."""
    advice = []
    for a, b in combinations(candidates, 2):
        line = a.origin - b.origin
        apart = float(np.linalg.norm(line))
        if apart < MIN_APART_M:
            continue
        line = line / apart
        if parallel(a, b) and max(abs(float(a.axle @ line)), abs(line[2])) < MAX_TILT_SINE:
            axes = (f'"{c.joint.name}" {_axis(line, c.frame)}' for c in (a, b))
            advice.append(
                f"their axles lie across the line that joins them: give {', '.join(axes)}"
            )
    return advice


def explain_unknown_radius(evidence: Evidence, kind: str | None) -> str:
    """Return that no shape tells the radius of a wheel, and what to write.

    Args:
        kind: Type of the drive that was found, or None.
    """
    joint = evidence.grounded.sizeless[0]
    return (
        f'{evidence.description.path}:{joint.line}: the radius of wheel "{joint.child}" is not '
        "known: no cylinder or sphere among its shapes, no mesh that can be read, and its axle is "
        'not above the root link; give the link a <collision> with <cylinder radius="..." '
        'length="..."/> along the axle, or its radius in a drive file'
        f"{drive_file_draft(evidence, kind)}"
    )


def drive_file_draft(evidence: Evidence, kind: str | None) -> str:
    """Return the end of a message that asks for a drive file: one of what was found."""
    roles = {swivel.joint.name: swivel.role for swivel in evidence.swivels}
    guess = "skid-steer" if len(evidence.pairs) > 1 else "differential"
    swivelling = POWERED_CASTERS if evidence.trailing else "steered"
    guess = guess if evidence.pairs else swivelling
    wheels = {wheel.joint.name: wheel.radius for wheel in evidence.grounded.wheels}
    unknown = {joint.name for joint in evidence.grounded.sizeless}
    wheels = {name: None if name in unknown else radius for name, radius in wheels.items()}
    return f"; to start from (--drive FILE):\n{suggest(kind or guess, wheels, roles)}"


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
        if joint.kind != "fixed" or tree.description.child_joints[joint.child]:
            continue
        if is_named_caster(joint) or _beside_a_wheel(tree, joint, wheels):
            continue
        if not all(map(tree.is_upright, tree.free_joints(joint.parent))):
            continue
        pose = tree.pose(joint.child)
        axle = _level_cylinder(_shapes(tree, joint), pose, floor)
        if axle is not None:
            axis = _axis(axle, pose[:3, :3])
        elif _is_drawn_wheel(tree, joint) and (not wheels or _as_high(pose[2, 3], wheels)):
            axis = "its axle as <axis>"
        else:
            continue
        still.append(joint)
        advice.append(f'"{joint.name}" (line {joint.line}) type="continuous" with {axis}')
    return advice + fixed_swivels(tree, still)


def _beside_a_wheel(tree: FrozenTree, joint: Joint, wheels: Sequence[WheelCandidate]) -> bool:
    """Return whether a joint is nearer to a wheel than another wheel could be."""
    place = tree.frame(joint)[:3, 3]
    return any(
        float(np.linalg.norm(place - each.centre)) < 2.0 * (each.radius or 0.0) for each in wheels
    )


def _is_drawn_wheel(tree: FrozenTree, joint: Joint) -> bool:
    kinds = {shape.kind for shape in _shapes(tree, joint)}
    return is_named_wheel(joint) and bool(kinds) and kinds <= {"mesh", "sphere"}


def _as_high(height: float, wheels: Sequence[WheelCandidate]) -> bool:
    """Return whether some wheel's axle is about so high (m)."""
    return any(abs(height - each.centre[2]) < 0.5 * (each.radius or 0.0) for each in wheels)


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
        steers = any(word in f"{joint.name} {joint.child}".lower() for word in STEERING_WORDS)
        if (
            joint.kind == "fixed"
            and carried[joint.name] == 1
            and (steers or is_named_caster(joint) or tree.is_upright(joint))
        ):
            axis = axis_element(tree.frame(joint)[:3, :3].T[:, 2])
            kind = f'type="revolute" with {axis} and its <limit>'
            kind = kind if steers else f'type="continuous" with {axis}'
            advice.append(f'"{joint.name}" (line {joint.line}) {kind}')
    return advice


def misaligned_axes(tree: FrozenTree, candidates: tuple[WheelCandidate, ...]) -> list[str]:
    """Return a corrected <axis> for each wheel whose joint axis lies across its cylinder's axis.

    A URDF without an <axis> has (1 0 0), wherever the wheel points.
    """
    advice = []
    for candidate in candidates:
        joint = candidate.joint
        if round_parts(tree, joint):
            continue
        for shape in _shapes(tree, joint):
            axle = candidate.frame @ shape.origin[:3, 2]
            tilt = max(abs(float(axle @ candidate.axle)), abs(axle[2]))
            if shape.kind == "cylinder" and tilt <= MAX_TILT_SINE:
                axis = _axis(axle, candidate.frame)
                advice.append(f'"{joint.name}" (line {joint.line}) {axis}')
                break
    return advice


def _axis(axle: Array, frame: Array) -> str:
    """Return the element of a joint in a frame (3, 3) whose axle (3,), turned left, is this."""
    return axis_element(frame.T @ leftward(axle))


def _shapes(tree: FrozenTree, joint: Joint) -> tuple[Shape, ...]:
    link = tree.description.link[joint.child]
    return link.collisions + link.visuals


def _level_cylinder(shapes: tuple[Shape, ...], pose: Array, floor: float) -> Array | None:
    """Return the axle (3,) of the level cylinder that reaches the floor (m), or None.

    ``pose`` (4, 4) is the link's whose shapes they are.
    """
    for shape in shapes:
        place = pose @ shape.origin
        axle = np.asarray(place[:3, 2])
        if shape.kind != "cylinder" or abs(axle[2]) > MAX_TILT_SINE:
            continue
        radius = shape.size[0]
        if float(place[2, 3]) - radius - floor <= ground_tolerance(radius):
            return axle
    return None
