"""What is drawn around the robot: trails, dashed or solid, and the ground's grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]
Mesh = tuple[Floats, Faces]

TUBE_SIDES = 6
DASH_WIDTHS, GAP_WIDTHS = 7.0, 5.0  # in widths of the trail
GRID_PIECES = 16  # each line fades out in so many steps
MIN_STEP_M = 1e-9  # m: a shorter step has no direction


def ribbon(path: Floats, width: float) -> Mesh | None:
    """Return a level band along a path (n, 3), m; None where the path goes nowhere.

    Each step of the path is two triangles, in order, so that a part of them is a part of the way.
    """
    ahead = _directions(path * [1.0, 1.0, 0.0])
    if ahead is None:
        return None
    aside = 0.5 * width * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(path))])
    return np.stack([path + aside, path - aside], 1).reshape(-1, 3), strip(len(path), 2)


def tube(path: Floats, width: float) -> Mesh | None:
    """Return a round tube along a path (n, 3), m; None where the path goes nowhere."""
    ahead = _directions(path)
    if ahead is None:
        return None
    normal = np.cross(ahead[0], np.eye(3)[np.argmin(np.abs(ahead[0]))])
    rings = np.empty((len(path), TUBE_SIDES, 3))
    angles = 2.0 * np.pi * np.arange(TUBE_SIDES) / TUBE_SIDES
    for k, tangent in enumerate(ahead):  # the frame is carried along, so that it never twists
        normal = normal - (normal @ tangent) * tangent
        length = np.linalg.norm(normal)
        normal = normal / length if length > MIN_STEP_M else np.cross(tangent, np.eye(3)[k % 3])
        binormal = np.cross(tangent, normal)
        rings[k] = path[k] + 0.5 * width * (
            np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal)
        )
    return rings.reshape(-1, 3), strip(len(path), TUBE_SIDES)


def dashes(path: Floats, width: float) -> list[Floats]:
    """Return the pieces (n, 3) of a path that its dashes cover."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    keep = np.concatenate([[True], lengths > MIN_STEP_M])
    along, path = along[keep], path[keep]
    period = (DASH_WIDTHS + GAP_WIDTHS) * width
    starts = np.arange(0.0, along[-1], period)
    pieces = []
    for start in starts:
        end = min(start + DASH_WIDTHS * width, along[-1])
        inside = along[(along > start) & (along < end)]
        stops = np.concatenate([[start], inside, [end]])
        pieces.append(np.column_stack([np.interp(stops, along, path[:, i]) for i in range(3)]))
    return pieces


def join(meshes: list[Mesh | None]) -> Mesh | None:
    """Return several meshes as one, or None where there is none."""
    found = [mesh for mesh in meshes if mesh is not None]
    if not found:
        return None
    first = np.cumsum([0] + [len(vertices) for vertices, _ in found])
    vertices = np.concatenate([vertices for vertices, _ in found])
    faces = [faces + n for (_, faces), n in zip(found, first[:-1], strict=True)]
    return vertices, np.concatenate(faces)


def grid(centre: Floats, radius: float, step: float, height: float) -> tuple[Floats, Floats]:
    """Return line ends (n, 3), m, and their opacity (n,): lines that fade out at ``radius``."""
    count = int(np.ceil(radius / step))
    offsets = step * np.arange(-count, count + 1)
    stops = np.linspace(-count * step, count * step, 2 * GRID_PIECES + 1)
    ends = np.column_stack([stops[:-1], stops[1:]]).reshape(-1)
    origin = np.round(np.asarray(centre[:2]) / step) * step  # lines stay on multiples of the step
    across, along = np.repeat(offsets, len(ends)), np.tile(ends, len(offsets))
    flat = np.concatenate([np.column_stack([across, along]), np.column_stack([along, across])])
    distance = np.linalg.norm(flat, axis=1) / (count * step)
    opacity = np.clip(1.0 - distance, 0.0, 1.0) ** 1.2
    points = np.column_stack([flat + origin, np.full(len(flat), height)])
    visible = opacity.reshape(-1, 2).max(axis=1).repeat(2) > 0.0
    return points[visible], opacity[visible]


def _directions(path: Floats) -> Floats | None:
    """Return unit tangents (n, 3); where a path stands still it keeps the last one."""
    if len(path) < 2:
        return None
    steps = np.gradient(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(lengths > MIN_STEP_M)
    if not len(moving):
        return None
    last = moving[np.maximum(np.searchsorted(moving, np.arange(len(path)), side="right") - 1, 0)]
    return np.asarray(steps[last] / lengths[last, None])


def strip(rings: int, sides: int) -> Faces:
    """Return the triangles between neighbouring rings; a ring of two sides is a band."""
    first = sides * np.arange(rings - 1)[:, None]
    around = np.arange(1 if sides == 2 else sides)[None, :]
    a, b = first + around, first + (around + 1) % sides
    c, d = a + sides, b + sides
    return np.stack([a, b, c, b, d, c], -1).reshape(-1, 3)
