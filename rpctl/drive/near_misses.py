"""What is nearly a wheel: on a fixed joint, on a joint that moves, or turned about a wrong axis."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Description, Joint, Shape
from rpctl.drive.grounded import GROUND_TOLERANCE_M, GROUND_TOLERANCE_RADII, lowest
from rpctl.drive.wheel_size import round_parts
from rpctl.drive.wheels import (
    AXLE_TILT,
    WheelCandidate,
    is_endless,
    is_upright,
    mostly_left,
    root_axis,
)

WHEEL_WORDS = ("wheel", "tyre", "tire")


def wheels_on_fixed_joints(description: Description, locked: Mapping[str, float]) -> list[str]:
    """Return what to write for wheels on fixed joints.

    They are links that nothing else hangs on, that the root link holds, rigidly or by an upright
    joint: level cylinders that no shape lies lower than, or meshes that a name calls a wheel.
    """
    advice = []
    floor = _floor(description, locked)
    for joint in description.joints:
        if joint.kind != "fixed" or description.child_joints[joint.child]:
            continue
        carriers = _carriers(description, locked, joint)
        if not all(is_upright(description, locked, carrier) for carrier in carriers):
            continue
        pose = description.pose(joint.child, dict(locked))
        axle = _level_cylinder(description, joint, pose, floor)
        if axle is not None:
            left = axle if mostly_left(axle) > 0 else -axle
            axis = f'<axis xyz="{format_vector(pose[:3, :3].T @ left)}"/>'
        elif _is_named_wheel(joint) and _only_meshes(description, joint):
            axis = "its axle as <axis>"
        else:
            continue
        advice.append(f'"{joint.name}" (line {joint.line}) type="continuous" with {axis}')
    return advice


def advise_lock(description: Description, locked: Mapping[str, float]) -> list[str]:
    """Return what to do about wheels that hang on joints that move, in a sentence, if any."""
    suspended = _suspended_wheels(description, locked)
    if not suspended:
        return []
    wheels = dict.fromkeys(name for names in suspended.values() for name in names)
    options = " ".join(f"--lock {name}" for name in suspended)
    return [
        f"{', '.join(wheels)} hang on joints that move, a suspension, which is outside the planar "
        f"model; hold it: {options}"
    ]


def advise_mimics(description: Description, locked: Mapping[str, float]) -> list[str]:
    """Return what to do about wheels whose joints mimic others, in sentences.

    What rolls on the ground turns as the ground has it, not as another joint does.
    """
    advice = []
    for joint in description.joints:
        if joint.mimic is None or not is_endless(joint) or joint.name in locked:
            continue
        upheld = all(
            is_upright(description, locked, c) for c in _carriers(description, locked, joint)
        )
        if (
            upheld
            and _level(description, locked, joint)
            and round_parts(description, locked, joint)
        ):
            advice.append(
                f'"{joint.name}" mimics "{joint.mimic.joint}", so it is taken for no wheel; if it '
                f"stands on the ground, take its <mimic> out (line {joint.line})"
            )
    return advice


def misaligned_axes(
    description: Description, locked: Mapping[str, float], candidates: tuple[WheelCandidate, ...]
) -> list[str]:
    """Return what to write where a wheel's joint turns across its cylinder's axle.

    A URDF without an <axis> has (1 0 0), wherever the wheel points.
    """
    advice = []
    for candidate in candidates:
        joint = candidate.joint
        if round_parts(description, locked, joint):
            continue
        for shape in _shapes(description, joint):
            axle = candidate.frame @ shape.origin[:3, 2]
            across = abs(float(axle @ candidate.axle)) <= AXLE_TILT and abs(axle[2]) <= AXLE_TILT
            if shape.kind == "cylinder" and across:
                left = axle if mostly_left(axle) > 0 else -axle
                axis = format_vector(candidate.frame.T @ left)
                advice.append(f'"{joint.name}" (line {joint.line}) <axis xyz="{axis}"/>')
                break
    return advice


def format_vector(vector: Array) -> str:
    """Return a vector (3,) as a URDF has it."""
    return " ".join(f"{value:.6g}" for value in np.round(vector, 6) + 0.0)


def _suspended_wheels(
    description: Description, locked: Mapping[str, float]
) -> dict[str, list[str]]:
    """Return wheels (joints) that hang on joints that move, by the joint to lock.

    Such a joint is a suspension's: it slides, and what hangs on it is round and near the floor;
    where it turns about a level axis, as joints of arms do, only what is named a wheel counts.
    """
    found: dict[str, list[str]] = {}
    floor = _floor(description, locked)
    for joint in description.joints:
        if not is_endless(joint) or joint.name in locked or joint.mimic is not None:
            continue
        carriers = _carriers(description, locked, joint)
        moving = [c for c in carriers if not is_upright(description, locked, c)]
        level = _level(description, locked, joint)
        if not moving or not level or _carries(description, joint):
            continue
        sliding = len(moving) == 1 and moving[0].kind == "prismatic"
        parts = round_parts(description, locked, joint)
        if parts:
            bottom = lowest(description, locked, joint.child)
            sliding = sliding and bottom - floor <= 2.0 * parts[0].shape.size[0]
        if _is_named_wheel(joint) or (sliding and parts):
            for carrier in moving:
                found.setdefault(carrier.name, []).append(joint.name)
    return found


def _level(description: Description, locked: Mapping[str, float], joint: Joint) -> bool:
    """Return whether a joint's axis is level."""
    return abs(float(root_axis(description, locked, joint)[2])) <= AXLE_TILT


def _carriers(description: Description, locked: Mapping[str, float], joint: Joint) -> list[Joint]:
    return [j for j in description.chain(joint.parent) if j.moving and j.name not in locked]


def _carries(description: Description, joint: Joint) -> bool:
    """Return whether a joint moves others."""
    stack = list(description.child_joints[joint.child])
    while stack:
        below = stack.pop()
        if below.moving:
            return True
        stack.extend(description.child_joints[below.child])
    return False


def _shapes(description: Description, joint: Joint) -> tuple[Shape, ...]:
    link = description.link[joint.child]
    return link.collisions + link.visuals


def _is_named_wheel(joint: Joint) -> bool:
    return any(word in f"{joint.name} {joint.child}".lower() for word in WHEEL_WORDS)


def _only_meshes(description: Description, joint: Joint) -> bool:
    shapes = _shapes(description, joint)
    return bool(shapes) and all(shape.kind == "mesh" for shape in shapes)


def _level_cylinder(
    description: Description, joint: Joint, pose: Array, floor: float
) -> Array | None:
    """Return the axle (3,) of a link's level cylinder that reaches the floor, or None."""
    for shape in _shapes(description, joint):
        place = pose @ shape.origin
        axle = np.asarray(place[:3, 2])
        if shape.kind != "cylinder" or abs(axle[2]) > AXLE_TILT:
            continue
        radius = shape.size[0]
        if float(place[2, 3]) - radius - floor <= max(
            GROUND_TOLERANCE_M, GROUND_TOLERANCE_RADII * radius
        ):
            return axle
    return None


def _floor(description: Description, locked: Mapping[str, float]) -> float:
    """Return the height of the lowest shape of any link, meshes left out, m."""
    lows = [lowest(description, locked, link.name) for link in description.links]
    return min(lows, default=math.inf)
