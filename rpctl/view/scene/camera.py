"""Placement of a fixed camera that has a whole motion in its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array

FIELD_OF_VIEW = 30.0  # degrees, top to bottom: long enough a lens that robots keep their shape
FILLED_RATIO = 0.9  # of the picture that the motion may fill
VIEW_DIRECTIONS = ((0.45, -1.0, 0.62), (1.0, 0.45, 0.62), (-0.45, -1.0, 0.62), (1.0, -0.45, 0.62))


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that is level.

    Attributes:
        eye: Where it is (3,), m.
        target: What it looks at (3,), m.
        depth: Distance between the two, m.
    """

    eye: Array
    target: Array
    depth: float


def fit_camera(points: Array, aspect: float) -> Camera:
    """Return the camera that sees all points from as near as it can.

    Args:
        points: What has to be in the picture (n, 3), m.
        aspect: Width of the picture over its height.
    """
    cameras = [_fit(points, aspect, np.array(direction)) for direction in VIEW_DIRECTIONS]
    return min(cameras, key=lambda camera: camera.depth)


def view_axes(direction: Array) -> Array:
    """Return right, up and backward (3, 3) of a level camera that is in a direction, not z."""
    back = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def _fit(points: Array, aspect: float, direction: Array) -> Camera:
    """Return the nearest camera in a direction.

    Along its axes a point (a, b, c) is in the picture where |a - a0| <= s (c0 - c), s the tangent
    of half the field of view; likewise for b. The least c0 follows from the extremes of a + s c
    and a - s c.
    """
    axes = view_axes(direction)
    seen = points @ axes.T  # (n, 3)
    tangent = FILLED_RATIO * np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    away, middle = [], []
    for along, s in ((seen[:, 0], tangent * aspect), (seen[:, 1], tangent)):
        high, low = (along + s * seen[:, 2]).max(), (along - s * seen[:, 2]).min()
        away.append((high - low) / (2.0 * s))
        middle.append(0.5 * (high + low))
    distance = max(away)
    depth = max(distance - 0.5 * float(seen[:, 2].max() + seen[:, 2].min()), 0.1)
    eye = np.array([*middle, distance]) @ axes
    return Camera(eye, eye - depth * axes[2], depth)
