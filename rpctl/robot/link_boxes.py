"""Boxes that stand for the links of a robot: where they are, roughly, without reading a mesh."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.records import Description, Shape
from rpctl.robot.model import Robot

SPACING = 0.1  # m, at most, between points of a box
CELL = 0.04  # m; of the points in a cell of this edge one is enough
MAX_POINTS = 4  # along an edge
THIN = 0.015  # m; a box of half this edge has one layer of points
SMALL = 0.02  # m; a box of half these edges is no obstacle
MIN_EXTENT = 0.05  # m; how far any link reaches about its centre of mass


class LinkBoxes:
    """Boxes about some links, as functions of the joints' poses."""

    def __init__(self, robot: Robot, links: Iterable[str], grow: float) -> None:
        """See the class.

        Args:
            links: Names of the links; small boxes are left out.
            grow: How far the boxes reach beyond the links, m.
        """
        groups: dict[int, list[tuple[Array, Array]]] = {}
        for name in links:
            joint, pose = _on_joint(robot, name)
            for origin, half in link_boxes(robot.description, name):
                if half.max() > SMALL:
                    groups.setdefault(joint, []).append((pose @ origin, half + grow))
        self._groups = [(joint, *_stacked(boxes)) for joint, boxes in groups.items()]

    def depth(self, data: pin.Data, points: Array) -> float:
        """Return how deep the deepest of some points is in one of the boxes, m; at least 0.

        Args:
            points: In the world (k, 3), m.
        """
        deepest = 0.0
        for joint, turn, offset, halves in self._groups:
            pose = data.oMi[joint]
            local = (points - pose.translation) @ pose.rotation
            inside = halves - np.abs(local @ turn - offset)  # (k, 3 n): each box's x, y and z
            nearest = np.minimum(np.minimum(inside[:, ::3], inside[:, 1::3]), inside[:, 2::3])
            deepest = max(deepest, float(nearest.max()))
        return deepest


def _stacked(boxes: list[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Return the axes (3, 3 n), places along them (3 n,) and half edges (3 n,) of boxes."""
    poses = np.array([pose for pose, _ in boxes])
    halves = np.array([half for _, half in boxes])
    axes = poses[:, :3, :3]
    offset = np.einsum("nij,ni->nj", axes, poses[:, :3, 3])
    return np.moveaxis(axes, 0, 1).reshape(3, -1), offset.reshape(-1), halves.reshape(-1)


def link_boxes(description: Description, name: str) -> list[tuple[Array, Array]]:
    """Return boxes about a link: pose in its frame (4, 4) and half its edges (3,), m.

    Collision shapes count, else visual ones. For meshes stands the box of the link's inertia: a
    solid one of its mass and its moments, no larger than what joints and mass tell of the link.
    """
    link = description.link[name]
    shapes = link.collisions or link.visuals
    boxes = [(s.origin, _half_edges(s)) for s in shapes if s.kind != "mesh"]
    if link.mass and len(boxes) < len(shapes):
        boxes.append(mass_box(description, name))
    return boxes


def mass_box(description: Description, name: str) -> tuple[Array, Array]:
    """Return the solid box of a link's inertia, no larger than what joints and mass tell of it.

    Args:
        name: The link, which has a mass.

    Returns:
        Its pose in the link's frame (4, 4) and half its edges (3,), m.
    """
    link = description.link[name]
    ends = [joint.origin[:3, 3] - link.com for joint in description.child_joints[name]]
    extent = max(MIN_EXTENT, *(float(np.linalg.norm(end)) for end in (link.com, *ends)))
    moments, axes = np.linalg.eigh(link.inertia)
    squares = 6.0 / float(link.mass or 0.0) * (moments.sum() - 2.0 * moments)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes, link.com
    return pose, np.minimum(0.5 * np.sqrt(np.maximum(0.0, squares)), extent)


def _half_edges(shape: Shape) -> Array:
    """Return half the edges (3,) of the box about a shape that is no mesh, m."""
    size = shape.size
    if shape.kind == "box":
        return 0.5 * np.array(size)
    radius = size[0]
    half_length = 0.5 * size[1] if len(size) > 1 else radius
    return np.array([radius, radius, half_length + radius * (shape.kind == "capsule")])


class LinkPoints:
    """Points of some links' boxes, with their origins, as functions of the joints' poses."""

    def __init__(self, robot: Robot, links: Iterable[str]) -> None:
        groups: dict[int, list[Array]] = {}
        for name in links:
            joint, pose = _on_joint(robot, name)
            groups.setdefault(joint, []).append(pose[None, :3, 3])
            for origin, half in link_boxes(robot.description, name):
                place = pose @ origin
                groups[joint].append(_grid(half) @ place[:3, :3].T + place[:3, 3])
        self._groups = [(joint, _thinned(np.vstack(points))) for joint, points in groups.items()]

    def __call__(self, data: pin.Data) -> Array:
        """Return the points (k, 3) in the world, m, for the joints' poses in ``data``."""
        if not self._groups:
            return np.empty((0, 3))
        return np.vstack(
            [
                points @ data.oMi[joint].rotation.T + data.oMi[joint].translation
                for joint, points in self._groups
            ]
        )


def _on_joint(robot: Robot, link: str) -> tuple[int, Array]:
    """Return the joint of the model that moves a link and the link's pose there (4, 4)."""
    frame = robot.frame(link)
    return int(frame.parentJoint), np.asarray(frame.placement.homogeneous)


def _thinned(points: Array) -> Array:
    """Return one of the points (k, 3) for each small cell that holds any."""
    cells = np.unique(np.round(points / CELL), axis=0, return_index=True)[1]
    return points[np.sort(cells)]


def _grid(half: Array) -> Array:
    """Return points (k, 3) all over a box of these half edges (3,), m."""
    counts = [1 if h < THIN else min(MAX_POINTS, 2 + int(2.0 * h / SPACING)) for h in half]
    ends = half * (np.array(counts) > 1)
    lines = [np.linspace(-end, end, count) for end, count in zip(ends, counts, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
