"""The obstacles of a run: read from its settings, and described in words."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import OBSTACLES, Disc, HalfPlane
from rpctl.simulation.run import Run

BASE, TIP = "base", "tip"  # the body that avoids an obstacle, named as the scene's paths
OBSTACLE_SETTINGS = {"base_obstacles": BASE, "end_effector_obstacles": TIP}  # settings of laws
RADIUS_SETTINGS = {BASE: "base_radius", TIP: "end_effector_radius"}
OBSTACLE_TITLES = {BASE: "Base obstacles", TIP: "End-effector obstacles"}
SHAPE_CLASSES = {
    kind.__name__: kind for kind in OBSTACLES.values()
}  # as a run's settings name them
RIM_POINTS = 96  # points of a disc's edge
NEAR_RATIO = 0.5  # of the diagonal of a motion: obstacles farther from it are not framed
NEAR_MIN_M = 0.5  # m: how far they are framed however small the motion is
NEGLIGIBLE = 1e-9  # of a normal: a component that a reader need not see


@dataclass(frozen=True)
class DrawnObstacle:
    """An obstacle as drawn; two are equal if their shapes and bodies are.

    Attributes:
        body: Whose it is, ``BASE`` or ``TIP``.
        shape: The part of the floor.
        radius: Of the body, m.
    """

    body: str
    shape: Disc | HalfPlane
    radius: float = field(compare=False)


def run_obstacles(run: Run) -> tuple[DrawnObstacle, ...]:
    """Return the obstacles of a run, each once."""
    points = np.array(run.ground.points).reshape(-1, 2) - run.robot.drive.point
    farthest = float(np.hypot(*points.T).max(initial=0.0))  # the base's radius, if none is set
    return find_obstacles(run.settings, farthest)


def find_obstacles(
    settings: Mapping[str, Any], base_radius: float = 0.0
) -> tuple[DrawnObstacle, ...]:
    """Return the obstacles that settings hold at any depth, each once.

    Args:
        settings: Of a run, or the description of a law.
        base_radius: Of the base where they do not set it, m.

    Returns:
        Discs and half-planes; a shape of somebody's own cannot be drawn, and is left out.
    """
    found = []
    for body, table, law in _tables(settings):
        shape = _shape(table)
        if shape is not None:
            radius = law.get(RADIUS_SETTINGS[body])
            found.append(DrawnObstacle(body, shape, base_radius if radius is None else radius))
    return tuple(dict.fromkeys(found))


def obstacle_texts(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return the obstacles in settings as texts, by the body that avoids them."""
    texts_of: dict[str, list[str]] = {}
    for body, table, _ in _tables(settings):
        shape = _shape(table)
        texts_of.setdefault(OBSTACLE_TITLES[body], []).append(
            str(table.get("law")) if shape is None else shape_text(shape)
        )
    return {label: "; ".join(dict.fromkeys(texts)) for label, texts in texts_of.items()}


def shape_text(shape: Disc | HalfPlane) -> str:
    """Return a shape in words."""
    if isinstance(shape, Disc):
        place = f"({_number(shape.x)}, {_number(shape.y)})"
        return f"disc at {place} m, radius {_number(shape.radius)} m"
    parts = [(n, name) for n, name in zip(shape.normal, "xy", strict=True) if abs(n) > NEGLIGIBLE]
    if len(parts) == 1:
        ((sign, name),) = parts
        side = "≥" if sign > 0.0 else "≤"
        return f"half-plane, free where {name} {side} {_number(sign * shape.offset)} m"
    (nx, _), (ny, _) = parts
    left = f"{_number(nx)} x {'−' if ny < 0.0 else '+'} {_number(abs(ny))} y"
    return f"half-plane, free where {left} ≥ {_number(shape.offset)} m"


def rim(disc: Disc) -> Array:
    """Return the edge of a disc (RIM + 1, 2), closed, m."""
    turns = np.linspace(0.0, 2.0 * math.pi, RIM_POINTS + 1)
    return disc.radius * np.column_stack([np.cos(turns), np.sin(turns)]) + (disc.x, disc.y)


def rims(obstacles: Iterable[DrawnObstacle]) -> Array:
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


ObstacleTables = Iterator[tuple[str, Mapping[str, Any], Mapping[str, Any]]]


def _tables(settings: Mapping[str, Any]) -> ObstacleTables:
    """Yield the body that avoids each obstacle, its table, and the table of the law that has it."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _tables(value)
        elif key in OBSTACLE_SETTINGS and isinstance(value, list):
            yield from (
                (OBSTACLE_SETTINGS[key], each, settings)
                for each in value
                if isinstance(each, Mapping)
            )


def _shape(table: Mapping[str, Any]) -> Disc | HalfPlane | None:
    """Return the shape of an obstacle's table, or None where its class is a user's own."""
    kind = SHAPE_CLASSES.get(str(table.get("law")))
    given = {key: value for key, value in table.items() if key != "law"}
    if kind is None or given.keys() != {item.name for item in dataclasses.fields(kind)}:
        return None
    return kind(**given)


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")
