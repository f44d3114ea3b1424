"""The protocol of a plant: what a controller drives, whoever simulates it.

A model starts a robot, and what runs then takes commands and returns measurements::

    plant = model.start(robot, rest)
    t, q, nu = plant.step(command, dt)

Whoever has a simulator of his own gives such a model to :func:`rpctl.track`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.robot.model import Robot


class PlantSample(NamedTuple):
    """What is measured of a plant.

    Attributes:
        t: When, s.
        q: Configuration (nq,), seen from above; :meth:`Robot.state` makes it of named readings.
        nu: Quasi-velocities (dof,).
    """

    t: float
    q: Array
    nu: Array


class RunningPlant(Protocol):
    """A robot that runs."""

    def step(self, command: ControllerOutput, dt: float) -> PlantSample:
        """Advance the robot; return what is measured of it then.

        Args:
            command: What the controller sends; it holds until the next.
            dt: For how long, s.

        Raises:
            DivergedError: The state left the finite numbers.
        """


@runtime_checkable
class PlantModel(Protocol):
    """What starts a robot: a simulator of the user's."""

    def start(self, robot: Robot, rest: Rest) -> RunningPlant:
        """Put a robot where a run begins.

        Args:
            robot: The robot.
            rest: Where it stands at t = 0, and the efforts that hold it there in the model.
        """
