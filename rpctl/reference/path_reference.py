"""References along a path: at one pace beside an arm that swings, or by a time law."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.reference import paths
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import (
    Curves,
    Numbers,
    Path,
    PathTime,
    factors,
    split_rows,
    stack_rows,
)
from rpctl.reference.sizing import Sizing
from rpctl.reference.time_law import TimeLaw
from rpctl.robot.model import Robot

SPEED_FRACTION = 0.5  # of a joint's velocity limit: what an arm reference uses at most
RANGE_FRACTION = 0.8  # of the way to the nearer limit: how far an arm reference swings at most
MAX_PRISMATIC_SWING = 0.15  # of the robot's length; the largest swing of a sliding joint
MAX_REVOLUTE_SWING = 0.4  # rad; the largest swing of a turning joint
# s, for a robot 1 m long; taken in turn, so that neighbouring joints move apart.
WAVE_PERIODS = (10.0, 8.0, 12.5)
DEFAULT_DURATION = 20.0  # s, of a reference without a name


@dataclass(frozen=True)
class Waves:
    """Sines about a posture: position = centre + amplitude sin(rate · s)."""

    centre: Array = field(repr=False)  # (n_joints,)
    amplitude: Array = field(repr=False)  # (n_joints,)
    rate: Array = field(repr=False)  # (n_joints,) rad/s

    def __call__(self, path_time: PathTime) -> tuple[Array, Array, Array]:
        """Return positions, rates and accelerations, (n_joints,) or (K, n_joints) each."""
        s, rate, acceleration = map(factors, path_time)
        phase = self.rate * s
        sin, cos = np.sin(phase), np.cos(phase)
        slope = self.amplitude * self.rate * cos
        bend = -self.amplitude * self.rate**2 * sin
        position = self.centre + self.amplitude * sin
        return (
            position,
            slope * rate,
            bend * rate**2 + slope * acceleration,
        )


def waves(robot: Robot, length: float = 1.0) -> Waves:
    """Return motions of a robot's arm that stay inside its position and velocity limits.

    Args:
        length: Its length, m: sliding joints swing in proportion, and periods grow as its root,
            so that accelerations stay what they are.
    """
    rates, swings = [], []
    for index, (joint, home) in enumerate(zip(robot.joints, robot.home, strict=True)):
        period = WAVE_PERIODS[index % len(WAVE_PERIODS)] * math.sqrt(length)
        rate = 2.0 * math.pi / period
        rates.append(rate)
        widest = MAX_REVOLUTE_SWING if joint.kind != "prismatic" else MAX_PRISMATIC_SWING * length
        swings.append(min(widest, _swing(robot, joint, float(home), rate)))
    return Waves(robot.home.copy(), np.array(swings), np.array(rates))


def _swing(robot: Robot, joint: Joint, home: float, rate: float) -> float:
    """Return the widest swing that a joint's limits leave, and those of joints that mimic it."""
    swings = [_room(joint, home, rate)]
    for other in robot.mimics:
        if other.mimic is not None and other.mimic.joint == joint.name and other.mimic.multiplier:
            place = other.mimic.multiplier * home + other.mimic.offset
            swings.append(_room(other, place, rate) / abs(other.mimic.multiplier))
    return max(0.0, min(swings))


def _room(joint: Joint, home: float, rate: float) -> float:
    """Return how far a joint can swing about a place within its limits."""
    room = min(home - joint.lower, joint.upper - home)
    return min(RANGE_FRACTION * room, SPEED_FRACTION * joint.velocity / rate)


@dataclass(frozen=True)
class PathReference:
    """A base path and an arm motion, both started softly from rest.

    Attributes:
        path: The base's path; None for a fixed base.
        rate: Pace of the path, units of its parameter a second.
        arm: The arm's motion.
        ramp: Duration of the soft start, s.
        default_duration: How long it is tracked if nobody says, s.
        lap: By how much the path's parameter grows in a lap.
        sizing: How large and fast it is, and why; None where it has no name.
    """

    path: paths.Path | None
    rate: float
    arm: Waves
    ramp: float
    default_duration: float = DEFAULT_DURATION
    lap: float = 2.0 * math.pi
    sizing: Sizing | None = None

    def slowed(self, factor: float) -> PathReference:
        """Return the reference with its path ``factor`` times slower."""
        return replace(self, rate=self.rate / factor)

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at time ``t`` (s), or at times (K,), a row each."""
        arm = self.arm(paths.ramped_time(t, 1.0, self.ramp))
        if self.path is None:
            pose, twist, twist_dot = np.zeros((3, *np.shape(t), 3))
            return ReferenceState(pose, twist, twist_dot, *arm)
        s, *rates = paths.ramped_time(t, self.rate, self.ramp)
        point, (ds, dds) = self.path(s), map(factors, rates)
        along, bend, twice = split_rows(point.direction)
        return ReferenceState(
            point.pose,
            along * ds,
            bend * ds**2 + along * dds,
            *arm,
            direction=stack_rows(along, bend * ds, twice * ds**2 + bend * dds),
        )


@dataclass(frozen=True)
class TimedPath:
    """Base and arm as functions of one path parameter s, and a time law s(t).

    Attributes:
        path: The base's path.
        arm: Positions of the joints (n_joints,) by s.
        time_law: s(t).
        travel_direction: Direction of travel by s, or by many, that does not vanish where the path
            stands still; None takes the path's own.
        sizing: How large and fast it is, and why; None where a file says it.
    """

    path: Path = field(repr=False)
    arm: Curves = field(repr=False)
    time_law: TimeLaw = field(repr=False)
    travel_direction: Callable[[Numbers], Array] | None = field(default=None, repr=False)
    sizing: Sizing | None = None

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""
        return self.time_law.duration

    def slowed(self, factor: float) -> TimedPath:
        """Return the reference ``factor`` times slower."""
        law = self.time_law
        return replace(self, time_law=law.lasting(factor * law.duration))

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at time ``t`` (s), or at times (K,), a row each."""
        return self.at(self.time_law(t))

    def at(self, path_time: PathTime) -> ReferenceState:
        """Return the reference where the path parameter is s, with these derivatives by time."""
        s, *rates = path_time
        point, (ds, dds) = self.path(s), map(factors, rates)
        along, bend, _ = split_rows(point.direction)
        joints, slope, curve = self.arm(s)
        toward, change, twice = split_rows(
            point.direction if self.travel_direction is None else self.travel_direction(s)
        )
        return ReferenceState(
            point.pose,
            along * ds,
            bend * ds**2 + along * dds,
            joints,
            slope * ds,
            curve * ds**2 + slope * dds,
            stack_rows(toward, change * ds, twice * ds**2 + change * dds),
        )


def still(pose: Array) -> Path:
    """Return the path of a base that stays at a pose (3,)."""
    return paths.placed(paths.line(0.0), pose)


def constant(values: Array, start: float, end: float) -> Curves:
    """Return constant curves.

    Args:
        values: Their values (n,).
        start: First s.
        end: Last s.
    """
    return Curves(BSpline(np.repeat([start, end], 3), np.tile(values, (3, 1)), 2))


def along(path: Path, s: Array) -> Array:
    """Return a path's direction and its first derivative by s at points (N,): (N, 2, 3)."""
    return path(s).direction[:, :2]
