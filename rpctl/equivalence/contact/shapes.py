"""What of a robot meets the ground, from its file's shapes: tyres, and supports that slide."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.records import Joint, Shape
from rpctl.drive.drive import Wheel
from rpctl.dynamics.stance import Supports
from rpctl.robot.model import Robot

MAX_AXIS_SINE = (
    0.02  # sine of the largest angle between a wheel's cylinder and its axle (CAD rounding)
)
MIN_HALF_WIDTH_M = 1e-3  # m: least half width of a tyre; a thinner one is a knife
DECLARED = "drive file"  # source of a radius that the user gives


@dataclass(frozen=True)
class Tyre:
    """A wheel's tread, crowned: an ellipsoid about the axle, which meets the ground at one point.

    A cylinder on a plane touches along a line, and whatever turns on a line scrubs. The crown
    keeps the radius, the width and the middle that the file draws, and leaves scrubbing out.

    Attributes:
        link: The link that draws it.
        pose: Its pose (4, 4) in that link's frame, z along the axle.
        radius: m.
        half_width: m.
        note: What the file does not say of it, or nothing.
    """

    link: str
    pose: Array
    radius: float
    half_width: float
    note: str = ""


def tyre(robot: Robot, wheel: Wheel) -> Tyre:
    """Return the tread of a wheel as its file draws it: collision before visual, the widest.

    Where the user declares the radius, or the file draws nothing round, the radius is the
    drive's, and the note says so.
    """
    joint = robot.description.joint[wheel.joint]
    drawn = max(_treads(robot, joint), key=lambda found: found.radius, default=None)
    if drawn is None:
        pose = about(joint.axis)
        pose[:3, 3] = wheel.offset * np.array(wheel.axis)
        note = f"{wheel.joint} draws no wheel: its radius and centre are the drive's"
        return Tyre(joint.child, pose, wheel.radius, MIN_HALF_WIDTH_M, note)
    if wheel.source == DECLARED:
        note = f"the radius of {wheel.joint} is the drive file's"
        return Tyre(drawn.link, drawn.pose, wheel.radius, drawn.half_width, note)
    return drawn


def support_shapes(robot: Robot, supports: Supports) -> Iterator[tuple[str, str, Shape]]:
    """Yield the name, the link and the shape of every support."""
    for part in supports.parts:
        link = robot.description.link[part.link]
        yield (
            part.name,
            part.link,
            next(shape for shape in link.collisions + link.visuals if shape.line == part.line),
        )


def _treads(robot: Robot, joint: Joint) -> list[Tyre]:
    """Return the round shapes of a wheel, of the first of its links that draws any."""
    paths = MeshPaths(robot.description.path, robot.description.read_with.package_dirs)
    stack = [(joint.child, joint.axis)]
    while stack:
        name, axis = stack.pop(0)
        link = robot.description.link[name]
        for shapes in (link.collisions, link.visuals):
            found = [_tread(name, shape, axis, paths) for shape in shapes]
            if any(found):
                return [one for one in found if one is not None]
        fixed = (below for below in robot.description.child_joints[name] if not below.moving)
        stack.extend((below.child, below.origin[:3, :3].T @ axis) for below in fixed)
    return []


def _tread(link: str, shape: Shape, axis: Array, paths: MeshPaths) -> Tyre | None:
    """Return the tread that a shape is of a wheel about ``axis`` (3,) in its link, or None."""
    if shape.kind == "sphere":
        return Tyre(link, shape.origin, shape.size[0], shape.size[0])
    if shape.kind in ("cylinder", "capsule"):
        if np.linalg.norm(np.cross(shape.origin[:3, 2], axis)) > MAX_AXIS_SINE:
            return None
        radius, length = shape.size
        return Tyre(link, shape.origin, radius, max(0.5 * length, MIN_HALF_WIDTH_M))
    return _mesh_tread(link, shape, axis, paths) if shape.kind == "mesh" else None


def _mesh_tread(link: str, shape: Shape, axis: Array, paths: MeshPaths) -> Tyre | None:
    """Return the tread that bounds a mesh, its centre on the link's z axis turned to ``axis``."""
    try:
        surfaces = mesh_files.read_shape(str(shape.mesh), shape.size, paths).surfaces
    except MeshError:
        return None
    points = np.concatenate([surface.vertices for surface in surfaces]) * shape.size
    pose = about(axis)
    points = (points @ shape.origin[:3, :3].T + shape.origin[:3, 3]) @ pose[:3, :3]
    low, high = points.min(axis=0), points.max(axis=0)
    pose[:3, 3] = 0.5 * (low[2] + high[2]) * axis
    radius = 0.5 * float((high - low)[:2].max())
    return Tyre(link, pose, radius, max(0.5 * float(high[2] - low[2]), MIN_HALF_WIDTH_M))


def geom_size(shape: Shape) -> list[float]:
    """Return a URDF shape's size as MuJoCo counts it: half edges, half lengths; three numbers."""
    if shape.kind == "box":
        return [0.5 * edge for edge in shape.size]
    radius, *length = shape.size
    return [radius, 0.5 * length[0] if length else 0.0, 0.0]


def about(axis: Array) -> Array:
    """Return a pose (4, 4) at the origin whose z axis is ``axis`` (3,)."""
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    across /= math.sqrt(across @ across)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    return pose
