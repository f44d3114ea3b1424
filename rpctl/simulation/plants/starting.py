"""The start of a plant, as a configuration says what it is."""

from __future__ import annotations

from rpctl.control.law import Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.contact import MujocoMotion
from rpctl.simulation.plants.interfaces import (
    EffortInterface,
    Interface,
    OwnInterface,
    SpeedInterface,
)
from rpctl.simulation.plants.motion import Motion
from rpctl.simulation.plants.rolling import RollingMotion
from rpctl.simulation.plants.slipping import SlippingMotion

OF_EFFORTS = ("effort", "effort_lag", "backlash", "jitter", "wrenches")  # fields of a plant


def start_interface(dynamics: ReducedDynamics, config: Config, rest: Rest) -> Interface:
    """Return the simulated robot, at rest.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and which output the controller has.
        rest: Its state, and the efforts that hold it.

    Raises:
        RpctlError: The plant has a lag or a dead time, but its controller sends efforts; it takes
            efforts, but its controller sends speeds; or what simulates it is not installed.
    """
    plant = config.plant
    if plant.own is not None:
        running = plant.own.start(dynamics.robot, rest)
        return OwnInterface(running, rest, dynamics.robot.dof)
    if config.output is not None:
        if plant.kind != "rolling":
            raise RpctlError(
                f"the {plant.kind} plant takes efforts; leave out --output velocity, or take the "
                "plant ideal or perturbed"
            )
        for name in OF_EFFORTS:
            if getattr(plant, name) != getattr(Plant(), name):
                raise RpctlError(
                    f"{name} of the plant is of robots that take efforts; this one follows the "
                    "speeds that it is sent, whatever that takes: leave out --output velocity"
                )
        return SpeedInterface(dynamics, config, rest)
    if plant.lag is not None or plant.lags or plant.dead_time is not None:
        raise RpctlError(
            "the plant has a lag or a dead time, which robots have that take speeds; add the table "
            "[output], or --output velocity"
        )
    return EffortInterface(start_motion(dynamics, config, rest), dynamics, config, rest)


def start_motion(dynamics: ReducedDynamics, config: Config, rest: Rest) -> Motion:
    """Return what moves the simulated robot, at rest.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant.
        rest: Its state, and the efforts that hold it.

    Raises:
        RpctlError: The robot cannot be simulated so, or what simulates it is not installed.
    """
    plant, run = config.plant, config.run
    if plant.kind == "own":
        raise RpctlError(
            "the plant was a simulator of the user's, which no file can hold; give another kind"
        )
    if plant.kind == "slipping":
        return SlippingMotion(dynamics.robot, plant.slipping, run.friction, rest.q, run.plant_step)
    if plant.kind == "contact":
        return MujocoMotion(dynamics.robot, plant.contact, run.friction, rest.q)
    return RollingMotion(dynamics, rest.q, run.plant_step)
