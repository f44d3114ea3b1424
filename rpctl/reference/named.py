"""The references that have a name: line, reverse, spin, circle and eight."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference import paths
from rpctl.reference.limits import steerable_radius
from rpctl.reference.motion import ReferenceState
from rpctl.reference.waves import Waves, waves
from rpctl.robot.model import Robot

RAMP_TIME = 3.0  # s
LAP_TIME = 20.0  # s; a closed path is run through once in this time, soft start included
LAP_RATE = 2.0 * math.pi / (LAP_TIME - 0.5 * RAMP_TIME)
LINE_RATE = 0.3  # m/s
CURVATURE_SAMPLES = 101  # points at which a path's curvature is evaluated

# Name: path, and its pace at full speed.
BASE_PATHS: dict[str, tuple[Callable[[], paths.Path], float]] = {
    "line": (lambda: paths.line(1.0), LINE_RATE),
    "reverse": (lambda: paths.line(-1.0), LINE_RATE),
    "spin": (paths.spin, LAP_RATE),
    "circle": (paths.circle, LAP_RATE),
    "eight": (paths.eight, LAP_RATE),
}


@dataclass(frozen=True)
class PathReference:
    """A base path and an arm motion, both started softly from rest.

    Attributes:
        path: The base's path; None for a fixed base.
        rate: Pace of the path, units of its parameter a second.
        arm: The arm's motion.
        ramp: Duration of the soft start, s.
    """

    path: paths.Path | None
    rate: float
    arm: Waves
    ramp: float

    def __call__(self, t: float) -> ReferenceState:
        """Return the reference at time ``t`` (s)."""
        arm = self.arm(paths.ramped_time(t, 1.0, self.ramp))
        if self.path is None:
            return ReferenceState(np.zeros(3), np.zeros(3), np.zeros(3), *arm)
        s, ds, dds = paths.ramped_time(t, self.rate, self.ramp)
        point = self.path(s)
        along, bend, twice = point.direction
        return ReferenceState(
            point.pose,
            along * ds,
            bend * ds**2 + along * dds,
            *arm,
            direction=np.array([along, bend * ds, twice * ds**2 + bend * dds]),
        )


def reference_by_name(robot: Robot, name: str) -> PathReference:
    """Return one of the named references (``line``, ``reverse``, ``spin``, ``circle``, ``eight``).

    The arm swings about its home posture; a fixed base moves its arm only. Circle and eight grow
    where the robot cannot steer into them as they are.

    Raises:
        UnknownNameError: There is no such reference.
        RpctlError: The base cannot follow it: one that steers does not turn on the spot.
    """
    if name not in BASE_PATHS:
        raise UnknownNameError("reference", name, BASE_PATHS)
    make, rate = BASE_PATHS[name]
    if not robot.drive.base_speeds:
        return PathReference(None, rate, waves(robot), RAMP_TIME)
    if name == "spin" and robot.drive.has_axle and robot.drive.steered:
        raise RpctlError(
            f"{robot.name} cannot follow a spin: a {robot.drive.type} base does not turn on the "
            "spot; take line, reverse, circle or eight"
        )
    growth = _growth(robot, make())
    # As the size grows, the pace falls: the acceleration into the bends stays what it was.
    path = paths.scaled(make(), growth)
    return PathReference(path, rate / math.sqrt(growth), waves(robot), RAMP_TIME)


def _growth(robot: Robot, path: paths.Path) -> float:
    """Return the factor by which a closed path must grow for a robot to steer along it."""
    along = (path(s).direction[0] for s in np.linspace(0.0, 2.0 * math.pi, CURVATURE_SAMPLES))
    bend = max(abs(turn) / abs(speed) if speed else 0.0 for speed, _, turn in along)
    return max(1.0, bend * steerable_radius(robot))
