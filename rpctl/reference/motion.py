"""``Reference``: where base and arm should be at a time, with first and second derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.drive.steering import turning_radius
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference import paths
from rpctl.robot.model import Robot

SPEED_FRACTION = 0.5  # of a joint's velocity limit: what an arm reference uses at most
RANGE_FRACTION = 0.8  # of the way to the nearer limit: how far an arm reference swings at most
MAX_PRISMATIC_SWING = 0.15  # m; the largest swing of a sliding joint
MAX_REVOLUTE_SWING = 0.4  # rad; the largest swing of a turning joint
WAVE_PERIODS = (10.0, 8.0, 12.5)  # s; taken in turn, so that neighbouring joints move apart


class ReferenceState(NamedTuple):
    """A reference at one time: base and arm, each with first and second derivatives.

    The twist is P's speed forward and to the left and the turning rate, in the axes of the
    reference itself; ``twist_dot`` holds the derivatives of these three numbers.

    ``direction`` (3, 3) is a vector along the twist that does not vanish where the reference
    stands still, and its first two derivatives by time: steered wheels point along it. None where
    the twist itself is all there is to know.
    """

    pose: Array  # (3,) of P: x, y in m, heading in rad
    twist: Array  # (3,) m/s, m/s, rad/s
    twist_dot: Array  # (3,) m/s², m/s², rad/s²
    joints: Array  # (n_joints,) rad or m
    joint_rates: Array  # (n_joints,)
    joint_accelerations: Array  # (n_joints,)
    direction: Array | None = None


Reference = Callable[[float], ReferenceState]


@dataclass(frozen=True)
class Waves:
    """Sines about a posture: position = centre + amplitude sin(rate · s)."""

    centre: Array = field(repr=False)  # (n_joints,)
    amplitude: Array = field(repr=False)  # (n_joints,)
    rate: Array = field(repr=False)  # (n_joints,) rad/s

    def __call__(self, path_time: paths.PathTime) -> tuple[Array, Array, Array]:
        """Return positions, rates and accelerations (n_joints,) each."""
        sin, cos = np.sin(self.rate * path_time.s), np.cos(self.rate * path_time.s)
        slope = self.amplitude * self.rate * cos
        bend = -self.amplitude * self.rate**2 * sin
        position = self.centre + self.amplitude * sin
        return (
            position,
            slope * path_time.rate,
            bend * path_time.rate**2 + slope * path_time.acceleration,
        )


def waves(robot: Robot) -> Waves:
    """Return motions of a robot's arm that stay inside its position and velocity limits."""
    rates, swings = [], []
    for index, (joint, home) in enumerate(zip(robot.joints, robot.home, strict=True)):
        rate = 2.0 * math.pi / WAVE_PERIODS[index % len(WAVE_PERIODS)]
        rates.append(rate)
        swings.append(_swing(joint, float(home), rate))
    return Waves(robot.home.copy(), np.array(swings), np.array(rates))


def _swing(joint: Joint, home: float, rate: float) -> float:
    room = min(home - joint.lower, joint.upper - home)
    widest = MAX_PRISMATIC_SWING if joint.kind == "prismatic" else MAX_REVOLUTE_SWING
    return max(0.0, min(widest, RANGE_FRACTION * room, SPEED_FRACTION * joint.velocity / rate))


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


RAMP_TIME = 3.0  # s
LAP_TIME = 20.0  # s; a closed path is run through once in this time, soft start included
LAP_RATE = 2.0 * math.pi / (LAP_TIME - 0.5 * RAMP_TIME)
LINE_RATE = 0.3  # m/s
CURVATURE_SAMPLES = 101  # places at which a path's curvature is looked at
TURNING_RADIUS_FACTOR = (
    1.5  # times the tightest bend that the robot can steer: room for corrections
)

# Name: path, and its pace at full speed.
BASE_PATHS: dict[str, tuple[Callable[[], paths.Path], float]] = {
    "line": (lambda: paths.line(1.0), LINE_RATE),
    "reverse": (lambda: paths.line(-1.0), LINE_RATE),
    "spin": (paths.spin, LAP_RATE),
    "circle": (paths.circle, LAP_RATE),
    "eight": (paths.eight, LAP_RATE),
}


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
    """Return how many times larger a closed path has to be for a robot to steer along it."""
    radius = turning_radius(robot.drive, robot.description.joint)
    along = (path(s).direction[0] for s in np.linspace(0.0, 2.0 * math.pi, CURVATURE_SAMPLES))
    bend = max(abs(turn) / abs(speed) if speed else 0.0 for speed, _, turn in along)
    return max(1.0, TURNING_RADIUS_FACTOR * bend * radius)
