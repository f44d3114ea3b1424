"""Arm motions to go with a named base path: a sine at each joint, within its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.reference.paths import PathTime
from rpctl.robot.model import Robot

SPEED_FRACTION = 0.5  # of a joint's velocity limit: what an arm reference uses at most
RANGE_FRACTION = 0.8  # of the way to the nearer limit: how far an arm reference swings at most
MAX_PRISMATIC_SWING = 0.15  # m; the largest swing of a sliding joint
MAX_REVOLUTE_SWING = 0.4  # rad; the largest swing of a turning joint
WAVE_PERIODS = (10.0, 8.0, 12.5)  # s; taken in turn, so that neighbouring joints move apart


@dataclass(frozen=True)
class Waves:
    """Sines about a posture: position = centre + amplitude sin(rate · s)."""

    centre: Array = field(repr=False)  # (n_joints,)
    amplitude: Array = field(repr=False)  # (n_joints,)
    rate: Array = field(repr=False)  # (n_joints,) rad/s

    def __call__(self, path_time: PathTime) -> tuple[Array, Array, Array]:
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
