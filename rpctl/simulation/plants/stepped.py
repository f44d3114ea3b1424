"""A plant by itself: whoever steps it closes the loop."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.interfaces import PlantState
from rpctl.simulation.plants.named import plant_by_name
from rpctl.simulation.plants.protocol import PlantSample
from rpctl.simulation.plants.sensors import Measurement
from rpctl.simulation.plants.starting import start_interface


class SteppedPlant:
    """A robot that runs, as :class:`~rpctl.simulation.plants.protocol.RunningPlant` has it.

    Dropped samples, jitter and computing time are those of a loop, and are left to it.

    Args:
        robot: The robot as its controller knows it.
        config: Its plant, and the period by which delays count.
        q: Where it starts (nq,), at rest.

    Attributes:
        rest: Its start, and the efforts that hold it there.
        sample: What was measured last.
    """

    def __init__(self, robot: Robot, config: Config, q: Array) -> None:
        simulated = config.plant.simulated_dynamics(ReducedDynamics(robot))
        holding = simulated.efforts(q, simulated.bias(q, np.zeros(robot.dof)))
        self.rest = Rest(q, np.asarray(holding - config.plant.bias(robot)))
        self._interface = start_interface(simulated, config, self.rest)
        self._measure = Measurement(robot, config.plant)
        self.sample = self._measured(0.0)

    @property
    def state(self) -> PlantState:
        """The true state, which no controller sees."""
        return self._interface.state

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended so far, in sentences."""
        return self._interface.notes

    def step(self, command: ControllerOutput, dt: float) -> PlantSample:
        """Advance the robot; return what is measured of it then.

        Args:
            command: What the controller sends; it holds until the next.
            dt: For how long, s.

        Raises:
            DivergedError: The state left the finite numbers.
        """
        self._interface.take(command)
        self._interface.advance(dt)
        self.sample = self._measured(self.sample.t + dt)
        return self.sample

    def _measured(self, t: float) -> PlantSample:
        state = self._interface.state
        return PlantSample(t, *self._measure(state.q, state.nu, t))


def start_plant(
    robot: Robot,
    plant: str | Plant = "contact",
    q: Array | None = None,
    friction: float = RunSettings.friction,
    period: float = RunSettings.control_period,
) -> SteppedPlant:
    """Return a plant that runs, to be stepped by a controller of whatever kind.

    Args:
        robot: The robot as its controller knows it.
        plant: ``"ideal"``, ``"perturbed"``, ``"slipping"``, ``"contact"``, or its settings.
        q: Where it starts (nq,), at rest; None: its home at the origin.
        friction: Coefficient between wheels and ground.
        period: Control period, s, by whole numbers of which commands are delayed.

    Raises:
        UnknownNameError: There is no such plant.
        RpctlError: The robot cannot be simulated so, or what simulates it is not installed.
    """
    chosen = plant_by_name(plant, robot) if isinstance(plant, str) else plant
    run = RunSettings(friction=friction, control_period=period)
    return SteppedPlant(
        robot, Config(run=run, plant=chosen), robot.configuration() if q is None else q
    )
