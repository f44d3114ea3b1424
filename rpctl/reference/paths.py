"""Base paths with exact derivatives, and the time law that starts them softly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array


class PathPoint(NamedTuple):
    """A point of a path, and the direction of travel there.

    The direction is the twist by the path's parameter s: speed forward (m, negative where the
    robot drives backwards), speed to the left, turning (rad). A path in these terms may turn on
    the spot and may be run through at any pace, from standstill on, without a division by zero.
    """

    pose: Array  # (3,) x, y in m, heading in rad
    direction: Array  # (3, 3): the twist by s, and its first and second derivative by s


Path = Callable[[float], PathPoint]


def line(step: float = 1.0) -> Path:
    """Return a straight line along x; ``step`` m a unit of s, backwards where negative."""

    def at(s: float) -> PathPoint:
        return PathPoint(np.array([step * s, 0.0, 0.0]), _steady(step, 0.0))

    return at


def spin() -> Path:
    """Return a turn on the spot, one radian a unit of s."""

    def at(s: float) -> PathPoint:
        return PathPoint(np.array([0.0, 0.0, s]), _steady(0.0, 1.0))

    return at


def circle(radius: float = 1.0) -> Path:
    """Return a circle to the left of the start, one radian a unit of s; ``radius`` in m."""

    def at(s: float) -> PathPoint:
        pose = np.array([radius * math.sin(s), radius * (1.0 - math.cos(s)), s])
        return PathPoint(pose, _steady(radius, 1.0))

    return at


def eight(length: float = 1.5, width: float = 0.75) -> Path:
    """Return a figure-eight about the origin, one lap a 2π of s.

    x = length sin s, y = width sin 2s: ``length`` and ``width`` (m) are its half sizes, and the
    start is its crossing.
    """

    def at(s: float) -> PathPoint:
        sin, cos, sin2, cos2 = math.sin(s), math.cos(s), math.sin(2 * s), math.cos(2 * s)
        return planar(
            (length * sin, width * sin2),
            complex(length * cos, 2 * width * cos2),
            complex(-length * sin, -4 * width * sin2),
            complex(-length * cos, -8 * width * cos2),
            complex(length * sin, 16 * width * sin2),
        )

    return at


def scaled(path: Path, factor: float) -> Path:
    """Return a path ``factor`` times larger, by the same parameter."""
    if factor == 1.0:
        return path
    size = np.array([factor, factor, 1.0])

    def at(s: float) -> PathPoint:
        pose, direction = path(s)
        return PathPoint(pose * size, direction * size)

    return at


def planar(
    position: tuple[float, float], d1: complex, d2: complex, d3: complex, d4: complex
) -> PathPoint:
    """Return the point of a curve driven forward, heading along it.

    Args:
        position: x, y, m.
        d1: First derivative of x + iy by the curve's parameter, not zero.
        d2: Second derivative.
        d3: Third derivative.
        d4: Fourth derivative.
    """
    square, slope = abs(d1) ** 2, 2.0 * _dot(d1, d2)
    bend = 2.0 * (abs(d2) ** 2 + _dot(d1, d3))
    across, across_rate = _cross(d1, d2), _cross(d1, d3)
    across_bend = _cross(d2, d3) + _cross(d1, d4)
    speed = math.sqrt(square)
    speeds = (speed, 0.5 * slope / speed, 0.5 * bend / speed - 0.25 * slope**2 / speed**3)
    turn = across / square
    turn_rate = (across_rate - turn * slope) / square
    turn_bend = (across_bend - 2.0 * turn_rate * slope - turn * bend) / square
    direction = np.column_stack([speeds, np.zeros(3), (turn, turn_rate, turn_bend)])
    return PathPoint(np.array([*position, math.atan2(d1.imag, d1.real)]), direction)


def _steady(speed: float, turn: float) -> Array:
    """Return a direction (3, 3) that does not change along the path."""
    return np.array([[speed, 0.0, turn], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def _dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


def _cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


class PathTime(NamedTuple):
    """Path parameter at a time, and its first two derivatives by time."""

    s: float
    rate: float
    acceleration: float


def ramped_time(t: float, rate: float, ramp: float) -> PathTime:
    """Return s(t) whose rate rises from 0 to ``rate`` in ``ramp`` seconds, then stays.

    The rise is a quintic: rate, acceleration and jerk start and end at zero, so no effort jumps.

    Args:
        t: Time, s.
        rate: Final rate, 1/s.
        ramp: Duration of the rise, s; 0 for none.
    """
    if t >= ramp:
        return PathTime(rate * (t - 0.5 * ramp), rate, 0.0)
    u = t / ramp
    return PathTime(
        s=rate * ramp * u**4 * (2.5 + u * (u - 3.0)),
        rate=rate * u**3 * (10.0 + u * (6.0 * u - 15.0)),
        acceleration=rate / ramp * 30.0 * u**2 * (1.0 - u) ** 2,
    )
