"""Obstacles on the floor: discs and half-planes, as linear bounds and as shapes among the links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import coal
import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.collision import (
    CollisionModel,
    CollisionShape,
    arm_joints,
    collision_model,
    standing,
)
from rpctl.robot.model import Robot

DETOUR_MARGIN = 0.01  # m: clearance of a detour from a disc, so that its bound is seldom active
COINCIDENT = 1e-6  # m: a point this near to a disc's centre has no direction away from it


class LinearBounds(NamedTuple):
    """Linear bounds on K points: normal · p ≥ level for each."""

    normal: Array  # (K, 2) unit vectors
    level: Array  # (K,) m


class Obstacle(Protocol):
    """A part of the floor that a round body must not enter."""

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to it, m; negative inside."""

    def linearise(self, points: Array, radius: float, stride: float = 0.0) -> LinearBounds:
        """Return half-planes in which every point is farther from it than ``radius``.

        Args:
            points: Predicted positions of the body (K, 2), m.
            radius: Radius of the body, m.
            stride: Distance between successive predictions, m; the body takes the chord.
        """

    def around(self, start: Array, goals: Array, radius: float) -> Array:
        """Return goals (K, 2), m, with those behind the obstacle replaced by a detour.

        Args:
            start: Position of the body (2,), m.
            goals: Desired positions (K, 2), m.
            radius: Radius of the body, m.
        """


@dataclass(frozen=True)
class Disc:
    """A round obstacle on the floor, of unlimited height, in the world's frame.

    Attributes:
        x: x of the centre, m.
        y: y of the centre, m.
        radius: Radius, m.

    Raises:
        RpctlError: The centre is not finite, or the radius is not positive.
    """

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        _require_finite("centre of a disc", self.x, self.y)
        require_positive("radius of a disc", self.radius)

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to the disc, m; negative inside."""
        return np.asarray(np.hypot(points[:, 0] - self.x, points[:, 1] - self.y) - self.radius)

    def linearise(self, points: Array, radius: float, stride: float = 0.0) -> LinearBounds:
        """Return the tangents at the points' side of the disc enlarged by ``radius``.

        The disc is enlarged a little more, so that a chord of length ``stride`` does not cut it.

        Args:
            points: Predicted positions of the body (K, 2), m.
            radius: Radius of the body, m.
            stride: Distance between successive predictions, m.
        """
        grown = math.hypot(self.radius + radius, 0.5 * stride)
        away = points - (self.x, self.y)
        angle = np.arctan2(away[:, 1], away[:, 0])
        normal = np.column_stack([np.cos(angle), np.sin(angle)])
        return LinearBounds(normal, grown + normal @ (self.x, self.y))

    def around(self, start: Array, goals: Array, radius: float) -> Array:
        """Return goals (K, 2), m, with those behind the disc turned about ``start`` to its tangent.

        Linear bounds alone would stop the body in front of a disc, because they choose no side. The
        side is the one on which the goals pass the centre, or, if they pass through it, the side of
        the body.

        Args:
            start: Position of the body (2,), m.
            goals: Desired positions (K, 2), m.
            radius: Radius of the body, m.
        """
        grown = self.radius + radius + DETOUR_MARGIN
        x, y = (self.x, self.y) - start
        ahead = goals - start
        gap, length = math.hypot(x, y), np.hypot(ahead[:, 0], ahead[:, 1])
        half = math.asin(min(grown / max(gap, COINCIDENT), 1.0))
        centre = math.atan2(y, x)
        off = np.remainder(np.arctan2(ahead[:, 1], ahead[:, 0]) - centre + math.pi, 2.0 * math.pi)
        off -= math.pi  # angle from the disc's centre to each goal, seen from the start
        inside = np.hypot(*(goals - (self.x, self.y)).T) < grown
        behind = (np.abs(off) < half) & (inside | (length > gap))
        if not behind.any():
            return goals
        turned = centre + self._side(start, goals) * half
        detour = start + length[:, None] * (math.cos(turned), math.sin(turned))
        return np.where(behind[:, None], detour, goals)

    def _side(self, start: Array, goals: Array) -> float:
        """Return 1.0 where goals pass the centre on their left, seen along them, else -1.0."""
        along = goals[-1] - goals[0]
        if np.hypot(*along) < COINCIDENT:
            along = goals[-1] - start
        for point in (goals[-1], start):
            left = along[1] * (self.x - point[0]) - along[0] * (self.y - point[1])
            if abs(left) > COINCIDENT * self.radius:
                return math.copysign(1.0, left)
        return 1.0


@dataclass(frozen=True)
class HalfPlane:
    """The floor beyond a straight line: a body must keep n · p ≥ offset, n the unit normal.

    Attributes:
        nx: x of a normal of the line, of any length, towards the free side, in the world's frame.
        ny: y of this normal.
        offset: Distance of the line from the origin along the normal, m.

    Raises:
        RpctlError: A number is not finite, or the normal is zero.
    """

    nx: float
    ny: float
    offset: float

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        _require_finite("half-plane", self.nx, self.ny, self.offset)
        require_positive("length of a half-plane's normal", math.hypot(self.nx, self.ny))

    @property
    def normal(self) -> Array:
        """Unit normal (2,) towards the free side."""
        return np.array([self.nx, self.ny]) / math.hypot(self.nx, self.ny)

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to the line, m; negative beyond."""
        return np.asarray(points @ self.normal - self.offset)

    def linearise(self, points: Array, radius: float, stride: float = 0.0) -> LinearBounds:
        """Return the line, moved by ``radius`` to the free side, for every point.

        Args:
            points: Predicted positions of the body (K, 2), m.
            radius: Radius of the body, m.
            stride: Not used.
        """
        count = len(points)
        return LinearBounds(np.tile(self.normal, (count, 1)), np.full(count, self.offset + radius))

    def around(self, start: Array, goals: Array, radius: float) -> Array:
        """Return the goals (K, 2) unchanged: a half-plane has no detour.

        Args:
            start: Not used.
            goals: Desired positions (K, 2), m.
            radius: Not used.
        """
        return goals


OBSTACLES: dict[str, type[Disc | HalfPlane]] = {"disc": Disc, "half-plane": HalfPlane}


def _require_finite(what: str, *values: float) -> None:
    if not all(map(math.isfinite, values)):
        raise RpctlError(f"{what} is {values}; give finite numbers")


HEIGHT_M = 1e3  # m: of an obstacle without end


def links_among(
    robot: Robot, base: Sequence[Disc | HalfPlane], tip: Sequence[Disc | HalfPlane]
) -> CollisionModel:
    """Return the shapes of a robot, the ground, and obstacles, in this order.

    What the base avoids no link may touch; what the end effector avoids no link of the arm may.

    Args:
        tip: Obstacles of the end effector; they come after the base's.
    """
    model = collision_model(robot)
    links, moved = model.shapes[:-1], arm_joints(robot)  # the last is the ground
    everything = list(range(len(links)))
    arm = [k for k in everything if links[k].joint in moved]
    against = [*([everything] * len(base)), *([arm] * len(tip))]
    return model.with_obstacles([_standing(each, robot) for each in (*base, *tip)], against)


def _standing(obstacle: Disc | HalfPlane, robot: Robot) -> CollisionShape:
    """Return an obstacle as a shape that stands in the world."""
    pose = np.eye(4)
    if isinstance(obstacle, Disc):
        pose[:3, 3] = obstacle.x, obstacle.y, robot.drive.ground
        return standing("disc", pose, coal.Cylinder(obstacle.radius, HEIGHT_M))
    normal = np.append(obstacle.normal, 0.0)
    pose[:3, 3] = obstacle.offset * normal
    return standing("half-plane", pose, coal.Halfspace(normal, 0.0))
