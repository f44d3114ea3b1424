"""Convex hulls of meshes, computed in a confined process as meshes are read in one."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.description.mesh_files import Surface
from rpctl.description.mesh_paths import MeshError
from rpctl.description.mesh_service import ask

KEPT_HULLS = 256  # hulls that are not computed again; a robot has 40 meshes


class Hull(NamedTuple):
    """A convex body with triangles for faces."""

    vertices: Array  # (n, 3) m, read-only
    faces: NDArray[np.int64]  # (k, 3) read-only


_KEPT: OrderedDict[bytes, Hull] = OrderedDict()


def convex_hull(surfaces: Sequence[Surface], scale: Sequence[float]) -> Hull:
    """Return the convex hull of the surfaces of a mesh.

    Args:
        surfaces: Of the mesh.
        scale: By which each axis is multiplied (3,).

    Raises:
        MeshError: It is flat, or there is no process to compute it.
    """
    points = np.unique(np.concatenate([s.vertices for s in surfaces]), axis=0) * np.array(scale)
    key = hashlib.sha256(points.tobytes()).digest()
    if key not in _KEPT:
        _KEPT[key] = _checked(points, ask("hull", {}, [points])[1])
        while len(_KEPT) > KEPT_HULLS:
            _KEPT.popitem(last=False)
    return _KEPT[key]


def _checked(points: Array, answer: Sequence[NDArray[np.generic]]) -> Hull:
    """Return the hull of points (n, 3) from the answer: corners (k, 3), as numbers of points.

    Raises:
        MeshError: The answer is no such thing.
    """
    corners = np.array(answer[0]) if len(answer) == 1 else np.empty(0)
    if corners.dtype != np.uint32 or corners.shape[1:] != (3,) or not len(corners):
        raise MeshError("its reader answered with no hull")
    if corners.max() >= len(points):
        raise MeshError("its reader answered with no hull")
    used, faces = np.unique(corners.astype(np.int64), return_inverse=True)
    hull = Hull(points[used], faces.reshape(-1, 3))
    for array in hull:
        array.setflags(write=False)
    return hull
