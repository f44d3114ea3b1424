"""Mesh files as triangles: no file is opened but the mesh, and an MTL beside an OBJ."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.description.mesh_paths import MeshError
from rpctl.files.caps import cap, how_to_raise
from rpctl.libraries import library

LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # how a file not yet fetched begins


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh of one colour.

    Attributes:
        vertices: (n, 3), m.
        faces: Corners of each triangle (k, 3).
        rgba: Colour that the file gives, each in [0, 1], or None.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    rgba: tuple[float, ...] | None


def read(path: Path) -> tuple[Surface, ...]:
    """Return the surfaces of a mesh file, one for each colour; textures are left out.

    Args:
        path: A file that ``resolve`` returned.

    Raises:
        MeshError: The file is too large, or holds no triangles that can be read.
    """
    most = cap("MAX_MESH_BYTES")
    if path.stat().st_size > most:
        raise MeshError(f"refused: larger than {most} bytes; {how_to_raise('MAX_MESH_BYTES')}")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MeshError(f"not readable: {error.strerror or error}") from None
    if content.startswith(LFS_POINTER):
        raise MeshError("only a pointer of Git LFS, not the mesh; run: git lfs pull")
    kind = path.suffix.lower().removeprefix(".")
    if kind == "dae" and any(mark in content for mark in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):
        raise MeshError("refused: a DAE with a document type or entities, or not in UTF-8")
    try:
        surfaces = _surfaces(_load(content, kind, path), kind)
    except Exception as error:  # readers of foreign formats fail in every way there is
        raise MeshError(f"not readable ({type(error).__name__})") from error
    if not surfaces:
        raise MeshError("holds no triangles")
    return surfaces


def _load(content: bytes, kind: str, path: Path) -> Any:
    library("trimesh")
    import trimesh

    class Materials(trimesh.resolvers.Resolver):
        """Colours of an OBJ from the MTL beside it; no other file is opened."""

        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            target = (path.parent / key).resolve()
            if target.suffix.lower() != ".mtl" or target.parent != path.parent:
                raise KeyError(key)
            if not target.is_file() or target.stat().st_size > cap("MAX_MESH_BYTES"):
                raise KeyError(key)
            return target.read_bytes()

        def write(self, name: str, data: Any) -> None:
            raise PermissionError(name)

        def namespaced(self, namespace: str) -> Materials:
            return self

        def keys(self) -> list[str]:
            return []

    quiet = trimesh.util.log  # it prints tracebacks of textures, which are left out
    before, quiet.disabled = quiet.disabled, True
    try:
        return trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=Materials())
    finally:
        quiet.disabled = before


def _surfaces(scene: Any, kind: str) -> tuple[Surface, ...]:
    """Return the triangles of a loaded scene, in metres, grouped by colour."""
    unit = _unit(scene) if kind == "dae" else 1.0
    groups: dict[tuple[float, ...] | None, list[tuple[Any, Any]]] = {}
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        mesh = scene.geometry[name]
        faces = getattr(mesh, "faces", None)
        if faces is None or not len(faces):
            continue
        vertices = unit * (np.asarray(mesh.vertices) @ pose[:3, :3].T + pose[:3, 3])
        if not np.isfinite(vertices).all():
            raise ValueError("vertices that are no numbers")
        groups.setdefault(_colour(mesh), []).append((vertices, np.asarray(faces)))
    return tuple(Surface(*_stack(pieces), rgba) for rgba, pieces in groups.items())


def _unit(scene: Any) -> float:
    """Return the length of a DAE's unit in m."""
    factor = str(scene.units or "").partition(" * ")[0]
    try:
        return float(factor)
    except ValueError:
        return 1.0


def _colour(mesh: Any) -> tuple[float, ...] | None:
    """Return a mesh's own colour, or None where the file gives none."""
    visual = mesh.visual
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    raw = visual.main_color if material is None else material.main_color
    red, green, blue = (round(float(value) / 255.0, 3) for value in raw[:3])
    return red, green, blue, 1.0


def _stack(pieces: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    counts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    vertices = np.concatenate([vertices for vertices, _ in pieces])
    faces = [faces + first for (_, faces), first in zip(pieces, counts[:-1], strict=True)]
    return vertices.astype(float), np.concatenate(faces).astype(np.int64)
