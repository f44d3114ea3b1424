"""What a controller's output does to the simulated robot: efforts act, or speeds are followed."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.dynamics.motion import Step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config
from rpctl.simulation.held import HeldCommands
from rpctl.simulation.periods import delay_periods
from rpctl.simulation.plant import Plant, advance
from rpctl.simulation.velocity_plant import VelocityPlant

NOT_YET = (
    "effort", "effort_lag", "backlash", "encoder_bits", "sensor_bias", "jitter", "wrenches"
)  # fmt: skip


class Interface(Protocol):
    """The simulated robot between two samples of its controller."""

    def take(self, output: ControllerOutput, q: Array, nu: Array, late: float = 0.0) -> Array:
        """Take what is sent at a sample; return the efforts (n_act,) of the coming period.

        Args:
            output: What the controller sends.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            late: How much after the sample it is sent, s.
        """

    def advance(self, q: Array, nu: Array) -> Step:
        """Advance the robot by a control period.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).

        Raises:
            DivergedError: The state left the finite numbers.
        """


def start_interface(dynamics: ReducedDynamics, config: Config, rest: Rest) -> Interface:
    """Return the interface of the simulated robot, at rest.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and which output the controller has.
        rest: Its state, and the efforts that hold it.

    Raises:
        RpctlError: The plant has a lag or a dead time, but its controller sends efforts.
    """
    for name in NOT_YET:
        if getattr(config.plant, name) != getattr(Plant(), name):
            raise RpctlError(f"this version does not simulate {name} of a plant; leave it out")
    if config.output is not None:
        return SpeedInterface(dynamics, config)
    plant = config.plant
    if plant.lag is not None or plant.lags or plant.dead_time is not None:
        raise RpctlError(
            "the plant has a lag or a dead time, which robots have that take speeds; add the table "
            "[output], or --output velocity"
        )
    return EffortInterface(dynamics, config, rest)


class EffortInterface:
    """A robot that takes efforts; they act after the plant's delay.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant.
        rest: Efforts that hold it until the first ones act.
    """

    def __init__(self, dynamics: ReducedDynamics, config: Config, rest: Rest) -> None:
        robot, plant = dynamics.robot, config.plant
        self._dynamics, self._run = dynamics, config.run
        self._bias = plant.bias(robot)
        self._sent = plant.pipeline(rest.tau, config.run.control_period)
        self._held, self._t = HeldCommands(rest.tau), 0.0

    def take(self, output: ControllerOutput, q: Array, nu: Array, late: float = 0.0) -> Array:
        """Take efforts; see :class:`Interface`.

        Args:
            output: What the controller sends.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            late: How much after the sample it is sent, s.
        """
        self._sent.append(output.efforts)
        self._held.send(self._t + late, self._sent.popleft())
        return self._held.at(self._t)

    def advance(self, q: Array, nu: Array) -> Step:
        """Advance the robot by a control period; see :class:`Interface`."""
        run, work, lost = self._run, 0.0, 0.0
        for duration, tau in self._held.during(self._t, run.control_period):
            push = tau + self._bias
            q, nu, done, gone = advance(self._dynamics, q, nu, push, duration, run.plant_step)
            work, lost = work + done, lost + gone
        self._t += run.control_period
        return Step(q, nu, work, lost)


class SpeedInterface:
    """A robot that takes speeds, and whose own controllers find the efforts that follow them.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
    """

    def __init__(self, dynamics: ReducedDynamics, config: Config) -> None:
        robot, plant, run = dynamics.robot, config.plant, config.run
        if config.output is None:
            raise RpctlError("the controller sends efforts, not speeds")
        truth = plant.velocity_interface(config.output)
        late = delay_periods(plant.delay, run.control_period) * run.control_period
        self._dynamics = dynamics
        self._bias = plant.bias(robot)
        self._held, self._t = HeldCommands(np.zeros(robot.dof)), 0.0
        self._period = run.control_period
        self._plant = VelocityPlant(
            dynamics,
            truth.lag_of(robot.quasi_velocities),
            truth.dead_time + late,
            run.control_period,
            run.plant_step,
        )

    def take(self, output: ControllerOutput, q: Array, nu: Array, late: float = 0.0) -> Array:
        """Take speeds; return the efforts that the mean acceleration of the period takes.

        Args:
            output: What the controller sends.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            late: How much after the sample they are sent, s; they count from the next sample on.
        """
        self._held.send(self._t + late, output.speeds)
        self._plant.send(self._held.at(self._t))
        self._t += self._period
        dynamics = self._dynamics
        force = dynamics.inverse(q, nu, self._plant.acceleration(nu))
        return np.asarray(dynamics.efforts(q, force) - self._bias)

    def advance(self, q: Array, nu: Array) -> Step:
        """Advance the robot by a control period; see :class:`Interface`."""
        return self._plant.advance(q, nu)
