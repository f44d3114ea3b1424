"""What is computed on meshes in the process that reads them; it has no files, and little memory."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.description.meshes.headers import MeshFaultError, Size, check_header, require_within
from rpctl.libraries import library

MAX_COORDINATE = 1e9  # in units of the file, DAE's in m; of what is 10 m large, that is 10 nm
MERGED = 200_000  # triangles of a piece; whoever draws a larger one merges its vertices, too
SIDES = 40  # of a cylinder
FLAT = 1e-12  # of its extents' square: an area below it is rounding

Head = dict[str, Any]
Answer = tuple[Head, list[Any]]
Floats = NDArray[np.float64]
Faces = NDArray[np.int64]
CREASE_RAD = math.radians(35.0)  # faces that meet at a larger angle keep an edge between them
NORMAL_STEPS = 127  # normals are told apart, and sent, in signed bytes
MAX_FAN = 64  # corners at a vertex; where more meet, as in a disc's middle, each keeps its face's


def read_mesh(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return the triangles of a mesh file, one surface for each colour; textures are left out.

    Args:
        head: ``kind``, the file's ending; ``parts`` and ``triangles``, the most it may show;
            ``material``, the name of an OBJ's MTL, if there is one.
        arrays: The bytes of the file, and of the MTL.

    Returns:
        ``colours``, one for each surface, and ``remarks``; the vertices (n, 3), m, and corners
        (k, 3) of each surface.

    Raises:
        MeshFaultError: The file is damaged, is absurd, or shows too much.
    """
    kind, most = head["kind"], Size(head["parts"], head["triangles"])
    content = arrays[0].tobytes()
    if kind == "dae" and any(mark in content for mark in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):
        raise MeshFaultError("refused: a DAE with a document type or entities, or not in UTF-8")
    promised = check_header(kind, content, most)
    material = arrays[1].tobytes() if len(arrays) > 1 else b""
    scene = _load(content, kind, head.get("material"), material)
    pieces, remarks = _pieces(scene, kind, most)
    if not pieces:
        raise MeshFaultError(_nothing(scene, promised if kind == "dae" else None))
    groups: dict[Any, list[tuple[Any, Any]]] = {}
    for vertices, faces, colour in pieces:
        groups.setdefault(colour, []).append((vertices, faces))
    surfaces = {colour: stack(group) for colour, group in groups.items()}
    _require_areas(list(surfaces.values()))
    answer = {"colours": list(surfaces), "remarks": remarks}
    return answer, [array for surface in surfaces.values() for array in surface]


def _load(content: bytes, kind: str, name: str | None, material: bytes) -> Any:
    """Return the file as a scene of trimesh.

    Args:
        kind: Its ending, without the dot.
        name: Of the MTL beside an OBJ; no other file is there for it.
    """
    trimesh = library("trimesh")
    beside = trimesh.resolvers.ZipResolver({name: io.BytesIO(material)})
    return trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=beside, process=False)


def _pieces(scene: Any, kind: str, most: Size) -> tuple[list[tuple[Any, Any, Any]], list[str]]:
    """Return the vertices, m, the corners and the colour of each piece of a scene; remarks."""
    unit = _unit(scene) if kind == "dae" else 1.0
    shown = [(node, *scene.graph[node]) for node in scene.graph.nodes_geometry]
    triangles = sum(len(getattr(scene.geometry[name], "faces", ())) for _, _, name in shown)
    require_within(Size(len(shown), triangles), most)
    pieces, remarks = [], []
    for _, pose, name in shown:
        mesh = scene.geometry[name]
        faces = getattr(mesh, "faces", None)
        if faces is None or not len(faces):
            continue
        _require_corners(faces, len(mesh.vertices))
        _require_sensible(mesh.vertices[_used(mesh)], 1.0)
        if len(shown) == 1:  # several may share their vertices
            remarks = _loose_vertices(mesh)
        if len(faces) <= MERGED:
            mesh.merge_vertices()
        placed = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        pieces.append((_require_sensible(placed, unit), np.asarray(mesh.faces), _colour(mesh)))
    return pieces, remarks


def _nothing(scene: Any, promised: Size | None) -> str:
    """Return what is wrong with a file of which no triangle was read."""
    if promised is not None and promised.triangles:
        return "has no triangles with valid vertices; export it again"
    points = sum(len(getattr(mesh, "vertices", ())) for mesh in scene.geometry.values())
    return f"has no triangles{f', only {points} points' if points else ''}"


def _require_corners(faces: Any, count: int) -> None:
    """Refuse triangles (k, 3) of vertices that are not among ``count``."""
    for wrong in (int(faces.min()), int(faces.max())):
        if not 0 <= wrong < count:
            raise MeshFaultError(
                f"refused: a triangle names vertex {wrong} of {count} (from 0); export it again"
            )


def _require_sensible(vertices: Any, unit: float) -> Any:
    """Return vertices (n, 3) in m; refuse what is no length of a robot."""
    with np.errstate(over="ignore", invalid="ignore"):
        placed = unit * np.asarray(vertices, float)
        reach = float(np.abs(placed).max())  # a NaN among them is the largest
    if not math.isfinite(reach):
        raise MeshFaultError("refused: some vertices are not numbers; export it again")
    if reach > MAX_COORDINATE:
        raise MeshFaultError(
            f"refused: its vertices reach {reach:.3g} m; at most {MAX_COORDINATE:g} m are "
            "allowed; export it again, in m"
        )
    return placed


def _used(mesh: Any) -> Any:
    """Return which vertices (n,) some triangle has."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    return used


def _loose_vertices(mesh: Any) -> list[str]:
    """Return what there is to say of vertices that no triangle has, far from those that one has."""
    used = mesh.vertices[_used(mesh)]
    loose = ((mesh.vertices < used.min(axis=0)) | (mesh.vertices > used.max(axis=0))).any(axis=1)
    count = int(loose.sum())
    if not count:
        return []
    what = f"{count} vertices lie" if count > 1 else "a vertex lies"
    return [f"{what} beyond its triangles, belong to none of them, and are ignored"]


def stack(pieces: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return the vertices (n, 3) and corners (k, 3) of several pieces as one."""
    counts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    vertices = np.concatenate([vertices for vertices, _ in pieces])
    faces = [faces + first for (_, faces), first in zip(pieces, counts[:-1], strict=True)]
    return vertices.astype("<f8"), np.concatenate(faces).astype("<u4")


def _require_areas(surfaces: Sequence[tuple[Any, Any]]) -> None:
    """Refuse meshes of which no triangle has an area."""
    extent = max(float(np.ptp(vertices, axis=0).max()) for vertices, _ in surfaces)
    for vertices, faces in surfaces:
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        if (np.abs(np.cross(b - a, c - a)) > FLAT * extent**2).any():
            return
    count = sum(len(faces) for _, faces in surfaces)
    what = f"all of its {count} triangles have" if count > 1 else "its only triangle has"
    raise MeshFaultError(f"is degenerate: {what} no area; export it again")


def _unit(scene: Any) -> float:
    """Return the length of a DAE's unit in m."""
    factor = str(scene.units or "").partition(" * ")[0]
    try:
        return float(factor)
    except ValueError:
        return 1.0


def _colour(mesh: Any) -> tuple[float, ...] | None:
    """Return a mesh's own colour, or None where the file gives none."""
    if not mesh.visual.defined:
        return None
    raw = getattr(mesh.visual, "material", mesh.visual).main_color
    return *(round(float(value) / 255.0, 3) for value in raw[:3]), 1.0


def make_primitive(head: Mapping[str, Any], arrays: Sequence[Any] = ()) -> Answer:
    """Return a shape of the URDF as a mesh, as :func:`read_mesh` does.

    Args:
        head: ``kind``, and ``size``, m, as :class:`rpctl.description.records.Shape` has them.
        arrays: None.
    """
    creation = library("trimesh.creation")
    unit = max(head["size"])  # trimesh drops triangles that are tiny in its own unit
    size = [edge / unit for edge in head["size"]]
    makers = {
        "box": lambda: creation.box(size),
        "cylinder": lambda: creation.cylinder(*size, sections=SIDES),
        "capsule": lambda: creation.capsule(size[1], size[0], count=[SIDES, SIDES]),
        "sphere": lambda: creation.uv_sphere(*size, count=[SIDES // 2, SIDES]),
    }
    mesh = makers[head["kind"]]()
    vertices = unit * np.asarray(mesh.vertices, "<f8")
    return {"colours": [None], "remarks": []}, [vertices, np.asarray(mesh.faces, "<u4")]


def shade_mesh(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return a mesh simplified to about ``triangles``, with its normals.

    Args:
        head: ``triangles``.
        arrays: Its vertices (n, 3), m, and corners (k, 3).

    Returns:
        Nothing in words; vertices, normals and corners (:class:`..mesh_shading.ShadedMesh`).
    """
    vertices, faces = arrays
    shaded = shade(*simplify(vertices, faces.astype(np.int64), head["triangles"]))
    return {}, [shaded.vertices, shaded.normals, shaded.faces]


def measure_solid(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return the body that a mesh encloses, or its convex hull where it is open.

    Args:
        head: ``scale``, by which each axis is multiplied.
        arrays: Its vertices (n, 3), m, and corners (k, 3).

    Returns:
        Whether it is ``closed``; volume (1,), m³, centroid (3,), m, and second moment (3, 3), m⁵.

    Raises:
        MeshFaultError: It encloses nothing.
    """
    vertices, faces = arrays
    mesh = library("trimesh").Trimesh(vertices * head["scale"], faces.astype(np.int64))
    closed = bool(mesh.is_watertight and mesh.is_winding_consistent)
    try:
        body = mesh if closed else mesh.convex_hull
        sign = math.copysign(1.0, body.volume)  # a mirrored mesh is inside out
        found = [body.mass_properties[key] for key in ("volume", "center_mass", "inertia")]
        volume, centroid, moment = (np.array(each, float) for each in found)
    except MemoryError:
        raise
    except Exception as error:  # hulls of flat or degenerate meshes fail in many ways
        raise MeshFaultError(f"it encloses no volume ({type(error).__name__})") from None
    return {"closed": closed}, [sign * volume.reshape(1), centroid, sign * moment]


def convex_hull(head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return the convex hull of points.

    Args:
        arrays: The points (n, 3), m.

    Returns:
        Nothing in words; the corners (k, 3) of the hull's triangles, as numbers of points.

    Raises:
        MeshFaultError: All points lie in a plane.
    """
    spatial = library("scipy.spatial")
    try:
        hull = spatial.ConvexHull(arrays[0])
    except (ValueError, spatial.QhullError):
        raise MeshFaultError("it is flat: it has no convex hull") from None
    return {}, [np.asarray(hull.simplices, "<u4")]


@dataclass(frozen=True, eq=False)
class ShadedMesh:
    """A triangle mesh as it is drawn.

    Attributes:
        vertices: (n, 3), m; a vertex on a sharp edge occurs once for each of its normals.
        normals: Signed bytes (n, 3), 127 for 1.
        faces: (k, 3).
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.int8]
    faces: NDArray[np.uint32]


def simplify(vertices: Floats, faces: Faces, count: int) -> tuple[Floats, Faces]:
    """Return a mesh of about ``count`` triangles of the same shape (quadric edge collapse).

    Args:
        vertices: Vertices (n, 3), m.
        faces: Triangles (m, 3), as indices of vertices.
    """
    vertices, faces = weld(vertices, faces)
    if len(faces) <= count:
        return vertices, faces
    points, triangles = library("fast_simplification").simplify(
        vertices.astype(np.float32), faces.astype(np.int32), target_count=count
    )
    return weld(points.astype(float), triangles.astype(np.int64))


def _pairs(corners: Faces) -> tuple[Faces, Faces]:
    """Return the pairs of corners (n,) at one vertex; a corner of a large fan is its own only."""
    order = np.argsort(corners, kind="stable")
    _, first, counts = np.unique(corners[order], return_index=True, return_counts=True)
    large = np.repeat(counts > MAX_FAN, counts)
    begin = np.where(large, np.arange(len(corners)), np.repeat(first, counts))
    length = np.where(large, 1, np.repeat(counts, counts))
    row = np.repeat(np.arange(len(corners)), length)
    within = np.arange(len(row)) - np.repeat(np.cumsum(length) - length, length)
    return order[row], order[begin[row] + within]


def weld(vertices: Floats, faces: Faces) -> tuple[Floats, Faces]:
    """Return the mesh with equal vertices merged and triangles without an area left out."""
    points, index = np.unique(vertices.astype(np.float32), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    a, b, c = faces.T
    return points.astype(float), faces[(a != b) & (b != c) & (c != a)]


def shade(vertices: Floats, faces: Faces, crease: float = CREASE_RAD) -> ShadedMesh:
    """Return the mesh with a normal for every corner.

    The normal of a corner is the area-weighted mean of those faces around the vertex that meet
    its own face at less than ``crease``; where more than ``MAX_FAN`` meet it is that of its face,
    for the pairs of a fan's faces grow with their square.

    Args:
        vertices: (n, 3), welded.
        faces: (k, 3).
        crease: rad.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    areas = np.cross(b - a, c - a)
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)
    corners, owner = faces.reshape(-1), np.repeat(np.arange(len(faces)), 3)
    row, column = _pairs(corners)
    own, other = owner[row], owner[column]
    near = np.einsum("ij,ij->i", units[own], units[other]) >= math.cos(crease)
    row, other = row[near], other[near]
    sums: Floats = np.stack(
        [np.bincount(row, areas[other, i], len(corners)) for i in range(3)], 1
    ).astype(float)  # an empty mesh would count in integers
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30)
    normals = np.rint(sums * NORMAL_STEPS).astype(np.int64)
    keys, index = np.unique(np.column_stack([corners, normals]), axis=0, return_inverse=True)
    return ShadedMesh(
        vertices=vertices[keys[:, 0]].astype(np.float32),
        normals=keys[:, 1:].astype(np.int8),
        faces=index.reshape(-1, 3).astype(np.uint32),
    )
