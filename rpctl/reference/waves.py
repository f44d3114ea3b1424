"""Arm motions to go with a named base path: a sine at each joint, within its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.reference.paths import PathTime
from rpctl.reference.pointwise import beside
from rpctl.robot.model import Robot

SPEED_FRACTION = 0.5  # of a joint's velocity limit: what an arm reference uses at most
RANGE_FRACTION = 0.8  # of the way to the nearer limit: how far an arm reference swings at most
MAX_PRISMATIC_SWING = 0.15  # of the robot's length; the largest swing of a sliding joint
MAX_REVOLUTE_SWING = 0.4  # rad; the largest swing of a turning joint
# s, for a robot 1 m long; taken in turn, so that neighbouring joints move apart.
WAVE_PERIODS = (10.0, 8.0, 12.5)


@dataclass(frozen=True)
class Waves:
    """Sines about a posture: position = centre + amplitude sin(rate · s)."""

    centre: Array = field(repr=False)  # (n_joints,)
    amplitude: Array = field(repr=False)  # (n_joints,)
    rate: Array = field(repr=False)  # (n_joints,) rad/s

    def __call__(self, path_time: PathTime) -> tuple[Array, Array, Array]:
        """Return positions, rates and accelerations, (n_joints,) or (K, n_joints) each."""
        s, rate, acceleration = map(beside, path_time)
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
        robot: The robot.
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
