"""A robot on a slope: gravity is turned, the ground stays the plane z = 0."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rpctl.errors import RpctlError, require_within
from rpctl.robot.model import Robot

Slope = tuple[float, float]  # rad, by which the ground rises along x and along y


def require_slope(slope: Slope) -> None:
    """Refuse what is no slope of a ground.

    Raises:
        RpctlError: There are not two angles, or no plane rises so.
    """
    if len(slope) != 2:
        raise RpctlError(f"slope is {slope}; give the angles along x and along y, in rad")
    require_within("slope", slope, 0.5 * math.pi)
    if not sum(math.sin(angle) ** 2 for angle in slope) < 1.0:
        raise RpctlError(f"slope is {slope}; no ground rises so along x and y at once")


def on_slope(robot: Robot, slope: Slope) -> Robot:
    """Return a robot whose ground rises by given angles.

    A way of a metre along the ground's x axis leads sin(along x) m upwards, one along y likewise:
    the upward direction is (sin along x, sin along y, √(1 − ...)) in the frame of the ground.

    Args:
        robot: The robot on level ground.
        slope: Angles (2,), rad, along x and along y.

    Raises:
        RpctlError: They are none of a ground.
    """
    require_slope(slope)
    if not any(slope):
        return robot
    along = [math.sin(angle) for angle in slope]
    up = np.array([*along, math.sqrt(1.0 - sum(x * x for x in along))])
    model = robot.model.copy()
    model.gravity.linear = -float(np.linalg.norm(robot.model.gravity.linear)) * up
    return replace(robot, model=model)
