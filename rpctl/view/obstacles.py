"""The obstacles of a run: read from its settings, and described in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.unregistered import name_of, settings_of
from rpctl.simulation.config import Config
from rpctl.simulation.run import Run

BASE, TIP = "base", "tip"  # the body that avoids an obstacle, named as the scene's paths
OBSTACLE_SETTINGS = {"base_obstacles": BASE, "end_effector_obstacles": TIP}  # settings of laws
RADIUS_SETTINGS = {BASE: "base_radius", TIP: "end_effector_radius"}
OBSTACLE_TITLES = {BASE: "Base obstacles", TIP: "End-effector obstacles"}
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
    return find_obstacles(run.config, farthest)


def find_obstacles(config: Config, base_radius: float = 0.0) -> tuple[DrawnObstacle, ...]:
    """Return the obstacles of a configuration's laws and of the laws within them, each once.

    Args:
        config: Of a run.
        base_radius: Of the base where the laws do not set it, m.

    Returns:
        Discs and half-planes; other shapes cannot be drawn and are left out.
    """
    found = []
    for body, shape, radius in (*_obstacles(config.kinematic), *_obstacles(config.dynamic)):
        if isinstance(shape, Disc | HalfPlane):
            radius = radius if isinstance(radius, float | int) else base_radius
            found.append(DrawnObstacle(body, shape, radius))
    return tuple(dict.fromkeys(found))


def obstacle_texts(law: object) -> dict[str, str]:
    """Return the obstacles of a law and of laws within it as texts, by the body they are for."""
    texts_of: dict[str, list[str]] = {}
    for body, shape, _ in _obstacles(law):
        text = shape_text(shape) if isinstance(shape, Disc | HalfPlane) else name_of(shape)
        texts_of.setdefault(OBSTACLE_TITLES[body], []).append(text)
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


def _obstacles(law: object) -> Iterator[tuple[str, object, object]]:
    """Yield each obstacle of a law: the body that avoids it, its shape, and that body's radius."""
    settings = law if isinstance(law, Mapping) else settings_of(law)
    for key, value in settings.items():
        if key in OBSTACLE_SETTINGS and isinstance(value, tuple):
            body = OBSTACLE_SETTINGS[key]
            yield from ((body, shape, settings.get(RADIUS_SETTINGS[body])) for shape in value)
        else:
            yield from _obstacles(value)


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")
