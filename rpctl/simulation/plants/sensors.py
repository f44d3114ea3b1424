"""What the controller measures of the simulated robot, and when."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.model import Robot
from rpctl.simulation.noise import BLOCK, NoiseStream, Sensors, random_stream
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.encoders import Encoders

JITTER_STREAM = 1  # of the numbers that follow from a seed; noise has the first
MOST_JITTER = 0.45  # of a control period: samples stay in order, with time between them


class Measurement:
    """Measures the state of a robot, sample after sample.

    Encoders come first, then constant errors and noise, which add to what they say.

    Args:
        robot: The robot as its controller knows it.
        plant: What its sensors are like.
    """

    def __init__(self, robot: Robot, plant: Plant) -> None:
        self._sensors = Sensors(robot)
        self._deviations = self._sensors.deviations(plant.noise)
        self._errors = self._sensors.errors(plant.sensor_bias)
        self._stream = NoiseStream(self._sensors.width, plant.seed)
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
            self._rows = self._stream.rows(BLOCK) * self._deviations + self._errors
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
