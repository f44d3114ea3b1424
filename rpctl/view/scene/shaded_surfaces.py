"""Surfaces as they are drawn: what a mesh file gives is simplified where it is read, confined."""

from __future__ import annotations

import numpy as np

from rpctl.description.mesh_files import Surface
from rpctl.description.mesh_paths import MeshError
from rpctl.description.mesh_service import ask
from rpctl.description.mesh_shading import ShadedMesh, shade, simplify
from rpctl.libraries import library

THINNEST = 0.01  # of a box's longest edge: a thinner one would have no volume
FARTHEST = 10.0  # of a mesh's reach: collapsed edges may leave its box
NOTHING_LEFT = "nothing is left of its triangles when they are simplified"


def shade_surface(surface: Surface, triangles: int, foreign: bool) -> tuple[ShadedMesh, str]:
    """Return a surface as it is drawn, and why it is its box instead, if it is.

    Args:
        surface: The triangles.
        triangles: About how many may be left.
        foreign: Whether a mesh file gives them: then the process that read it works on them.
    """
    if not foreign:
        return _shade(surface, triangles), ""
    try:
        shaded, fault = _shade_confined(surface, triangles), NOTHING_LEFT
    except MeshError as error:
        shaded, fault = None, str(error)
    if shaded is not None and len(shaded.faces):
        return shaded, ""
    return _shade(_box(surface), triangles), fault


def _shade(surface: Surface, triangles: int) -> ShadedMesh:
    return shade(*simplify(surface.vertices, surface.faces, triangles))


def _shade_confined(surface: Surface, triangles: int) -> ShadedMesh:
    """Return a surface as the confined process shades it.

    Raises:
        MeshError: It does not, or answers with what is no mesh.
    """
    arrays = [surface.vertices, surface.faces.astype("<u4")]
    answer = ask("shade", {"triangles": triangles}, arrays)[1]
    kinds = [each.dtype for each in answer], [each.shape[1:] for each in answer]
    if kinds != ([np.float32, np.int8, np.uint32], [(3,)] * 3):
        raise MeshError("its reader answered with no mesh")
    vertices, normals, faces = answer
    bound = float(np.abs(surface.vertices).max()) * FARTHEST
    inside = bool((np.abs(vertices) <= bound).all())
    if not inside or len(normals) != len(vertices) or (faces >= len(vertices)).any():
        raise MeshError("its reader answered with no mesh")
    return ShadedMesh(vertices, normals, faces)


def _box(surface: Surface) -> Surface:
    """Return the box around a surface."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    edges = np.maximum(high - low, THINNEST * (high - low).max())
    unit = float(edges.max())  # trimesh drops triangles that are tiny in its own unit
    box = library("trimesh.creation").box(edges / unit)
    return Surface(
        unit * np.asarray(box.vertices) + 0.5 * (low + high), np.asarray(box.faces), None
    )
