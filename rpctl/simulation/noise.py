"""Noise of what is measured: normal numbers that follow from a seed and the sample's number.

Every sample takes a row of as many standard normal numbers as the robot has measured quantities,
whatever their deviations, so that one deviation changes nothing of what the others are drawn from.
Rows are drawn one after another from a counter-based generator (Philox): drawn one by one or in
blocks, alone or beside other runs, they are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_within
from rpctl.robot.coordinates import JointEntry
from rpctl.robot.model import Robot
from rpctl.simulation.plants.sensor_settings import SensorBias, SensorNumbers

BLOCK = 256  # rows that are drawn at a time
PLACE = 3  # numbers of a row that are the base's pose: x, y and heading
COSINE, SINE = 2, 3  # entries of q that hold the heading of the base


@dataclass(frozen=True)
class Noise(SensorNumbers):
    """Standard deviations of what the controller measures. Samples are independent."""

    def __post_init__(self) -> None:
        """Refuse what is no deviation."""
        for name, value in vars(self).items():
            if not value >= 0.0:
                raise RpctlError(f"noise of {name} is {value:g}; give a deviation of 0 or more")
            require_within(f"noise of {name}", [value])


class Sensors:
    """What the controller of a robot measures of its state.

    Attributes:
        width: Numbers of a row of noise: x, y, heading, positions, then one of each of ν. A fixed
            base measures its pose exactly.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._moves = bool(robot.drive.base_speeds)
        names = (*robot.joint_names, *(swivel.joint for swivel in robot.drive.steered))
        self._entries: tuple[JointEntry, ...] = tuple(robot.entries[name] for name in names)
        self._steered = {swivel.joint for swivel in robot.drive.steered}
        self._nu = robot.quasi_velocities
        self.width = PLACE + len(names) + robot.dof
        self._joints = set(names)

    def deviations(self, noise: Noise) -> Array:
        """Return the standard deviation of each number of a row (width,)."""
        return self._row(noise)

    def errors(self, bias: SensorBias) -> Array:
        """Return the constant error of each number of a row (width,)."""
        return self._row(bias)

    def _row(self, of: Noise | SensorBias) -> Array:
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


class NoiseStream:
    """The rows of standard normal numbers of one run, in the order of its samples.

    Args:
        width: Numbers of a row.
        seed: Of the run's plant.
    """

    def __init__(self, width: int, seed: int) -> None:
        self._width = width
        self._draw = random_stream(seed).standard_normal

    def rows(self, count: int) -> Array:
        """Return the next rows (count, width)."""
        return self._draw((count, self._width))
