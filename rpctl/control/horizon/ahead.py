"""A reference as numbers: read a little ahead by who has it, and read again by who has the numbers.

Whoever plans in another process has no use for a function of this one. It gets the reference's rows
at multiples of a quarter of a step; between them, the second derivatives that a row holds go on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import Reference, ReferenceState, row_reader, state_of
from rpctl.robot.model import Robot

ROWS_PER_STEP = 4
READING_S = 50e-6  # s that a sample may spend on reading ahead; a row takes 5 to 30 µs


class Rows(NamedTuple):
    """Rows of a reference, one after the other."""

    number: int  # of the reference, counted: another one makes all rows before worthless
    first: int  # multiple of the stride
    rows: Array  # (K, 9 + 3 n_joints + 9)


class ReadAhead:
    """Reads references ahead, a few rows at a time."""

    def __init__(self, robot: Robot, dt: float) -> None:
        self._robot, self._stride = robot, dt / ROWS_PER_STEP
        self._reference: Reference | None = None
        self._number = 0
        self._row: Callable[[float], Array]
        self._first, self._rows = 0, list[Array]()

    def reaches(self, reference: Reference, begin: float, end: float) -> bool:
        """Return whether a reference has been read from one time (s) to another."""
        if reference is not self._reference:
            self._number, self._reference = self._number + 1, reference
            self._row = row_reader(self._robot, reference)
            self._first, self._rows = math.floor(begin / self._stride), []
        until = time.perf_counter() + READING_S
        while True:
            at = self._first + len(self._rows)
            if (at - 1) * self._stride >= end:
                return True
            self._rows.append(self._row(at * self._stride).copy())
            if time.perf_counter() > until:
                return False

    def taken(self) -> Rows:
        """Return the rows that were read since the last call."""
        first, rows = self._first, self._rows
        self._first, self._rows = first + len(rows), []
        width = len(rows[0]) if rows else 0
        return Rows(self._number, first, np.reshape(rows, (len(rows), width)))

    def forget(self) -> None:
        """Read everything again: who had the rows is gone."""
        self._reference = None


class NumbersAhead:
    """A reference made of its rows; before the first and after the last, it goes on from there."""

    def __init__(self, first: int, dt: float) -> None:
        self._first, self._stride = first, dt / ROWS_PER_STEP
        self._rows = list[Array]()

    def add(self, rows: Array, read_from: float) -> None:
        """Add the rows that follow, and forget those before a time (s)."""
        self._rows += list(rows)
        old = min(max(math.floor(read_from / self._stride) - self._first, 0), len(self._rows) - 1)
        self._first, self._rows = self._first + old, self._rows[old:]

    def __call__(self, t: float) -> ReferenceState:
        """Return the state at a time (s)."""
        at = min(max(round(t / self._stride) - self._first, 0), len(self._rows) - 1)
        state, since = state_of(self._rows[at]), t - (self._first + at) * self._stride
        since = min(max(since, -self._stride), self._stride)
        vx, vy, omega = state.twist.tolist()
        bent = state.twist_dot + np.array([-omega * vy, omega * vx, 0.0])
        x, y, turned = (since * (state.twist + 0.5 * since * bent)).tolist()
        cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
        pose = state.pose + np.array([cos * x - sin * y, sin * x + cos * y, turned])
        toward = np.asarray(state.direction)
        return ReferenceState(
            pose,
            state.twist + since * state.twist_dot,
            state.twist_dot,
            state.joints + since * (state.joint_rates + 0.5 * since * state.joint_accelerations),
            state.joint_rates + since * state.joint_accelerations,
            state.joint_accelerations,
            np.array([toward[0] + since * (toward[1] + 0.5 * since * toward[2]),
                      toward[1] + since * toward[2], toward[2]]),
        )  # fmt: skip
