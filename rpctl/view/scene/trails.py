"""Trails of base and end effector in a scene: actual paths solid, desired ones dashed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rpctl.arrays import Array
from rpctl.view.palette import number_of
from rpctl.view.scene import threejs

Faces = NDArray[np.int64]
Mesh = tuple[Array, Faces]

TUBE_SIDES, LONG_TUBE_SIDES = 6, 4
LONG = 2000  # points of a path from which a tube has fewer sides
DASH_WIDTHS, GAP_WIDTHS = 7.0, 5.0  # in widths of the trail
MAX_DASHES = 1500  # of a path: laps of a long run that differ a little would be most of its page
NEAR_PERIODS = 2  # of dashes: what is nearer along the path is no other lap
LIFT_WIDTHS = 0.3  # of a trail's width that each lies above the one before: none hides another
MIN_STEP_M = 1e-9  # m: a shorter step has no direction


def trails_command(motions: Mapping[str, dict[str, Array]], lower: Array, upper: Array) -> bytes:
    """Return the command that draws the paths of motions, the desired ones dashed.

    A viewer that plays a motion shows the first part of its ``trail-base`` and ``trail-tip``. Of
    later motions a desired path that an earlier one had is left out.

    Args:
        motions: Paths (n, 3) by name, m: ``base``, ``tip`` and their ``-desired``; of each motion,
            by what the names of its nodes begin with.
        lower: Least coordinates of what the scene shows (3,), m.
        upper: Largest coordinates (3,), m.
    """
    width = trail_width(lower, upper)
    nodes: list[threejs.Json] = []
    known: dict[str, list[Array]] = {"base": [], "tip": []}
    for layer, (prefix, paths) in enumerate(motions.items()):
        for kind, shape, thick in (("base", ribbon, width), ("tip", tube, 0.55 * width)):
            lift = np.array([0.0, 0.0, LIFT_WIDTHS * width if kind == "base" else 0.0])
            desired = paths.get(f"{kind}-desired")
            if desired is not None and not any(
                len(other) >= len(desired) and np.allclose(other[: len(desired)], desired)
                for other in known[kind]
            ):  # an earlier motion's begins with it
                known[kind].append(desired)
                pieces = fresh_dashes(desired + lift, thick)
                mesh = join([shape(piece, 0.8 * thick) for piece in pieces])
                nodes += _trail(f"{prefix}trail-{kind}-desired", "desired", mesh)
            if kind in paths:
                mesh = shape(paths[kind] + (2 + layer) * lift, thick)
                nodes += _trail(f"{prefix}trail-{kind}", kind, mesh)
    return threejs.set_group("/rpctl/trails", "trails", nodes)


def _trail(name: str, colour: str, mesh: Mesh | None) -> list[threejs.Json]:
    """Return the node of a trail, whose material pages recolour; none of a path without length."""
    if mesh is None:
        return []
    shape = threejs.geometry({"position": threejs.attribute(mesh[0].astype(np.float32))}, mesh[1])
    paint = {"name": name, "type": "MeshBasicMaterial", "color": number_of(colour), "side": 2}
    look: threejs.Json = {"geometry": shape, "material": paint, "renderOrder": 3}
    return [threejs.node("Mesh", name, frustumCulled=False, **look)]


def trail_width(lower: Array, upper: Array) -> float:
    """Return the width of trails for a scene between two corners (3,), m."""
    return float(np.clip(0.006 * np.linalg.norm((upper - lower)[:2]), 0.006, 0.05))


def ribbon(path: Array, width: float) -> Mesh | None:
    """Return a level band along a path (n, 3), m; None for a path without length.

    The triangles follow the path in order, so a viewer can draw its first part only.
    """
    ahead = _directions(path * [1.0, 1.0, 0.0])
    if ahead is None:
        return None
    aside = 0.5 * width * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(path))])
    return np.stack([path + aside, path - aside], 1).reshape(-1, 3), strip(len(path), 2)


def tube(path: Array, width: float) -> Mesh | None:
    """Return a round tube along a path (n, 3), m; None for a path without length."""
    ahead = _directions(path)
    if ahead is None:
        return None
    normal = np.cross(ahead[0], np.eye(3)[np.argmin(np.abs(ahead[0]))])
    sides = TUBE_SIDES if len(path) < LONG else LONG_TUBE_SIDES
    rings = np.empty((len(path), sides, 3))
    angles = 2.0 * np.pi * np.arange(sides) / sides
    for k, tangent in enumerate(ahead):  # the frame is carried along, so that it never twists
        normal = normal - (normal @ tangent) * tangent
        length = np.linalg.norm(normal)
        normal = normal / length if length > MIN_STEP_M else np.cross(tangent, np.eye(3)[k % 3])
        rings[k] = path[k] + 0.5 * width * (
            np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), np.cross(tangent, normal))
        )
    return rings.reshape(-1, 3), strip(len(path), sides)


def dashes(path: Array, width: float) -> list[Array]:
    """Return the pieces (n, 3) of a path that its dashes cover."""
    along = _along(path)
    keep = np.concatenate([[True], np.diff(along) > MIN_STEP_M])
    along, path = along[keep], path[keep]
    pieces = []
    for start in np.arange(0.0, along[-1], (DASH_WIDTHS + GAP_WIDTHS) * width):
        end = min(start + DASH_WIDTHS * width, along[-1])
        inside = along[(along > start) & (along < end)]
        pieces.append(_between(path, along, np.concatenate([[start], inside, [end]])))
    return pieces


def fresh_dashes(path: Array, width: float) -> list[Array]:
    """Return the dashes (n, 3) of a path, but for those on a part that it went along before.

    Laps of a long run lie on one another: their dashes would fill the gaps and make up most of
    the report.

    Args:
        path: The path (n, 3), m.
        width: Of the trail, m.
    """
    pieces = dashes(path, width)
    if len(pieces) < 2:
        return pieces
    along = _along(path)
    tree = cKDTree(_between(path, along, np.arange(0.0, along[-1], width)))
    period = round(DASH_WIDTHS + GAP_WIDTHS)  # points of the tree from one dash to the next
    fresh = []
    for number, piece in enumerate(pieces):
        before = number * period - NEAR_PERIODS * period  # what is this dash's own neighbourhood
        middle = piece[len(piece) // 2]
        if not any(k < before for k in tree.query_ball_point(middle, 0.5 * width)):
            fresh.append(piece)
    return fresh[:MAX_DASHES]


def _along(path: Array) -> Array:
    """Return how far along a path each of its points lies (n,), m."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def _between(path: Array, along: Array, stops: Array) -> Array:
    """Return the points (k, 3) of a path at places (k,) along it, m."""
    return np.column_stack([np.interp(stops, along, path[:, i]) for i in range(3)])


def join(meshes: list[Mesh | None]) -> Mesh | None:
    """Return several meshes as one, or None where there is none."""
    found = [mesh for mesh in meshes if mesh is not None]
    if not found:
        return None
    first = np.cumsum([0] + [len(vertices) for vertices, _ in found])
    faces = [faces + n for (_, faces), n in zip(found, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in found]), np.concatenate(faces)


def _directions(path: Array) -> Array | None:
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
