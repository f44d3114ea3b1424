"""Mesh files as triangles, and their convex hulls: no file is opened but the mesh and an OBJ's MTL.

Their bytes are read here and understood in a confined process
(:mod:`rpctl.description.meshes.worker`), whose answer is checked before it is used.
"""

from __future__ import annotations

import hashlib
import re
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array, read_only
from rpctl.description.meshes.jobs import MAX_COORDINATE, make_primitive
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.meshes.service import StalledMeshError, ask
from rpctl.errors import InputError
from rpctl.files.caps import cap, read_input

LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # how a file not yet fetched begins
MATERIAL = re.compile(rb"mtllib([^\n]{1,1024})")  # of an OBJ
CAPS = ("MAX_MESH_TRIANGLES", "MAX_MESH_PARTS", "MAX_MESH_SECONDS", "MAX_MESH_MEMORY")
KEPT_BYTES = 2**25  # of meshes and hulls that are not made again; a wheel is asked for four times
FAULT_BYTES = 2**10  # that a mesh counts for that is not tried again, and any other besides its own
MAX_STALLED = 2  # meshes of a robot that may take too long; the rest is not tried
EXTENT_RANGE_M = (1e-6, 1e4)  # m: of a mesh at its scale, and how far it reaches from its origin
IN_METRES = "is it in another unit? give m"
KEPT: OrderedDict[bytes, Mesh | MeshError] = OrderedDict()  # by a digest of what is read


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh of one colour.

    Attributes:
        vertices: (n, 3), m, finite, read-only.
        faces: Corners of each triangle (k, 3), read-only.
        rgba: Colour that the file gives, each in [0, 1], or None.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    rgba: tuple[float, ...] | None


@dataclass(frozen=True)
class Mesh:
    """What a mesh file holds.

    Attributes:
        surfaces: One for each colour.
        remarks: What was left out, and why.
    """

    surfaces: tuple[Surface, ...]
    remarks: tuple[str, ...] = ()


def _once(key: bytes, make: Callable[[], Mesh]) -> Mesh:
    """Return what is made of the same bytes, or raise its fault; the oldest are given up."""
    made = KEPT.get(key)
    if made is None:
        try:
            made = make()
        except MeshError as fault:
            made = fault
        KEPT[key] = made
        while sum(map(_size, KEPT.values())) > KEPT_BYTES:
            KEPT.popitem(last=False)
    if isinstance(made, MeshError):
        raise type(made)(str(made))
    return made


def _size(kept: Mesh | MeshError) -> int:
    surfaces = () if isinstance(kept, MeshError) else kept.surfaces
    return FAULT_BYTES + sum(each.vertices.nbytes + each.faces.nbytes for each in surfaces)


def read_mesh(path: Path) -> Mesh:
    """Return what a mesh file holds, and what is to be said of it.

    Args:
        path: A file that ``resolve`` returned.

    Raises:
        StalledMeshError: It takes too long or too much memory to read.
        MeshError: The file is too large, is damaged, or shows nothing that can be used.
    """
    kind = path.suffix.lower().removeprefix(".")
    try:
        content = read_input(path, "MAX_MESH_BYTES", "a mesh")
    except InputError as error:
        raise MeshError(f"not readable: {error.fault}") from None
    if content.startswith(LFS_POINTER):
        raise MeshError("only a Git LFS pointer, not the mesh; run: git lfs pull")
    material = _material(content, path) if kind == "obj" else None
    key = hashlib.sha256(repr([kind, material, *map(cap, CAPS)]).encode() + content).digest()
    return _once(key, lambda: _ask(kind, content, material))


def read_shape(name: str, scale: Sequence[float], paths: MeshPaths) -> Mesh:
    """Return the mesh of a shape, in the mesh's coordinates, if it is as large as a robot's part.

    Args:
        scale: By which each axis is multiplied (3,).
        paths: Finds the file, and knows which meshes of its robot took too long.

    Raises:
        MeshError: It is missing, is refused, or has no sensible size at this scale.
    """
    path = paths.resolve(name)
    if len(paths.stalled - {name}) >= MAX_STALLED:
        raise MeshError(f"not read: {MAX_STALLED} other meshes of this robot took too long")
    try:
        mesh = read_mesh(path)
    except StalledMeshError:
        paths.stalled.add(name)
        raise
    said = "" if tuple(scale) == (1.0, 1.0, 1.0) else f" at a scale of {' '.join(map(str, scale))}"
    require_extent(mesh.surfaces, np.diag([*scale, 1.0]), said)
    return mesh


def primitive(kind: str, size: Sequence[float]) -> Surface:
    """Return a shape of the URDF that is no mesh as triangles.

    The process that reads meshes makes it, for its library takes long to import; should there be
    none, it is imported here.

    Args:
        size: As :class:`rpctl.description.records.Shape` has it, m.

    Raises:
        MeshError: It is too large for numbers.
    """
    head = {"kind": kind, "size": list(size)}
    try:
        answer = ask("primitive", head, [])
    except MeshError:
        answer = make_primitive(head)
    return _mesh_of(answer).surfaces[0]


def require_extent(surfaces: Sequence[Surface], pose: Array, where: str) -> None:
    """Refuse triangles that are no part of a robot: too large, too far away, or too small to see.

    Args:
        pose: Matrix (4, 4) from their coordinates to a frame of the robot, m.

    Raises:
        MeshError: They are.
    """
    ends = [(s.vertices.min(axis=0), s.vertices.max(axis=0)) for s in surfaces]
    low, high = np.min([end[0] for end in ends], axis=0), np.max([end[1] for end in ends], axis=0)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        half = np.abs(pose[:3, :3]) @ (0.5 * (high - low))
        middle = pose[:3, :3] @ (0.5 * (high + low)) + pose[:3, 3]
        extent, reach = 2.0 * float(half.max()), float((np.abs(middle) + half).max())
    least, most = EXTENT_RANGE_M
    if not reach <= most:
        raise MeshError(f"refused: it reaches {reach:.3g} m from its frame{where}; {IN_METRES}")
    if not extent >= least:
        raise MeshError(f"refused: it is {extent:.3g} m large{where}; {IN_METRES}")


def _material(content: bytes, path: Path) -> tuple[str, bytes] | None:
    """Return name and content of the MTL that an OBJ names, if it lies beside it."""
    named = MATERIAL.search(content)
    name = named[1].decode("utf-8", "replace").strip() if named else ""
    if not name or not name.isprintable():
        return None
    target = (path.parent / name).resolve()
    if target.suffix.lower() != ".mtl" or target.parent != path.parent:
        return None
    try:
        return name, read_input(target, "MAX_MESH_BYTES", "an MTL")
    except InputError:
        return None


def _ask(kind: str, content: bytes, material: tuple[str, bytes] | None) -> Mesh:
    """Return a mesh as the confined process reads it."""
    head = {
        "kind": kind,
        "parts": cap("MAX_MESH_PARTS"),
        "triangles": cap("MAX_MESH_TRIANGLES"),
        "material": material and material[0],
    }
    files = [content] if material is None else [content, material[1]]
    return _mesh_of(ask("read", head, [np.frombuffer(each, np.uint8) for each in files]))


def _mesh_of(answer: tuple[dict[str, Any], Sequence[Any]]) -> Mesh:
    """Return the mesh that an answer is.

    Raises:
        MeshError: It is none.
    """
    try:
        return _checked(*answer)
    except (TypeError, ValueError, KeyError, AttributeError):
        raise MeshError("not readable: the reading process returned no mesh") from None


def _checked(answer: dict[str, Any], arrays: Sequence[Any]) -> Mesh:
    """Return a mesh from an answer, if it is one."""
    colours = [None if each is None else _colour(each) for each in answer["colours"]]
    if not colours or len(arrays) != 2 * len(colours):
        raise ValueError
    surfaces = []
    for colour, vertices, faces in zip(colours, arrays[::2], arrays[1::2], strict=True):
        of_vertices = vertices.dtype == np.float64 and vertices.shape[1:] == (3,)
        of_faces = faces.dtype == np.uint32 and faces.shape[1:] == (3,) and len(faces)
        sound = of_vertices and of_faces and faces.max() < len(vertices)
        if not (sound and np.abs(vertices).max() <= MAX_COORDINATE):
            raise ValueError
        faces = faces.astype(np.int64)
        faces.setflags(write=False)
        surfaces.append(Surface(vertices, faces, colour))
    remarks = [str(each)[:200] for each in answer["remarks"] if str(each).isprintable()]
    return Mesh(tuple(surfaces), tuple(remarks))


def _colour(values: Sequence[float]) -> tuple[float, ...]:
    rgba = tuple(float(value) for value in values)
    if len(rgba) != 4 or not all(0.0 <= value <= 1.0 for value in rgba):
        raise ValueError
    return rgba


def convex_hull(surfaces: Sequence[Surface], scale: Sequence[float]) -> Surface:
    """Return the convex hull of the surfaces of a mesh.

    Args:
        scale: By which each axis is multiplied (3,).

    Raises:
        MeshError: It is flat, or there is no process to compute it.
    """
    points = np.unique(np.concatenate([s.vertices for s in surfaces]), axis=0) * np.array(scale)
    key = hashlib.sha256(points.tobytes()).digest()
    return _once(key, lambda: _checked_hull(points, ask("hull", {}, [points])[1])).surfaces[0]


def _checked_hull(points: Array, answer: Sequence[NDArray[np.generic]]) -> Mesh:
    """Return the hull of points (n, 3) from the answer: corners (k, 3), as numbers of points.

    Raises:
        MeshError: The answer is no such thing.
    """
    corners = np.array(answer[0]) if len(answer) == 1 else np.empty(0)
    triangles = corners.dtype == np.uint32 and corners.shape[1:] == (3,) and len(corners) > 0
    if not triangles or corners.max() >= len(points):
        raise MeshError("the reading process returned no hull")
    used, faces = np.unique(corners.astype(np.int64), return_inverse=True)
    faces = faces.reshape(-1, 3)
    faces.setflags(write=False)
    return Mesh((Surface(read_only(points[used]), faces, None),))
