"""The protocol of a plant: what a controller drives, with any simulator.

A model starts a robot; the running plant takes commands and returns measurements::

    plant = model.start(robot, rest)
    t, q, nu = plant.step(command, dt)

A user with another simulator gives such a model to :func:`rpctl.track`.

:class:`Motion` is the protocol of a robot that moves under efforts which are held for a while.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from rpctl.arrays import NOTHING, Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.dynamics.motion import Step
from rpctl.robot.model import Robot
from rpctl.simulation.plants.settings import Wrench


class Ground(NamedTuple):
    """What the ground does to a robot now; (0,) where nobody knows.

    Attributes:
        load: Load of each contact (n_contacts,), N: the wheels' joints, then the supports, as
            :attr:`rpctl.dynamics.ground_reaction.Contacts.names`.
        slip: Velocity of each wheel's contact point (n_wheels, 2), m/s: along its rolling direction
            and to its left.
    """

    load: Array = NOTHING
    slip: Array = NOTHING


class Motion(Protocol):
    """A robot that moves.

    Its state is seen from above: a configuration with a planar root, and quasi-velocities, though
    it may also slip, tilt and hop.
    """

    @property
    def q(self) -> Array:
        """Configuration (nq,): x, y and heading of the root link, then the joints."""

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,): base speeds of P as it moves, rates of steering and joints."""

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w; world."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended, in sentences."""

    def ground(self) -> Ground:
        """Return what the ground does to it."""

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it under constant efforts.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides; their times do not count.

        Returns:
            q and ν then, the work of ``tau`` and of what pushes it, and what was lost of that.

        Raises:
            DivergedError: The state left the finite numbers.
        """


class PlantSample(NamedTuple):
    """A measurement of a plant.

    Attributes:
        t: Time of the measurement, s.
        q: Configuration (nq,), with the planar pose of the root link; :meth:`Robot.state` makes it
            from named readings.
        nu: Quasi-velocities (dof,), m/s or rad/s.
    """

    t: float
    q: Array
    nu: Array


class RunningPlant(Protocol):
    """A robot that runs in a simulator."""

    def step(self, command: ControllerOutput, dt: float) -> PlantSample:
        """Simulate the robot for ``dt``; return the measurement at the end.

        Args:
            command: The controller's output, held for ``dt``.
            dt: Duration, s.

        Raises:
            DivergedError: The state is no longer finite.
        """


@runtime_checkable
class PlantModel(Protocol):
    """A simulator of the user: it starts a robot."""

    def start(self, robot: Robot, rest: Rest) -> RunningPlant:
        """Return the robot at the start of a run.

        Args:
            robot: The robot.
            rest: The state at t = 0, and the efforts that hold the robot there in the model.

        Returns:
            The running plant, whose ``step(command, dt)`` returns a :class:`PlantSample`.
        """
