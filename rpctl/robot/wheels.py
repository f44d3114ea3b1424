"""Wheels one by one: the joints that could carry one, where, and how large it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.description import mesh_files
from rpctl.description.mesh_paths import MeshError, MeshPaths
from rpctl.description.records import Array, Description, Joint, Shape
from rpctl.robot.drive_file import WheelSpec

AXLE_TILT = 0.02  # sine of the largest angle between a wheel axle and the ground (CAD rounding)
AXLE_OFFSET = 0.02  # largest distance between two axles of one pair, of that between the wheels
SHAPE_TILT = 0.02  # sine of the largest angle between a wheel's cylinder and its axle
EVEN = 0.8  # least ratio of a wheel's extents across its axle; a tread's lugs make 0.95 of it


@dataclass(frozen=True)
class Candidate:
    """A joint that could carry a wheel, placed in the root link's frame, joints at 0 or locked.

    Attributes:
        joint: The joint.
        origin: Its origin (3,), m.
        axle: Its unit axis (3,).
        frame: Its rotation (3, 3).
        swivel: The one moving joint between it and the root link, upright; or None.
        radius: m; None while it is not known.
        source: Where the radius came from.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        ball: Whether its shape is a sphere: a ball, unless nothing else is a wheel.
        uneven: The extents of its mesh across the axis, where they are not a wheel's, in words.
    """

    joint: Joint
    origin: Array
    axle: Array
    frame: Array
    swivel: Joint | None
    radius: float | None
    source: str
    offset: float
    ball: bool
    uneven: str

    @property
    def centre(self) -> Array:
        """The wheel's centre (3,) in the root link's frame, m."""
        return self.origin + self.offset * self.axle

    @property
    def bottom(self) -> float:
        """Height of its lowest point in the root link's frame, m; NaN without a radius."""
        return float(self.centre[2]) - (math.nan if self.radius is None else self.radius)


def find_candidates(
    description: Description, locked: Mapping[str, float], told: Mapping[str, WheelSpec]
) -> list[Candidate]:
    """Return the joints that could carry wheels.

    Such a joint turns without limits about a level axis, and is held by the root link, rigidly or
    by one upright joint.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m); they hold as fixed ones do.
        told: What the user says of wheels, by joint.
    """
    found = []
    paths = MeshPaths(description.path, description.package_dirs)
    for joint in description.joints:
        if not turns(joint) or joint.name in locked or joint.mimic is not None:
            continue
        carriers = [j for j in description.chain(joint.parent) if j.moving and j.name not in locked]
        if len(carriers) > 1 or not all(upright(description, locked, j) for j in carriers):
            continue
        if _carries_arm(description, locked, joint):
            continue
        pose = description.pose(joint.parent, dict(locked)) @ joint.origin
        axle = pose[:3, :3] @ joint.axis
        if abs(axle[2]) > AXLE_TILT:
            continue
        size = _size(description, joint, paths)
        given = told.get(joint.name, WheelSpec()).radius
        if given is not None:
            size = size._replace(radius=given, source="drive file", uneven="")
        swivel = carriers[0] if carriers else None
        place = (pose[:3, 3], axle, pose[:3, :3])
        shapes = round_shapes(description, joint)
        ball = bool(shapes) and all(shape.kind == "sphere" for shape, _ in shapes)
        found.append(
            Candidate(
                joint, *place, swivel, size.radius, size.source, size.offset, ball, size.uneven
            )
        )
    return found


def turns(joint: Joint) -> bool:
    """Return whether a joint turns without limits."""
    endless = joint.kind == "revolute" and math.isinf(joint.upper - joint.lower)
    return joint.kind == "continuous" or endless


def root_axis(description: Description, locked: Mapping[str, float], joint: Joint) -> Array:
    """Return a joint's unit axis (3,) in the root link's frame."""
    pose = description.pose(joint.parent, dict(locked)) @ joint.origin
    return np.asarray(pose[:3, :3] @ joint.axis)


def upright(description: Description, locked: Mapping[str, float], joint: Joint) -> bool:
    """Return whether a joint turns about an upright axis."""
    axis = root_axis(description, locked, joint)
    return joint.kind != "prismatic" and math.hypot(axis[0], axis[1]) <= AXLE_TILT


def _carries_arm(description: Description, locked: Mapping[str, float], joint: Joint) -> bool:
    """Return whether a joint moves others than the rollers of a wheel, which turn freely on it."""
    edge = [(below, 0) for below in description.child_joints[joint.child]]
    while edge:
        below, depth = edge.pop()
        if below.moving and below.name not in locked:
            depth += 1
            if depth > 1 or not turns(below):
                return True
        edge.extend((further, depth) for further in description.child_joints[below.child])
    return False


def coaxial(a: Candidate, b: Candidate) -> bool:
    """Return whether two wheels turn about one line seen from above, but for a file's rounding.

    Wheels of two sizes have axles of two heights; only where they stand matters.
    """
    between = (b.centre - a.centre)[:2]
    distance = math.hypot(*between)
    apart = abs(float(a.axle[0] * between[1] - a.axle[1] * between[0]))
    return parallel(a, b) and distance > 0.0 and apart <= AXLE_OFFSET * distance


def parallel(a: Candidate, b: Candidate) -> bool:
    """Return whether two wheels' axles are parallel, apart from a file's rounding."""
    return abs(float(a.axle @ b.axle)) > 1.0 - AXLE_TILT**2


def mostly_left(axle: Array) -> float:
    """Positive when the axle points left of forward; forward is +x, or +y for an axle along x."""
    return float(axle[1]) if abs(axle[1]) > AXLE_TILT else -float(axle[0])


def leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right."""
    return axle * math.copysign(1.0, mostly_left(axle))


def round_shapes(description: Description, joint: Joint) -> list[tuple[Shape, str]]:
    """Return the shapes of a wheel that are round about its axle, collision before visual."""
    link = description.link[joint.child]
    shapes = [(s, "collision") for s in link.collisions] + [(s, "visual") for s in link.visuals]
    return [
        (shape, role)
        for shape, role in shapes
        if shape.kind == "sphere"
        or (
            shape.kind in ("cylinder", "capsule")
            and np.linalg.norm(np.cross(shape.origin[:3, 2], joint.axis)) <= SHAPE_TILT
        )
    ]


class _Size(NamedTuple):
    """What a wheel's shapes tell of it; without a radius the source says why no mesh does."""

    radius: float | None  # m
    source: str
    offset: float  # of its centre along the axle, m
    uneven: str = ""  # see Candidate


def _size(description: Description, joint: Joint, paths: MeshPaths) -> _Size:
    """Return the size of a wheel, from a primitive shape or the bounds of a mesh."""
    shapes = round_shapes(description, joint)
    if shapes:
        offset = float(shapes[0][0].origin[:3, 3] @ joint.axis)
        widest, role = max(shapes, key=lambda item: item[0].size[0])
        return _Size(widest.size[0], f"{role} {widest.kind}, line {widest.line}", offset)
    link = description.link[joint.child]
    reason = ""
    for role, shapes_of in (("collision", link.collisions), ("visual", link.visuals)):
        for shape in shapes_of:
            if shape.kind != "mesh":
                continue
            try:
                across, offset = _bounds(shape, joint.axis, paths)
            except MeshError as error:
                reason = f'mesh "{shape.mesh}" {error}'
                continue
            # Half of the widest extent is the reach, which a tread's lugs do not tilt.
            narrow, wide = sorted(across.tolist())
            uneven = f"{narrow:.3g} m by {wide:.3g} m" if narrow < EVEN * wide else ""
            source = f"bounds of the {role} mesh, line {shape.line}"
            return _Size(0.5 * wide, source, offset, uneven)
    return _Size(None, reason, 0.0)


def _bounds(shape: Shape, axis: Array, paths: MeshPaths) -> tuple[Array, float]:
    """Return a mesh's two extents (2,) across an axis, and its middle along it, m."""
    surfaces = mesh_files.read(paths.resolve(str(shape.mesh)))
    points = np.concatenate([surface.vertices for surface in surfaces]) * shape.size
    points = points @ shape.origin[:3, :3].T + shape.origin[:3, 3]
    along = points @ axis
    first = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    first /= np.linalg.norm(first)
    across = points @ np.column_stack([first, np.cross(axis, first)])
    return np.ptp(across, axis=0), 0.5 * float(along.min() + along.max())
