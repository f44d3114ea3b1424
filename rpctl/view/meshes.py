"""Mesh files: found where the URDF points, and only below the folders that it may use."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.errors import RpctlError

EXTENSIONS = (".stl", ".dae", ".obj", ".ply", ".glb")
MAX_BYTES = 256 * 2**20  # no robot's part is larger; a file that is would exhaust the memory
PACKAGE = "package://"


class MeshError(RpctlError):
    """A mesh that was refused, was not found, or could not be read."""


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


def resolve(name: str, urdf: Path) -> Path:
    """Return the file that a URDF names.

    The file, symlinks followed, lies in the URDF's folder, below the nearest ancestor that holds
    a ``package.xml``, or in the package that ``package://`` names.

    Args:
        name: ``package://NAME/rest``, or a path from the URDF's folder.
        urdf: The URDF.

    Raises:
        MeshError: The name is refused, or there is no such file.
    """
    roots = [urdf.parent, *_enclosing_package(urdf)]
    if name.startswith(PACKAGE):
        package, _, rest = name.removeprefix(PACKAGE).partition("/")
        folders = _package_folders(package, urdf)
        if not folders:
            raise MeshError(f'package "{package}" was not found; add it to ROS_PACKAGE_PATH')
        candidates = [(folder / rest, [folder]) for folder in folders]
    elif ":" in name:
        raise MeshError("refused: only package:// and paths from the URDF's folder are read")
    else:
        candidates = [(urdf.parent / name, roots)]
    confined = [path for path, allowed in candidates if _inside(path, allowed)]
    if not confined:
        raise MeshError("refused: it lies outside the folders that the URDF may use")
    if confined[0].suffix.lower() not in EXTENSIONS:
        raise MeshError(f"refused: a mesh ends in {', '.join(EXTENSIONS)}")
    for path in confined:
        if path.is_file():
            return path.resolve()
    raise MeshError("no such file")


def _enclosing_package(urdf: Path) -> list[Path]:
    return [folder for folder in urdf.parents if (folder / "package.xml").is_file()][:1]


def _package_folders(package: str, urdf: Path) -> list[Path]:
    """Return the folders that a package name may mean, the nearest to the URDF first."""
    if package in ("", ".", ".."):
        raise MeshError("refused: package:// without the name of a package")
    folders = []
    for folder in urdf.absolute().parents:
        if folder == folder.parent:  # the whole disk is no package, nor are its top folders
            break
        folders += [folder] * (folder.name == package) + [folder / package]
    for entry in _search_path("ROS_PACKAGE_PATH"):
        folders += [entry] * (entry.name == package) + [entry / package]
    folders += [entry / "share" / package for entry in _search_path("AMENT_PREFIX_PATH")]
    return [folder for folder in folders if folder.is_dir()]


def _search_path(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _inside(path: Path, roots: list[Path]) -> bool:
    target = path.resolve()
    return any(target.is_relative_to(root.resolve()) for root in roots)


def read(path: Path) -> tuple[Surface, ...]:
    """Return the surfaces of a mesh file, one for each colour; textures are left out.

    Args:
        path: A file that ``resolve`` returned.

    Raises:
        MeshError: The file is too large, or holds no triangles that can be read.
    """
    if path.stat().st_size > MAX_BYTES:
        raise MeshError(f"refused: larger than {MAX_BYTES // 2**20} MB")
    content = path.read_bytes()
    kind = path.suffix.lower().removeprefix(".")
    if kind == "dae" and (b"<!DOCTYPE" in content or b"<!ENTITY" in content):
        raise MeshError("refused: a DAE with a document type or entities")
    try:
        surfaces = _surfaces(_load(content, kind, path), kind)
    except Exception as error:  # readers of foreign formats fail in every way there is
        raise MeshError(f"not readable ({type(error).__name__})") from error
    if not surfaces:
        raise MeshError("holds no triangles")
    return surfaces


def _load(content: bytes, kind: str, path: Path) -> Any:
    import trimesh

    class Materials(trimesh.resolvers.Resolver):
        """Colours of an OBJ from the MTL beside it; no other file is opened."""

        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            target = (path.parent / key).resolve()
            if target.suffix.lower() != ".mtl" or target.parent != path.parent:
                raise KeyError(key)
            if not target.is_file() or target.stat().st_size > MAX_BYTES:
                raise KeyError(key)
            return target.read_bytes()

        def write(self, name: str, data: Any) -> None:
            raise PermissionError(name)

        def namespaced(self, namespace: str) -> Materials:
            return self

        def keys(self) -> list[str]:
            return []

    return trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=Materials())


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
