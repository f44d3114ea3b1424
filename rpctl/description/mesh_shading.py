"""Meshes for display: fewer triangles, and normals that keep sharp edges sharp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]

CREASE_RAD = math.radians(35.0)  # faces that meet at a larger angle keep an edge between them
NORMAL_STEPS = 127  # normals are told apart, and sent, in signed bytes
MAX_FAN = 64  # corners at a vertex; where more meet, as in a disc's middle, each keeps its face's


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
        count: Number of triangles aimed at.
    """
    vertices, faces = weld(vertices, faces)
    if len(faces) <= count:
        return vertices, faces
    import fast_simplification

    points, triangles = fast_simplification.simplify(
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
