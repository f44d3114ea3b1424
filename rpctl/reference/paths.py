"""Base paths with exact derivatives, and the clock that sets them in motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpctl.description.records import Array


class PathPoint(NamedTuple):
    """A point of a path and its derivatives by the path's parameter s.

    The speed is signed: negative where the robot drives backwards. A path in these terms may turn
    on the spot and may be run through at any pace, from standstill on, without a division by zero.
    """

    pose: Array  # (3,) x, y in m, heading in rad
    speed: float  # forward travel by s, m
    speed_rate: float  # its derivative by s
    turn: float  # turning by s, rad
    turn_rate: float  # its derivative by s


Path = Callable[[float], PathPoint]


def line(step: float = 1.0) -> Path:
    """Return a straight line along x; ``step`` m a unit of s, backwards where negative."""

    def at(s: float) -> PathPoint:
        return PathPoint(np.array([step * s, 0.0, 0.0]), step, 0.0, 0.0, 0.0)

    return at


def spin() -> Path:
    """Return a turn on the spot, one radian a unit of s."""

    def at(s: float) -> PathPoint:
        return PathPoint(np.array([0.0, 0.0, s]), 0.0, 0.0, 1.0, 0.0)

    return at


def circle(radius: float = 1.0) -> Path:
    """Return a circle to the left of the start, one radian a unit of s; ``radius`` in m."""

    def at(s: float) -> PathPoint:
        pose = np.array([radius * math.sin(s), radius * (1.0 - math.cos(s)), s])
        return PathPoint(pose, radius, 0.0, 1.0, 0.0)

    return at


def eight(length: float = 1.5, width: float = 0.75) -> Path:
    """Return a figure-eight about the origin, one lap a 2π of s.

    x = length sin s, y = width sin 2s: ``length`` and ``width`` (m) are its half sizes, and the
    start is its crossing.
    """

    def at(s: float) -> PathPoint:
        sin, cos, sin2, cos2 = math.sin(s), math.cos(s), math.sin(2 * s), math.cos(2 * s)
        return _planar(
            (length * sin, width * sin2),
            (length * cos, 2 * width * cos2),
            (-length * sin, -4 * width * sin2),
            (-length * cos, -8 * width * cos2),
        )

    return at


Pair = tuple[float, float]


def _planar(p: Pair, d1: Pair, d2: Pair, d3: Pair) -> PathPoint:
    """Return the point of a curve driven forward, from its position and three derivatives."""
    square = d1[0] ** 2 + d1[1] ** 2
    speed = math.sqrt(square)
    along = d1[0] * d2[0] + d1[1] * d2[1]
    across = d1[0] * d2[1] - d1[1] * d2[0]
    across_rate = d1[0] * d3[1] - d1[1] * d3[0]
    pose = np.array([p[0], p[1], math.atan2(d1[1], d1[0])])
    turn = across / square
    turn_rate = across_rate / square - 2.0 * turn * along / square
    return PathPoint(pose, speed, along / speed, turn, turn_rate)


class Tick(NamedTuple):
    """Path parameter at a time, and its first two derivatives by time."""

    s: float
    rate: float
    acceleration: float


def soft_clock(t: float, rate: float, ramp: float) -> Tick:
    """Return s(t) whose rate rises from 0 to ``rate`` in ``ramp`` seconds, then stays.

    The rise is a quintic: rate, acceleration and jerk start and end at zero, so no effort jumps.

    Args:
        t: Time, s.
        rate: Final rate, 1/s.
        ramp: Duration of the rise, s; 0 for none.
    """
    if t >= ramp:
        return Tick(rate * (t - 0.5 * ramp), rate, 0.0)
    u = t / ramp
    return Tick(
        s=rate * ramp * u**4 * (2.5 + u * (u - 3.0)),
        rate=rate * u**3 * (10.0 + u * (6.0 * u - 15.0)),
        acceleration=rate / ramp * 30.0 * u**2 * (1.0 - u) ** 2,
    )
