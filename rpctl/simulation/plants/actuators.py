"""True actuators: what they exert of the efforts that they are commanded.

A command is first cut at the limits at which the actuators saturate, then follows a first-order
lag, T u̇ = c − u, and then passes the backlash of its joint. Each of them is left out where the
plant has none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.backlash import Backlash, rotor_inertias

PIECES = 4  # of a control period, in each of which efforts are constant: at most so many


class MovingState(Protocol):
    """What moves: its state is read again after each piece of an effort."""

    @property
    def q(self) -> Array:
        """Configuration (nq,)."""

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,)."""


class Actuators:
    """The actuators of a simulated robot.

    Args:
        robot: The simulated robot.
        plant: What its actuators are like.
        period: Control period, s.
        rest: Efforts (n_act,) that hold it before the run, N·m or N.
    """

    def __init__(self, robot: Robot, plant: Plant, period: float, rest: Array) -> None:
        self._limits = plant.saturation(robot)
        self._lag, self._period = plant.effort_lag, period
        self._exerted = self._saturated(rest)
        self._backlash: Backlash | None = None
        gaps = by_pattern(plant.backlash, robot.actuators, "actuator")
        if any(gaps.values()):
            dynamics = ReducedDynamics(robot)
            widths = np.array([gaps.get(name, 0.0) for name in robot.actuators])
            rotors = rotor_inertias(dynamics, robot.configuration())
            self._backlash = Backlash(dynamics, widths, rotors, self._exerted)

    def at(self, command: Array) -> Array:
        """Return the efforts (n_act,) that they exert at the moment when a command comes.

        That is before the backlash, whose impacts no actuator exerts.

        Args:
            command: Efforts (n_act,), N·m or N.
        """
        return self._exerted if self._lag else self._saturated(command)

    def true_efforts(
        self, command: Array, state: MovingState, duration: float
    ) -> Iterator[tuple[float, Array]]:
        """Yield how long (s) which efforts (n_act,) act on the joints, one after another.

        In each piece they are constant: of a lag, the mean, which has its impulse exactly.

        Args:
            command: Efforts (n_act,), N·m or N.
            state: Of the robot, which moves between one piece and the next.
            duration: How long the command holds, s.
        """
        wanted = self._saturated(command)
        if not self._lag and self._backlash is None:
            yield duration, wanted
            return
        count = max(1, math.ceil(PIECES * duration / self._period - 1e-9))
        piece = duration / count
        for _ in range(count):
            effort = self._lagging(wanted, piece)
            if self._backlash is not None:
                effort = self._backlash.transmit(effort, state.q, state.nu, piece)
            yield piece, effort

    def _saturated(self, command: Array) -> Array:
        """Return a command (n_act,) within the limits."""
        return np.clip(command, -self._limits, self._limits)

    def _lagging(self, wanted: Array, duration: float) -> Array:
        """Return the mean effort (n_act,) on the way to another, and go on to its end.

        Args:
            wanted: Efforts (n_act,).
            duration: s.
        """
        if not self._lag:
            return wanted
        ratio = duration / self._lag
        left = math.exp(-ratio)
        short = self._exerted - wanted
        self._exerted = wanted + left * short
        return np.asarray(wanted + (1.0 - left) / ratio * short)
