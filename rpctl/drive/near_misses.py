"""Joints that are almost wheels: fixed joints, wheels on moving joints, axes across the axle."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint, Shape
from rpctl.drive.grounded import ground_tolerance
from rpctl.drive.wheel_size import round_parts
from rpctl.drive.wheels import WheelCandidate, is_endless, mostly_left, turns_like_wheel

WHEEL_WORDS = ("wheel", "tyre", "tire")


def wheels_on_fixed_joints(tree: FrozenTree) -> list[str]:
    """Return the change that turns each wheel on a fixed joint into a continuous joint.

    Such a wheel is a leaf of the tree that the root link holds, rigidly or by upright joints: a
    level cylinder on the ground, or meshes that a name calls a wheel.
    """
    advice = []
    floor = _floor(tree)
    for joint in tree.description.joints:
        if joint.kind != "fixed" or tree.description.child_joints[joint.child]:
            continue
        if not all(map(tree.is_upright, tree.free_joints(joint.parent))):
            continue
        pose = tree.pose(joint.child)
        axle = _level_cylinder(_shapes(tree, joint), pose, floor)
        if axle is not None:
            left = axle if mostly_left(axle) > 0 else -axle
            axis = f'<axis xyz="{format_vector(pose[:3, :3].T @ left)}"/>'
        elif _is_named_wheel(joint) and _only_meshes(_shapes(tree, joint)):
            axis = "its axle as <axis>"
        else:
            continue
        advice.append(f'"{joint.name}" (line {joint.line}) type="continuous" with {axis}')
    return advice


def advise_lock(tree: FrozenTree) -> list[str]:
    """Return what to do about wheels that hang on joints that move, in a sentence, if any."""
    suspended = _suspended_wheels(tree)
    if not suspended:
        return []
    wheels = dict.fromkeys(name for names in suspended.values() for name in names)
    options = " ".join(f"--lock {name}" for name in suspended)
    return [
        f"{', '.join(wheels)} hang on joints that move, a suspension, which is outside the planar "
        f"model; hold it: {options}"
    ]


def advise_mimics(tree: FrozenTree) -> list[str]:
    """Return what to do about wheels whose joints mimic others, in sentences.

    What rolls on the ground turns as the ground has it, not as another joint does.
    """
    advice = []
    for joint in tree.description.joints:
        if joint.mimic is None or not is_endless(joint) or not tree.is_free(joint):
            continue
        upheld = all(map(tree.is_upright, tree.free_joints(joint.parent)))
        if upheld and tree.is_level(joint) and round_parts(tree, joint):
            advice.append(
                f'"{joint.name}" mimics "{joint.mimic.joint}", so it is taken for no wheel; if it '
                f"stands on the ground, take its <mimic> out (line {joint.line})"
            )
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
                left = axle if mostly_left(axle) > 0 else -axle
                axis = format_vector(candidate.frame.T @ left)
                advice.append(f'"{joint.name}" (line {joint.line}) <axis xyz="{axis}"/>')
                break
    return advice


def format_vector(vector: Array) -> str:
    """Return a vector (3,) as a URDF has it."""
    return " ".join(f"{value:.6g}" for value in np.round(vector, 6) + 0.0)


def _suspended_wheels(tree: FrozenTree) -> dict[str, list[str]]:
    """Return the wheel joints below each moving joint (a suspension), by the joint to lock.

    A suspension slides, and what it carries is round and near the floor. Below a joint that turns
    about a level axis, as joints of arms do, only what is named a wheel counts.
    """
    found: dict[str, list[str]] = {}
    floor = _floor(tree)
    for joint in tree.description.joints:
        if not turns_like_wheel(tree, joint):
            continue
        moving = [c for c in tree.free_joints(joint.parent) if not tree.is_upright(c)]
        if not moving or not tree.is_level(joint) or _carries(tree, joint):
            continue
        sliding = len(moving) == 1 and moving[0].kind == "prismatic"
        parts = round_parts(tree, joint)
        if parts:
            bottom = tree.lowest(joint.child)
            sliding = sliding and bottom - floor <= 2.0 * parts[0].shape.size[0]
        if _is_named_wheel(joint) or (sliding and parts):
            for carrier in moving:
                found.setdefault(carrier.name, []).append(joint.name)
    return found


def _carries(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint moves others, locked or not."""
    stack = list(tree.description.child_joints[joint.child])
    while stack:
        below = stack.pop()
        if below.moving:
            return True
        stack.extend(tree.description.child_joints[below.child])
    return False


def _shapes(tree: FrozenTree, joint: Joint) -> tuple[Shape, ...]:
    link = tree.description.link[joint.child]
    return link.collisions + link.visuals


def _is_named_wheel(joint: Joint) -> bool:
    return any(word in f"{joint.name} {joint.child}".lower() for word in WHEEL_WORDS)


def _only_meshes(shapes: tuple[Shape, ...]) -> bool:
    return bool(shapes) and all(shape.kind == "mesh" for shape in shapes)


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


def _floor(tree: FrozenTree) -> float:
    """Return the height of the lowest shape of any link, meshes left out, m."""
    return min((tree.lowest(link.name) for link in tree.description.links), default=math.inf)
