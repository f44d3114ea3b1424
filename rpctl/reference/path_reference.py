"""References along a path: at one pace beside an arm that swings, or by a time law."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.reference.formula import Along, Columns
from rpctl.reference.motion import ReferenceState, RowReference, state_of
from rpctl.reference.paths import Curve, Path, PathTime, line, placed, ramped_time
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

    def __call__(self, at: Along) -> list[Any]:
        """Return the positions where the sheet's x is s."""
        rows = zip(self.centre.tolist(), self.amplitude.tolist(), self.rate.tolist(), strict=True)
        return [centre + swing * casadi.sin(rate * at.x) for centre, swing, rate in rows]


def waves(robot: Robot, length: float = 1.0) -> Waves:
    """Return motions of a robot's arm that stay inside its position and velocity limits.

    Legs stand still.

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
        swing = min(widest, _swing(robot, joint, float(home), rate))
        swings.append(0.0 if joint.name in robot.legs else swing)
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


def row_along(
    at: Along, path: Path | None, base: PathTime, arm: Curve, swing: PathTime
) -> list[Any]:
    """Return the row of a reference's table where base and arm are at parameters, as scalars.

    Args:
        path: The base's path; None: it stays.
        base: Where on it the base is, and how fast.
        arm: The arm's motion.
        swing: Where in it the arm is.
    """
    place = [0.0] * 18 if path is None else at.values(path.columns, base.s)
    pose, along, bend, toward, change, twice = (place[k : k + 3] for k in range(0, 18, 3))
    sheet = Along()
    joints = at.values(sheet.columns(sheet.orders(arm(sheet))), swing.s)
    n = len(joints) // 3
    return [
        *pose,
        *_by_time([], along, bend, base),
        *_by_time(joints[:n], joints[n : 2 * n], joints[2 * n :], swing),
        *_by_time(toward, change, twice, base),
    ]


def _by_time(values: list[Any], slope: list[Any], bend: list[Any], time: PathTime) -> list[Any]:
    """Return values, and first and second derivatives by time of what has these by s."""
    square = time.rate**2
    changes = [b * square + a * time.acceleration for a, b in zip(slope, bend, strict=True)]
    return [*values, *(a * time.rate for a in slope), *changes]


@dataclass(frozen=True)
class PathReference(RowReference):
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

    path: Path | None
    rate: float
    arm: Waves
    ramp: float
    default_duration: float = DEFAULT_DURATION
    lap: float = 2.0 * math.pi
    sizing: Sizing | None = None

    def slowed(self, factor: float) -> PathReference:
        """Return the reference with its path ``factor`` times slower."""
        return replace(self, rate=self.rate / factor)

    @cached_property
    def row(self) -> Columns:  # type: ignore[override]
        """Its row by time, s."""
        at = Along()
        time = at.orders([ramped_time(at.x, self.ramp)])
        base = PathTime(*(self.rate * each for each in time))
        return at.columns(row_along(at, self.path, base, self.arm, PathTime(*time)))


@dataclass(frozen=True)
class TimedPath(RowReference):
    """Base and arm as functions of one path parameter s, and a time law s(t).

    Attributes:
        path: The base's path.
        arm: Positions of the joints (n_joints,) by s.
        time_law: s(t).
        sizing: How large and fast it is, and why; None where a file says it.
    """

    path: Path = field(repr=False)
    arm: Curve = field(repr=False)
    time_law: TimeLaw = field(repr=False)
    sizing: Sizing | None = None

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""
        return self.time_law.duration

    def slowed(self, factor: float) -> TimedPath:
        """Return the reference ``factor`` times slower."""
        return replace(self, time_law=self.time_law.lasting(factor * self.duration))

    @cached_property
    def row(self) -> Columns:  # type: ignore[override]
        """Its row by time, s."""
        at = Along()
        return at.columns(at.values(self._along, *at.values(self.time_law.columns, at.x)))

    @cached_property
    def _along(self) -> Columns:
        """The row by s, its rate and its acceleration."""
        rates = [casadi.SX.sym(name) for name in ("rate", "acceleration")]
        at = Along(*rates)
        time = PathTime(at.x, *rates)
        return at.columns(row_along(at, self.path, time, self.arm, time))

    def at(self, path_time: PathTime) -> ReferenceState:
        """Return the reference where the path parameter is s, with these derivatives by time."""
        return state_of(self._along(*path_time))


def still(pose: Array) -> Path:
    """Return the path of a base that stays at a pose (3,)."""
    return placed(line(0.0), pose)
