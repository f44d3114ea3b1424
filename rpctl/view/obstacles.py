"""The obstacles of a run: titles, texts, and what of them a picture frames."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.unregistered import name_of
from rpctl.simulation.obstacles import BASE, TIP, AvoidedObstacle, law_obstacles, shape_text

OBSTACLE_TITLES = {BASE: "Base obstacles", TIP: "End-effector obstacles"}
RIM_POINTS = 96  # points of a disc's edge
NEAR_RATIO = 0.5  # of the diagonal of a motion: obstacles farther from it are not framed
NEAR_MIN_M = 0.5  # m: how far they are framed however small the motion is


def obstacle_texts(law: object) -> dict[str, str]:
    """Return the obstacles of a law and of laws within it as texts, by the body they are for."""
    texts_of: dict[str, list[str]] = {}
    for body, shape, _ in law_obstacles(law):
        text = shape_text(shape) if isinstance(shape, Disc | HalfPlane) else name_of(shape)
        texts_of.setdefault(OBSTACLE_TITLES[body], []).append(text)
    return {label: "; ".join(dict.fromkeys(texts)) for label, texts in texts_of.items()}


def rim(disc: Disc) -> Array:
    """Return the edge of a disc (RIM + 1, 2), closed, m."""
    turns = np.linspace(0.0, 2.0 * math.pi, RIM_POINTS + 1)
    return disc.radius * np.column_stack([np.cos(turns), np.sin(turns)]) + (disc.x, disc.y)


def rims(obstacles: Iterable[AvoidedObstacle]) -> Array:
    """Return the edges (n, 2) of all discs, m."""
    edges = [rim(o.shape) for o in obstacles if isinstance(o.shape, Disc)]
    return np.concatenate([np.empty((0, 2)), *edges])


def near(points: Array, lower: Array, upper: Array) -> Array:
    """Return the points (n, 2) near enough to a motion to be included in its picture, m.

    Args:
        points: Of obstacles, m.
        lower: Least coordinates of the motion (2,) or more, m.
        upper: Its largest coordinates, m.
    """
    low, high = lower[:2], upper[:2]
    reach = max(NEAR_RATIO * float(np.hypot(*(high - low))), NEAR_MIN_M)
    return points[((points > low - reach) & (points < high + reach)).all(axis=1)]
