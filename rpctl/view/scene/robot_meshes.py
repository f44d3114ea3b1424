"""A robot's shapes, placed on its moving joints and ready to be drawn."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.mesh_files import Surface, read
from rpctl.description.mesh_paths import MeshError
from rpctl.description.records import Link, Shape
from rpctl.libraries import library
from rpctl.robot.model import Robot
from rpctl.view.scene.shading import ShadedMesh, shade, simplify

MAX_TRIANGLES = 45_000  # of a whole robot: it stays recognisable, and its report small
MIN_MESH_TRIANGLES = 300  # triangles that even the smallest mesh keeps
DEFAULT_RGBA = (0.74, 0.77, 0.81, 1.0)  # where neither the URDF nor the mesh gives a colour
STICK_RGBA = (0.45, 0.52, 0.62, 1.0)
CYLINDER_SIDES = 40  # sides of a cylinder

Key = tuple[object, ...]


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A surface that moves with a joint.

    Attributes:
        joint: Index of the joint in the Pinocchio model; 1 is the planar root.
        pose: Matrix (4, 4) from the mesh's coordinates to the joint's frame, scale included.
        surface: Which of ``Bodies.surfaces`` is drawn.
        rgba: Colour, each in [0, 1].
    """

    joint: int
    pose: Array
    surface: int
    rgba: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Bodies:
    """All that is drawn of a robot.

    Attributes:
        parts: In the order of the URDF.
        surfaces: Each mesh once, however many parts show it.
        notes: Shapes that were left out, and why.
    """

    parts: tuple[BodyPart, ...]
    surfaces: tuple[ShadedMesh, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _PlacedSurface:
    """A surface of a shape, as read."""

    joint: int
    pose: Array
    key: Key
    surface: Surface
    rgba: tuple[float, ...] | None


def build_bodies(robot: Robot, triangles: int = MAX_TRIANGLES) -> Bodies:
    """Return what is drawn of a robot.

    The visual shapes are drawn; for a robot without any, the collision shapes; where no shape
    can be drawn, sticks from joint to joint.

    Args:
        robot: The robot.
        triangles: About how many the robot may have; large meshes are simplified first.
    """
    links = robot.description.links
    visual = any(link.visuals for link in links)
    cache: dict[str, tuple[Surface, ...]] = {}
    skipped: dict[tuple[str, str], list[str]] = {}
    placed_surfaces: list[_PlacedSurface] = []
    for link in links:
        for shape in link.visuals if visual else link.collisions:
            try:
                placed_surfaces.extend(_place(robot, link, shape, cache))
            except MeshError as error:  # noqa: PERF203 - one bad mesh must not cost the others
                skipped.setdefault((_mesh_label(shape), str(error)), []).append(link.name)
    notes = [_note(mesh, reason, where) for (mesh, reason), where in skipped.items()]
    if not placed_surfaces:
        notes.append("no shape of this robot can be drawn: sticks stand for its links")
        placed_surfaces = list(_sticks(robot))
    parts, surfaces = _shaded(placed_surfaces, triangles)
    return Bodies(parts, surfaces, tuple(notes))


def _mesh_label(shape: Shape) -> str:
    """Return a mesh's name in the URDF, of an absolute path its file name: reports are shared."""
    name = shape.mesh or shape.kind
    outside = PurePath(name).is_absolute() or name.startswith("file:")
    return PurePath(name).name if outside else name


def _note(mesh: str, reason: str, links: list[str]) -> str:
    more = f" and {len(links) - 1} more" if len(links) > 1 else ""
    return f'mesh "{mesh}" of link "{links[0]}"{more} is not drawn: {reason}'


def _place(
    robot: Robot, link: Link, shape: Shape, cache: dict[str, tuple[Surface, ...]]
) -> Iterator[_PlacedSurface]:
    """Return the surfaces of a shape, placed on the joint that moves its link."""
    if shape.rgba is not None and shape.rgba[3] <= 0.0:
        return
    frame = robot.model.frames[robot.model.getFrameId(link.name, pin.FrameType.BODY)]
    pose = frame.placement.homogeneous @ shape.origin
    if shape.mesh is None:
        key = (shape.kind, shape.size)
        yield _PlacedSurface(frame.parentJoint, pose, key, _primitive(shape), shape.rgba)
        return
    if shape.mesh not in cache:
        cache[shape.mesh] = read(robot.description.mesh_paths.resolve(shape.mesh))
    pose = pose @ np.diag([*shape.size, 1.0])
    for number, surface in enumerate(cache[shape.mesh]):
        rgba = shape.rgba or surface.rgba
        yield _PlacedSurface(frame.parentJoint, pose, ("mesh", shape.mesh, number), surface, rgba)


def _primitive(shape: Shape) -> Surface:
    creation = library("trimesh.creation")

    makers: dict[str, Callable[..., Any]] = {
        "box": lambda *edges: creation.box(edges),
        "cylinder": lambda radius, length: creation.cylinder(
            radius, length, sections=CYLINDER_SIDES
        ),
        "capsule": lambda radius, length: creation.capsule(
            length, radius, count=[CYLINDER_SIDES, CYLINDER_SIDES]
        ),
        "sphere": lambda radius: creation.uv_sphere(
            radius, count=[CYLINDER_SIDES // 2, CYLINDER_SIDES]
        ),
    }
    unit = max(shape.size)  # trimesh drops triangles that are tiny in its own unit
    return _surface(makers[shape.kind](*(edge / unit for edge in shape.size)), unit)


def _surface(mesh: Any, unit: float = 1.0) -> Surface:
    return Surface(unit * np.asarray(mesh.vertices, float), np.asarray(mesh.faces), None)


def _sticks(robot: Robot) -> Iterator[_PlacedSurface]:
    """Return a ball at every link's origin and a stick from it to each joint below."""
    creation = library("trimesh.creation")

    below = robot.description.child_joints
    lengths = [float(np.linalg.norm(j.origin[:3, 3])) for j in robot.description.joints]
    thickness = 0.06 * max([0.3, *lengths])
    ball = _surface(creation.icosphere(subdivisions=2, radius=thickness))
    for link in robot.description.links:
        frame = robot.model.frames[robot.model.getFrameId(link.name, pin.FrameType.BODY)]
        pose, joint = frame.placement.homogeneous, frame.parentJoint
        yield _PlacedSurface(joint, pose, ("ball",), ball, STICK_RGBA)
        for end in (below_joint.origin[:3, 3] for below_joint in below[link.name]):
            if np.linalg.norm(end) > thickness:
                stick = creation.cylinder(0.5 * thickness, segment=[np.zeros(3), end])
                yield _PlacedSurface(
                    joint, pose, ("stick", *end.tolist()), _surface(stick), STICK_RGBA
                )


def _shaded(
    placed_surfaces: list[_PlacedSurface], triangles: int
) -> tuple[tuple[BodyPart, ...], tuple[ShadedMesh, ...]]:
    """Return the parts and their surfaces, simplified to a budget that each mesh enters once."""
    digest_of = {item.key: _digest(item.surface) for item in placed_surfaces}
    unique = {
        digest_of[item.key]: item.surface for item in placed_surfaces
    }  # two files may hold one mesh
    index = {each: number for number, each in enumerate(unique)}
    cap = _cap([len(surface.faces) for surface in unique.values()], triangles)
    surfaces = tuple(
        shade(*simplify(surface.vertices, surface.faces, cap)) for surface in unique.values()
    )
    parts = tuple(
        BodyPart(item.joint, item.pose, index[digest_of[item.key]], item.rgba or DEFAULT_RGBA)
        for item in placed_surfaces
    )
    return parts, surfaces


def _digest(surface: Surface) -> bytes:
    """Return a digest of a surface's triangles, wherever they came from."""
    digest = hashlib.sha256(surface.faces.tobytes())
    digest.update(surface.vertices.tobytes())
    return digest.digest()


def _cap(counts: list[int], total: int) -> int:
    """Return the largest limit of triangles per mesh that keeps the sum within ``total``."""
    left, remaining = total, len(counts)
    for count in sorted(counts):
        if count * remaining > left:
            return max(MIN_MESH_TRIANGLES, left // remaining)
        left, remaining = left - count, remaining - 1
    return max(counts, default=MIN_MESH_TRIANGLES)


def bounding_corners(bodies: Bodies, joint: int) -> Array | None:
    """Return the corners (8, 3) of the box around a joint's parts in its frame, m; None: bare."""
    boxes = []
    for part in bodies.parts:
        if part.joint == joint:
            vertices = bodies.surfaces[part.surface].vertices
            if len(vertices):
                placed_surfaces = vertices @ part.pose[:3, :3].T + part.pose[:3, 3]
                boxes.append((placed_surfaces.min(axis=0), placed_surfaces.max(axis=0)))
    if not boxes:
        return None
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    return np.array([[(low, high)[k >> i & 1][i] for i in range(3)] for k in range(8)])
