"""Encoders: joints are known in whole steps, and speeds from the steps since the last sample."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot

UNLIMITED_RANGE_M = 1.0  # m: of a prismatic joint without limits, over which its steps are counted
TURN = 2.0 * math.pi


class Encoders:
    """Encoders on the driven wheels, the swivels that are driven and the arm's joints of a robot.

    A step is a turn by 2^bits; of a prismatic joint its range by 2^bits. Positions are rounded to
    whole steps. A rate is the difference of two rounded positions over the time between them, and
    the base's speeds are those of odometry: what the rates of driven wheels and casters say of a
    robot that rolls, in the sense of least squares, its steering and its joints at the encoders'
    rates. They determine them: efforts of the same joints can drive all of them.

    The pose of the base is not theirs to measure: whoever localises it has his own errors, which
    are noise.

    Args:
        robot: The robot as its controller knows it: its odometry takes that for the truth.
        bits: Of each encoder.
    """

    def __init__(self, robot: Robot, bits: int) -> None:
        self._dynamics = ReducedDynamics(robot)
        steered = [swivel.joint for swivel in robot.drive.steered]
        measured = [*dict.fromkeys((*robot.joint_names, *steered))]
        self._rates = [measured.index(n) for n in robot.quasi_velocities if n in measured]
        self._joints = np.array([n in measured for n in robot.quasi_velocities], dtype=bool)
        wheels = [name for name in robot.actuators if name not in measured]
        self._wheels = [robot.velocity_index(name) for name in wheels]
        self._written = len(measured)
        names = (*measured, *wheels)
        self._entries = [robot.entries[name] for name in names]
        self._turns = np.array([robot.entries[name].is_pair for name in names], dtype=bool)
        self._steps = np.array([_range(robot, name) for name in names]) / 2.0**bits
        self._before: tuple[float, Array] | None = None

    def __call__(self, q: Array, nu: Array, t: float) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) as they are measured; ν is 0 at the first sample.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,), which encoders do not see.
            t: Time of the sample, s.
        """
        true = np.array([entry.read(q) for entry in self._entries])
        positions = self._steps * np.round(true / self._steps)
        found = q.copy()
        for entry, position in zip(self._entries, positions.tolist(), strict=True):
            entry.write(found, position)
        before, self._before = self._before, (t, positions)
        if before is None:
            return found, np.zeros(len(nu))
        moved = positions - before[1]
        moved = np.where(self._turns, moved - TURN * np.round(moved / TURN), moved)
        rates = moved / (t - before[0])
        measured = np.zeros(len(nu))
        measured[self._joints] = rates[self._rates]
        base = ~self._joints
        if base.any():
            rolling = self._dynamics.basis(found)[self._wheels]
            left = rates[self._written :] - rolling @ measured
            measured[base] = np.linalg.lstsq(rolling[:, base], left, rcond=None)[0]
        return found, measured


def _range(robot: Robot, name: str) -> float:
    """Return over what a joint's steps are counted: a turn, or the range of one that slides (m)."""
    joint = robot.description.joint[name]
    if joint.kind != "prismatic":
        return TURN
    span = joint.upper - joint.lower
    return float(span) if math.isfinite(span) and span > 0.0 else UNLIMITED_RANGE_M
