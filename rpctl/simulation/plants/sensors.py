"""What the controller measures of the simulated robot, and when: encoders, errors and noise.

Noise is normal numbers that follow from a seed and the sample's number. Every sample takes a row of
as many standard normal numbers as the robot has measured quantities, whatever their deviations, so
that one deviation changes nothing of what the others are drawn from. Rows are drawn one after
another from a counter-based generator (Philox): drawn one by one or in blocks, alone or beside
other runs, they are the same.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.coordinates import JointEntry
from rpctl.robot.model import Robot
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.settings import Noise, SensorBias

UNLIMITED_RANGE_M = 1.0  # m: of a prismatic joint without limits, over which its steps are counted
TURN = 2.0 * math.pi
BLOCK = 256  # rows that are drawn at a time
PLACE = 3  # numbers of a row that are the base's pose: x, y and heading
COSINE, SINE = 2, 3  # entries of q that hold the heading of the base
JITTER_STREAM = 1  # of the numbers that follow from a seed; noise has the first
MOST_JITTER = 0.45  # of a control period: samples stay in order, with time between them


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


class Sensors:
    """What the controller of a robot measures of its state.

    Attributes:
        width: Numbers of a row of noise: x, y, heading, positions, then one of each of ν. A fixed
            base measures its pose exactly.
    """

    def __init__(self, robot: Robot) -> None:
        self._moves = bool(robot.drive.base_speeds)
        names = (*robot.joint_names, *(swivel.joint for swivel in robot.drive.steered))
        self._entries: tuple[JointEntry, ...] = tuple(robot.entries[name] for name in names)
        self._steered = {swivel.joint for swivel in robot.drive.steered}
        self._nu = robot.quasi_velocities
        self.width = PLACE + len(names) + robot.dof
        self._joints = set(names)

    def row(self, of: Noise | SensorBias) -> Array:
        """Return the deviation, or the constant error, of each number of a row (width,)."""
        base = [of.position, of.position, of.heading] if self._moves else [0.0] * PLACE
        kinds = {"omega": of.turn_rate, **dict.fromkeys(self._joints, of.joint_rates)}
        rates = [kinds.get(name, of.speed) for name in self._nu]
        return np.array([*base, *[of.joints] * len(self._entries), *rates])

    def measured(self, q: Array, nu: Array, row: Array) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) as they are measured.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            row: Noise (width,).
        """
        found = q.copy()
        self._add(found, row, np.cos, np.sin)
        return found, nu + row[self.width - len(self._nu) :]

    def symbolic(self, q: Any, nu: Any, row: Any) -> tuple[Any, Any]:
        """Return the same of columns of ``casadi.SX``.

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            row: Noise (width, 1).
        """
        import casadi

        found = casadi.SX(q)
        self._add(found, row, casadi.cos, casadi.sin)
        return found, nu + row[self.width - len(self._nu) :]

    def _add(self, q: Any, row: Any, cos: Any, sin: Any) -> None:
        """Add noise to q, in place; a pair (cos, sin) is turned by it."""
        if self._moves:
            q[0], q[1] = q[0] + row[0], q[1] + row[1]
            _turn(q, COSINE, cos(row[2]), sin(row[2]))
        for k, entry in enumerate(self._entries, start=PLACE):
            if entry.is_pair:
                _turn(q, entry.index, cos(row[k]), sin(row[k]))
            else:
                q[entry.index] = q[entry.index] + row[k]


def _turn(q: Any, index: int, cosine: Any, sine: Any) -> None:
    """Turn the pair (cos, sin) at an index of q, in place."""
    c, s = q[index], q[index + 1]
    q[index], q[index + 1] = c * cosine - s * sine, s * cosine + c * sine


def random_stream(seed: int, number: int = 0) -> np.random.Generator:
    """Return a stream of random numbers; those of one seed do not know of each other.

    Args:
        seed: Of the run's plant.
        number: Of the stream; 0 is that of the noise.
    """
    return np.random.Generator(np.random.Philox(key=seed, counter=number << 192))


class Measurement:
    """Measures the state of a robot, sample after sample.

    Encoders come first, then constant errors and noise, which add to what they say.

    Args:
        robot: The robot as its controller knows it.
        plant: What its sensors are like.
    """

    def __init__(self, robot: Robot, plant: Plant) -> None:
        self._sensors = Sensors(robot)
        self._deviations = self._sensors.row(plant.noise)
        self._errors = self._sensors.row(plant.sensor_bias)
        self._stream = random_stream(plant.seed)
        self._rows, self._next = np.empty((0, self._sensors.width)), 0
        self._encoders = Encoders(robot, plant.encoder_bits) if plant.encoder_bits else None
        self._exact = not (self._deviations.any() or self._errors.any())

    def __call__(self, q: Array, nu: Array, t: float) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) of the next sample as they are measured.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            t: When, s; later than the sample before.
        """
        if self._encoders is not None:
            q, nu = self._encoders(q, nu, t)
        if self._exact:
            return q, nu
        if self._next == len(self._rows):
            self._rows = (
                self._stream.standard_normal((BLOCK, len(self._errors))) * self._deviations
                + self._errors
            )
            self._next = 0
        row = self._rows[self._next]
        self._next += 1
        return self._sensors.measured(q, nu, row)


def sample_times(plant: Plant, period: float, count: int) -> Array:
    """Return when the controller samples (count,), s: each so often, with the plant's jitter.

    The first sample is at 0. None is farther from its moment than :data:`MOST_JITTER` of a period.

    Args:
        plant: Its jitter and seed.
        period: Control period, s.
        count: How many samples.
    """
    times = period * np.arange(count, dtype=float)
    if plant.jitter:
        draws = random_stream(plant.seed, JITTER_STREAM).standard_normal(count)
        most = MOST_JITTER * period
        times[1:] += np.clip(plant.jitter * draws[1:], -most, most)
    return times
