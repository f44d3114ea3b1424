"""A robot's shapes, placed on its moving joints and ready to be drawn."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from rpctl.arrays import Array
from rpctl.description.mesh_files import Surface
from rpctl.description.mesh_paths import MeshError
from rpctl.description.mesh_service import start_reader
from rpctl.description.mesh_shading import ShadedMesh
from rpctl.description.records import Shape
from rpctl.robot.model import Robot
from rpctl.view.scene import stand_ins
from rpctl.view.scene.placed_shapes import MeshCache, PlacedSurface, place_shape, sticks
from rpctl.view.scene.shaded_surfaces import shade_surface
from rpctl.view.scene.stand_ins import StandIn

MAX_TRIANGLES = 45_000  # of a whole robot: it stays recognisable, and its report small
MIN_MESH_TRIANGLES = 300  # triangles that even the smallest mesh keeps
DEFAULT_RGBA = (0.74, 0.77, 0.81, 1.0)  # where neither the URDF nor the mesh gives a colour


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A surface that moves with a joint.

    Attributes:
        joint: Index of the joint in the Pinocchio model; 1 is the planar root.
        pose: Matrix (4, 4) from the mesh's coordinates to the joint's frame, scale included.
        surface: Which of ``Bodies.surfaces`` is drawn.
        rgba: Colour, each in [0, 1].
        stands_in: Whether it is hatched, as it stands in for a mesh that is missing.
    """

    joint: int
    pose: Array
    surface: int
    rgba: tuple[float, ...]
    stands_in: bool = False


@dataclass(frozen=True, eq=False)
class Bodies:
    """All that is drawn of a robot.

    Attributes:
        parts: In the order of the URDF.
        surfaces: Each mesh once, however many parts show it.
        notes: Shapes that were left out, why, and what stands in for them.
        stand_ins: The links whose meshes are missing.
        size: Of the robot, m: the hatches are in proportion.
    """

    parts: tuple[BodyPart, ...]
    surfaces: tuple[ShadedMesh, ...]
    notes: tuple[str, ...]
    stand_ins: tuple[StandIn, ...] = ()
    size: float = 1.0


def build_bodies(robot: Robot, triangles: int = MAX_TRIANGLES) -> Bodies:
    """Return what is drawn of a robot.

    The visual shapes are drawn; for a robot without any, the collision shapes. Where a mesh is
    missing, something hatched stands in for it (:mod:`rpctl.view.scene.stand_ins`); where no
    shape is known at all, sticks from joint to joint are drawn.

    Args:
        robot: The robot.
        triangles: About how many the robot may have; large meshes are simplified first.
    """
    links = robot.description.links
    visual = any(link.visuals for link in links)
    cache: MeshCache = {}
    skipped: dict[str, list[tuple[str, str]]] = {}
    placed_surfaces: list[PlacedSurface] = []
    found: list[StandIn] = []
    start_reader()
    size = stand_ins.robot_size(robot)
    for link in links:
        whole = True
        for shape in link.visuals if visual else link.collisions:
            try:
                placed_surfaces.extend(place_shape(robot, link, shape, cache))
            except MeshError as error:  # noqa: PERF203 - one bad mesh must not cost the others
                skipped.setdefault(str(error), []).append((_label(shape), link.name))
                whole = False
        if not whole:
            instead, surfaces_instead = stand_ins.stand_in(robot, link, size, cache)
            found.append(instead)
            placed_surfaces += surfaces_instead
    notes = [_note(reason, where) for reason, where in skipped.items()]
    notes += [f'mesh "{_file_label(name)}": {each}' for name, each in _remarks(cache)]
    if len(placed_surfaces) == sum(each.kind == "marker" for each in found):
        notes.append("no shape of this robot can be drawn: sticks stand for its links")
        placed_surfaces, found = list(sticks(robot)), []
    elif found:
        notes.append(stand_ins.note(found))
    parts, surfaces, more = _shaded(placed_surfaces, triangles)
    return Bodies(parts, surfaces, (*notes, *more), tuple(found), size)


def _label(shape: Shape) -> str:
    """Return what a shape is called in a note."""
    return f"the {shape.kind}" if shape.mesh is None else f'mesh "{_file_label(shape.mesh)}"'


def _file_label(name: str) -> str:
    """Return a mesh's name in the URDF, of an absolute path its file name: reports are shared."""
    outside = PurePath(name).is_absolute() or name.startswith("file:")
    return PurePath(name).name if outside else name


def _remarks(cache: MeshCache) -> list[tuple[str, str]]:
    """Return what was left out of meshes, each with its name, once."""
    said = ((name, remark) for (name, _), mesh in cache.items() for remark in mesh.remarks)
    return list(dict.fromkeys(said))


def _note(reason: str, where: list[tuple[str, str]]) -> str:
    """Return the note on shapes that share a fault, from their names and links."""
    (mesh, link), more = where[0], len(where) - 1
    others = f" and {more} more are" if more else " is"
    return f'{mesh} of link "{link}"{others} not drawn: {reason}'


def _shaded(
    placed_surfaces: list[PlacedSurface], triangles: int
) -> tuple[tuple[BodyPart, ...], tuple[ShadedMesh, ...], tuple[str, ...]]:
    """Return the parts, their surfaces, simplified to a budget that each enters once, and notes."""
    digest_of = {item.key: _digest(item.surface) for item in placed_surfaces}
    unique = {
        digest_of[item.key]: item.surface for item in placed_surfaces
    }  # two files may hold one mesh
    index = {each: number for number, each in enumerate(unique)}
    cap = _cap([len(surface.faces) for surface in unique.values()], triangles)
    foreign = {digest_of[item.key] for item in placed_surfaces if item.foreign}
    shaded = [shade_surface(surface, cap, key in foreign) for key, surface in unique.items()]
    surfaces = tuple(mesh for mesh, _ in shaded)
    faults = {key: fault for key, (_, fault) in zip(unique, shaded, strict=True) if fault}
    named = {digest_of[item.key]: item.key[1] for item in placed_surfaces if item.foreign}
    notes = tuple(
        f'mesh "{_file_label(str(named.get(key, "")))}" is drawn as a box: {fault}'
        for key, fault in faults.items()
    )
    parts = tuple(
        BodyPart(
            item.joint,
            item.pose,
            index[digest_of[item.key]],
            item.rgba or DEFAULT_RGBA,
            item.stands_in,
        )
        for item in placed_surfaces
    )
    return parts, surfaces, notes


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
