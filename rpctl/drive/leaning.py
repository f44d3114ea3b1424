"""Drives of robots that lean: two wheels on the ground, and nothing else that stands there.

The wheels are at the ends of whatever joints: of none (a self-balancing base), of a steering axis
(a bicycle), of legs.
"""

from __future__ import annotations

import math

import numpy as np

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import read_shape
from rpctl.description.records import Joint, Link
from rpctl.drive.drive import (
    LEANING_BICYCLE,
    SELF_BALANCING,
    WHEEL_LEGS,
    Drive,
    DriveSpec,
    Swivel,
    Wheel,
)
from rpctl.drive.rows import unit_ahead
from rpctl.drive.wheels import (
    CASTER_WORDS,
    GROUND_TOLERANCE_M,
    TRAIL_ROUNDING_M,
    WheelCandidate,
    as_candidate,
    coaxial,
    ground_tolerance,
    leftward,
    parallel,
    turns_like_wheel,
)
from rpctl.errors import DriveError

LEAVES_OPEN = "the root link may pitch, roll and rise, as far as its two wheels allow"
PAIR = "on one axle, with nothing else on the ground"


def find_leaning(tree: FrozenTree, spec: DriveSpec, asked: bool = False) -> Drive | None:
    """Return the drive of a robot that stands on two wheels alone; None of any other.

    Wheels are the joints that turn without limits about level axles and end lowest, all joints
    at 0. Shapes tell what else stands on the ground. Unless it is asked for, a robot of which only
    wheels have shapes, or whose meshes are missing, is left to those who hold it level: nobody
    knows what else stands there.

    Args:
        tree: The robot, with its locked joints.
        spec: What the user says.
        asked: Whether the user says that it leans.

    Raises:
        DriveError: It balances on one ball, or its two wheels stand one behind the other and no
            joint steers.
    """
    wheels = _grounded(tree, spec)
    if len(wheels) == 1 and wheels[0].ball and not spec.wheels and _alone(tree, wheels):
        raise DriveError(
            f'{tree.description.path}:{wheels[0].joint.line}: "{wheels[0].joint.name}" is one '
            "ball that the robot balances on: rpctl has no model of a contact that rolls in all "
            "directions; give the robot two wheels"
        )
    if len(wheels) != 2 or not parallel(*wheels) or not _alone(tree, wheels):
        return None
    above = [tree.free_joints(wheel.joint.parent) for wheel in wheels]
    if coaxial(*wheels):
        kind = WHEEL_LEGS if any(above) else SELF_BALANCING
        if kind == SELF_BALANCING and not (asked or _all_known(tree, wheels)):
            return None
        return _drive(tree, spec, kind, wheels, (PAIR,))
    steering = [joints for joints in above if joints]
    if len(steering) != 1 or len(steering[0]) != 1:
        return None
    if steering[0][0].kind == "prismatic" or tree.is_level(steering[0][0]):
        return None
    if not (asked or _all_known(tree, wheels) or tree.is_leaning(steering[0][0])):
        return None
    return _drive(
        tree, spec, LEANING_BICYCLE, wheels, (f'one behind the other, "{steering[0][0].name}" '
        "steers",)
    )  # fmt: skip


def _grounded(tree: FrozenTree, spec: DriveSpec) -> list[WheelCandidate]:
    """Return the wheels that end lowest, those of a drive file where it names any."""
    found = [
        as_candidate(tree, joint, spec.wheels.get(joint.name))
        for joint in tree.description.joints
        if turns_like_wheel(tree, joint)
        and tree.is_level(joint)
        and (joint.name in spec.wheels or not spec.wheels)
    ]
    known = [each for each in found if each.radius is not None]
    ground = min((each.bottom for each in known), default=0.0)
    return [each for each in known if each.stands(ground)]


def _others(tree: FrozenTree, wheels: list[WheelCandidate]) -> list[Link]:
    """Return the links that these wheels do not carry."""
    rolling = {wheel.joint.name for wheel in wheels}
    return [
        link
        for link in tree.description.links
        if not any(joint.name in rolling for joint in tree.description.chain(link.name))
    ]


def _alone(tree: FrozenTree, wheels: list[WheelCandidate]) -> bool:
    """Return whether nothing but these wheels reaches down to the ground, a caster neither."""
    ground = min(wheel.bottom for wheel in wheels)
    radius = max(wheel.radius or 0.0 for wheel in wheels)
    reach = ground + ground_tolerance(radius)
    low = [
        joint
        for joint in tree.description.joints
        if turns_like_wheel(tree, joint)
        and tree.is_level(joint)
        and joint not in [wheel.joint for wheel in wheels]
        and float(tree.frame(joint)[2, 3]) <= reach + radius
    ]
    return not low and all(
        tree.lowest(link.name) > reach and not mesh_reaches(tree, link, ground)
        for link in _others(tree, wheels)
    )


def _all_known(tree: FrozenTree, wheels: list[WheelCandidate]) -> bool:
    """Return whether links but the wheels have shapes, and all of them can be read."""
    shapes = [shape for link in _others(tree, wheels) for shape in link.shapes]
    try:
        for shape in shapes:
            if shape.kind == "mesh":
                read_shape(str(shape.mesh), shape.size, tree.description.mesh_paths)
    except MeshError:
        return False
    return any(shape.kind == "mesh" or max(shape.size) > 0.0 for shape in shapes)


def mesh_reaches(tree: FrozenTree, link: Link, ground: float) -> bool:
    """Tell whether a mesh of a link that keeps its height reaches the ground, at a height in m.

    One that cannot be read reaches it if it is a caster's by its name.
    """
    if not all(map(tree.is_upright, tree.free_joints(link.name))):
        return False
    for shape in link.shapes:
        if shape.kind != "mesh":
            continue
        try:
            surfaces = read_shape(str(shape.mesh), shape.size, tree.description.mesh_paths).surfaces
        except MeshError:
            if any(word in link.name.lower() for word in CASTER_WORDS):
                return True
            continue
        down = (tree.pose(link.name) @ shape.origin)[2]
        lowest = min(float((s.vertices * shape.size @ down[:3]).min()) for s in surfaces) + down[3]
        if lowest < ground + GROUND_TOLERANCE_M:
            return True
    return False


def _drive(
    tree: FrozenTree,
    spec: DriveSpec,
    kind: str,
    wheels: list[WheelCandidate],
    evidence: tuple[str, ...],
) -> Drive:
    """Return a drive of two wheels."""
    left = leftward(wheels[0].axle)
    heading = math.atan2(-round(left[0], 12), left[1]) + 0.0
    ahead = np.append(unit_ahead(heading), 0.0)
    wheels = sorted(wheels, key=lambda each: (-round(float(each.centre @ ahead), 6),
                                              -float(each.centre @ left)))  # fmt: skip
    held = [each for each in wheels if kind != LEANING_BICYCLE or each.swivel is None]
    point = np.mean([each.centre[:2] for each in held], axis=0)
    driven = _driven(tree, spec, kind, wheels)
    return Drive(
        type=kind,
        wheels=tuple(_wheel(spec, kind, each, heading, driven) for each in wheels),
        point=(float(point[0]), float(point[1])),
        heading=heading,
        track=abs(float((wheels[0].centre - wheels[1].centre) @ left)),
        ground=min(each.bottom for each in wheels),
        swivels=_steering(tree, spec, wheels, heading) if kind == LEANING_BICYCLE else (),
        evidence=(f"{wheels[0].joint.name} and {wheels[1].joint.name} {evidence[0]}",),
        doubts=() if spec.type else (f"{kind}: {LEAVES_OPEN}; give --root planar if something "
                                     "holds it upright",),
        declared=tuple(f"radius of {w.joint}" for w in spec.wheel if w.radius is not None),
    )  # fmt: skip


def _steering(
    tree: FrozenTree, spec: DriveSpec, wheels: list[WheelCandidate], heading: float
) -> tuple[Swivel, ...]:
    """Return the joint that steers a bicycle; where its axis meets the ground is its pivot."""
    (wheel,) = (each for each in wheels if each.swivel is not None)
    (joint,) = tree.free_joints(wheel.joint.parent)
    origin, axis = tree.frame(joint)[:3, 3], tree.axis(joint)
    pivot = origin + (wheel.bottom - origin[2]) / axis[2] * axis
    given = spec.swivels.get(joint.name)
    driven = given.driven if given is not None and given.driven is not None else bool(joint.effort)
    trail = float(unit_ahead(heading) @ (wheel.centre - pivot)[:2])
    return (
        Swivel(
            joint=joint.name,
            role="steered",
            pivot=(float(pivot[0]), float(pivot[1])),
            heading=heading,
            sign=math.copysign(1.0, axis[2]),
            trail=0.0 if abs(trail) < TRAIL_ROUNDING_M else trail,
            driven=driven,
            why="it carries the one wheel that turns aside",
        ),
    )


def _wheel(
    spec: DriveSpec, kind: str, wheel: WheelCandidate, heading: float, driven: frozenset[str]
) -> Wheel:
    given, radius = spec.wheels.get(wheel.joint.name), wheel.radius or 0.0
    tyre = radius if wheel.ball else 0.0
    if given is not None and given.tyre is not None:
        tyre = min(given.tyre, radius)
    x, y, z = wheel.joint.axis.tolist()
    return Wheel(
        joint=wheel.joint.name,
        radius=radius,
        source=wheel.source,
        axis=(x, y, z),
        offset=wheel.offset,
        direction=(math.cos(heading), math.sin(heading)),
        driven=wheel.joint.name in driven,
        swivel=wheel.swivel.name if kind == LEANING_BICYCLE and wheel.swivel else None,
        tyre=tyre,
        why="turns without limits about a level axle and ends lowest",
    )


def _driven(
    tree: FrozenTree, spec: DriveSpec, kind: str, wheels: list[WheelCandidate]
) -> frozenset[str]:
    """Return the driven wheels: those of the drive file or with transmissions, or with limits.

    Without any of these a bicycle's is the one that does not steer.
    """
    said = {name: each.driven for name, each in spec.wheels.items() if each.driven is not None}
    joints = [wheel.joint for wheel in wheels]
    told = {joint.name for joint in joints} & tree.description.actuated
    limited = {joint.name for joint in joints if math.isfinite(joint.effort) and joint.effort}
    fallback = {w.joint.name for w in wheels if kind != LEANING_BICYCLE or w.swivel is None}
    found = told or limited or {name for name in fallback if _may_drive(joints, name)}
    found |= {name for name, yes in said.items() if yes}
    return frozenset(found - {name for name, yes in said.items() if not yes})


def _may_drive(joints: list[Joint], name: str) -> bool:
    return any(joint.name == name and joint.effort for joint in joints)
