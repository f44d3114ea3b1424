"""The obstacles of a run, read from the settings of its laws, and its clearance from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.registry import settings_of
from rpctl.simulation.config import Config
from rpctl.simulation.run.run import Run

BASE, TIP = "base", "tip"  # the body that avoids an obstacle, named as the scene's paths
OBSTACLE_SETTINGS = {"base_obstacles": BASE, "end_effector_obstacles": TIP}  # settings of laws
RADIUS_SETTINGS = {BASE: "base_radius", TIP: "end_effector_radius"}
NEGLIGIBLE = 1e-9  # of a normal: a component that a reader need not see


@dataclass(frozen=True)
class AvoidedObstacle:
    """An obstacle and the body that avoids it; two are equal if their shapes and bodies are.

    Attributes:
        body: Whose it is, ``BASE`` or ``TIP``.
        shape: The part of the floor.
        radius: Of the body, m.
    """

    body: str
    shape: Disc | HalfPlane
    radius: float = field(compare=False)

    def clearance(self, places: Array) -> Array:
        """Return how far a body at places (K, 2 or more), m, is from it (K,), m."""
        return np.asarray(self.shape.distance(places[:, :2]) - self.radius)


def run_obstacles(run: Run) -> tuple[AvoidedObstacle, ...]:
    """Return the obstacles of a run, each once."""
    points = np.array(run.ground.points).reshape(-1, 2) - run.robot.drive.point
    farthest = float(np.hypot(*points.T).max(initial=0.0))  # the base's radius, if none is set
    return find_obstacles(run.config, farthest)


def find_obstacles(config: Config, base_radius: float = 0.0) -> tuple[AvoidedObstacle, ...]:
    """Return the obstacles of a configuration's laws and of the laws within them, each once.

    Args:
        config: Of a run.
        base_radius: Of the base where the laws do not set it, m.

    Returns:
        Discs and half-planes; other shapes are left out.
    """
    found = []
    for body, shape, radius in (*law_obstacles(config.kinematic), *law_obstacles(config.dynamic)):
        if isinstance(shape, Disc | HalfPlane):
            radius = radius if isinstance(radius, float | int) else base_radius
            found.append(AvoidedObstacle(body, shape, radius))
    return tuple(dict.fromkeys(found))


def law_obstacles(law: object) -> Iterator[tuple[str, object, object]]:
    """Yield each obstacle of a law: the body that avoids it, its shape, and that body's radius."""
    settings = law if isinstance(law, Mapping) else settings_of(law)
    for key, value in settings.items():
        if key in OBSTACLE_SETTINGS and isinstance(value, tuple):
            body = OBSTACLE_SETTINGS[key]
            yield from ((body, shape, settings.get(RADIUS_SETTINGS[body])) for shape in value)
        else:
            yield from law_obstacles(value)


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


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")
