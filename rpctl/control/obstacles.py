"""Obstacles on the floor: discs to stay out of and half-planes to stay in, as linear bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from rpctl.description.records import Array
from rpctl.errors import RpctlError, require_positive

LEAN = 0.5  # of the way to the tangent: how far the line before a disc in the way is turned
NEAR = 1e-6  # m: a point this near to a disc's centre has no direction away from it


class Line(NamedTuple):
    """Linear bounds on K points: normal · p ≥ level for each."""

    normal: Array  # (K, 2) unit vectors
    level: Array  # (K,) m


class Obstacle(Protocol):
    """A part of the floor that a round body must not enter."""

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to it, m; negative inside."""

    def linearise(self, points: Array, goals: Array, radius: float) -> Line:
        """Return half-planes that hold no point nearer to it than ``radius`` (m).

        Args:
            points: Where the body is predicted to be (K, 2), m.
            goals: Where it should be (K, 2), m.
            radius: Of the body, m.
        """


@dataclass(frozen=True)
class Disc:
    """A round obstacle that stands on the floor, without end upwards.

    Attributes:
        x: Its centre, m.
        y: Its centre, m.
        radius: m.
    """

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        """Refuse what is no disc."""
        _require_finite("centre of a disc", self.x, self.y)
        require_positive("radius of a disc", self.radius)

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to the disc, m; negative inside."""
        return np.asarray(np.hypot(points[:, 0] - self.x, points[:, 1] - self.y) - self.radius)

    def linearise(self, points: Array, goals: Array, radius: float) -> Line:
        """Return tangents of the disc grown by ``radius``: none of them cuts into it.

        A tangent faces the predicted point. Where the disc lies between that point and its goal,
        it is turned towards the side of the goal, part of the way to the tangent through the point
        itself: an obstacle straight ahead would else only stop the robot.
        """
        grown = self.radius + radius
        away = points - (self.x, self.y)
        gap = np.maximum(np.hypot(away[:, 0], away[:, 1]), NEAR)
        angle = np.arctan2(away[:, 1], away[:, 0])
        ahead = goals - points
        length = np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), NEAR)
        along = ahead / length[:, None]
        nearest = -(away * along).sum(axis=1)  # way to the point nearest to the centre
        miss = away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0]
        blocked = (np.abs(miss) < grown) & (nearest > 0.0) & (nearest < length + grown)
        side = np.where(miss.sum() >= 0.0, 1.0, -1.0)  # one side for all, else the plan is torn
        lean = LEAN * np.arccos(np.minimum(grown / gap, 1.0))
        angle = angle + np.where(blocked, side * lean, 0.0)
        normal = np.column_stack([np.cos(angle), np.sin(angle)])
        return Line(normal, grown + normal @ (self.x, self.y))


@dataclass(frozen=True)
class HalfPlane:
    """The floor beyond a straight line: a body must keep nx x + ny y ≥ offset.

    Attributes:
        nx: Normal of the line, towards the free side.
        ny: Normal of the line.
        offset: Distance of the line from the origin along the unit normal, m.
    """

    nx: float
    ny: float
    offset: float

    def __post_init__(self) -> None:
        """Refuse what is no line."""
        _require_finite("half-plane", self.nx, self.ny, self.offset)
        require_positive("length of a half-plane's normal", math.hypot(self.nx, self.ny))

    @property
    def normal(self) -> Array:
        """Unit normal (2,) towards the free side."""
        return np.array([self.nx, self.ny]) / math.hypot(self.nx, self.ny)

    def distance(self, points: Array) -> Array:
        """Return the distance (K,) of points (K, 2) to the line, m; negative beyond."""
        return np.asarray(points @ self.normal - self.offset)

    def linearise(self, points: Array, goals: Array, radius: float) -> Line:
        """Return the line itself, ``radius`` before the edge, for every point."""
        count = len(points)
        return Line(np.tile(self.normal, (count, 1)), np.full(count, self.offset + radius))


def _require_finite(what: str, *values: float) -> None:
    if not all(map(math.isfinite, values)):
        raise RpctlError(f"{what} is {values}; give finite numbers")
