"""Joints that are almost wheels: on fixed joints, or turning across their axles."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint, Shape
from rpctl.drive.grounded import ground_tolerance
from rpctl.drive.wheel_like import is_named_wheel
from rpctl.drive.wheel_size import round_parts
from rpctl.drive.wheels import WheelCandidate, mostly_left


def wheels_on_fixed_joints(tree: FrozenTree) -> list[str]:
    """Return the change that turns each wheel on a fixed joint into a continuous joint.

    Such a wheel is a leaf of the tree that the root link holds, rigidly or by upright joints: a
    level cylinder on the ground, or meshes that a name calls a wheel.
    """
    advice = []
    floor = tree.floor
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
        elif is_named_wheel(joint) and _only_meshes(_shapes(tree, joint)):
            axis = "its axle as <axis>"
        else:
            continue
        advice.append(f'"{joint.name}" (line {joint.line}) type="continuous" with {axis}')
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


def _shapes(tree: FrozenTree, joint: Joint) -> tuple[Shape, ...]:
    link = tree.description.link[joint.child]
    return link.collisions + link.visuals


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
