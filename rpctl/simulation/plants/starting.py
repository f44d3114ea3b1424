"""The plants by name, their start as a configuration says what they are, and a plant by itself."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.control.steady_motion import Posture
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.standing import stand_at_home
from rpctl.errors import RpctlError, require_known
from rpctl.reference.motion import ReferenceState
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, as_config
from rpctl.simulation.plants.contact import LeaningMotion, MujocoMotion, ServoInterface
from rpctl.simulation.plants.interfaces import (
    ArmInterface,
    EffortInterface,
    Interface,
    OwnInterface,
    PlantState,
    SpeedInterface,
)
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.protocol import Motion, PlantSample
from rpctl.simulation.plants.rolling import RollingMotion, SlippingMotion
from rpctl.simulation.plants.sensors import Measurement

PLANTS = ("ideal", "perturbed", "slipping", "contact")
MASS_RATIO = 1.1  # of what the controller takes the masses for: a battery, a tool, a payload
ROLLING_RESISTANCE = 0.02  # of the weight: a rubber tyre on carpet; hard floors take half
DELAY_S = 0.005  # s: a fieldbus and a drive's own loop
OF_EFFORTS = ("effort", "effort_lag", "backlash", "jitter", "wrenches")  # fields of a plant


def plant_by_name(name: str, robot: Robot, given: Plant | None = None) -> Plant:
    """Return the plant of a name.

    Args:
        name: ``"ideal"``: the controller's model itself. ``"perturbed"``: it, with differences.
            ``"slipping"``: on tyres; ``"contact"``: in MuJoCo.
        robot: The robot.
        given: The differences; of a perturbed plant without any, those of :func:`perturbed_plant`.

    Raises:
        UnknownNameError: There is no such plant.
    """
    given = given or Plant()
    if name == "ideal":
        return Plant()
    if name == "perturbed":
        rolling = replace(given, kind="rolling")
        return perturbed_plant(robot) if rolling == Plant() else rolling
    require_known("plant", [name], PLANTS)
    return replace(given, kind=name)


def perturbed_plant(robot: Robot) -> Plant:
    """Return a plant that is heavier than its controller knows, rolls less freely and acts late.

    The driven wheels share the rolling resistance of the robot's weight.
    """
    wheels = [wheel for wheel in robot.drive.wheels if wheel.joint in robot.actuators]
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    weight = mass * float(np.linalg.norm(robot.model.gravity.linear))
    friction = {
        wheel.joint: float(ROLLING_RESISTANCE * weight * wheel.radius / len(wheels))
        for wheel in wheels
    }
    return Plant(delay=DELAY_S, joint_friction=friction, masses={"*": MASS_RATIO})


def rest_at(
    simulated: ReducedDynamics, plant: Plant, q: Array, first: ReferenceState | None = None
) -> Rest:
    """Return the simulated robot at rest at q (nq,), and the efforts that hold it there.

    One that leans is put into balance; a bicycle goes as its reference does at first.

    Raises:
        RpctlError: It is a bicycle, and its reference too slow for it; or its mass lies beyond
            its wheels.
    """
    if isinstance(simulated.robot, LeaningRobot):
        robot, pose = simulated.robot, simulated.robot.base_pose(q)
        standing = stand_at_home(simulated)
        if standing is not None and standing.fault:
            raise RpctlError(
                f"{robot.name} falls over, and no law helps: {standing.fault}; set its wheels "
                "further apart, or its masses between them"
            )
        posture = Posture(ReducedDynamics(_at_heading(robot, pose[2])))
        if first is not None and robot.rolls_sideways:
            robot.require_speed(float(first.twist[0]))
            v, _, omega = posture.possible(first).twist.tolist()
            steady = posture.steady(v, omega, first.joints)
            return Rest(robot.placed(steady.q, pose), steady.tau, steady.nu)
        steady = posture.steady(0.0, 0.0, robot.joint_positions(q))
        return Rest(robot.placed(steady.q, pose), steady.tau)
    holding = simulated.efforts(q, simulated.bias(q, np.zeros(simulated.robot.dof)))
    return Rest(q, np.asarray(holding - plant.bias(simulated.robot)))


def _at_heading(robot: LeaningRobot, theta: float) -> LeaningRobot:
    """Return a robot to which gravity is at a heading of 0 what it is to another at θ (rad)."""
    x, y, z = robot.model.gravity.linear.tolist()
    if not (x or y):
        return robot
    cos, sin, model = math.cos(theta), math.sin(theta), robot.model.copy()
    model.gravity.linear = np.array([cos * x + sin * y, cos * y - sin * x, z])
    return replace(robot, model=model)


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
        return OwnInterface(plant.own.start(dynamics.robot, rest), rest, dynamics.robot.dof)
    if config.output is not None:
        if plant.kind not in ("rolling", "contact"):
            raise RpctlError(
                f"the {plant.kind} plant takes efforts; leave out --output, or take the plant "
                "ideal, perturbed or contact"
            )
        for name in OF_EFFORTS:
            if getattr(plant, name) != getattr(Plant(), name):
                raise RpctlError(
                    f"{name} of the plant applies to robots that take efforts; this robot takes "
                    "speeds: leave out --output velocity"
                )
        if plant.kind == "contact":
            motion = MujocoMotion(dynamics.robot, plant.contact, config.run.friction, rest.q)
            return ServoInterface(motion, dynamics, config, rest)
        joints = config.output.on(dynamics.robot).sent_efforts(dynamics.robot)
        return (ArmInterface if joints else SpeedInterface)(dynamics, config, rest)
    if plant.lag is not None or plant.lags or plant.dead_time is not None:
        raise RpctlError(
            "the plant has a lag or a dead time, which apply to robots that take speeds; add the "
            "table [output], or --output velocity"
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
            "the plant was a simulator of the user's, which a file cannot store; give another kind"
        )
    if plant.kind == "slipping":
        return SlippingMotion(dynamics.robot, plant.slipping, run.friction, rest.q, run.plant_step)
    if plant.kind == "contact":
        if not isinstance(dynamics.robot, LeaningRobot):
            return MujocoMotion(dynamics.robot, plant.contact, run.friction, rest.q)
        touching = LeaningMotion(dynamics.robot, plant.contact, run.friction, rest.q)
        if rest.nu is not None:
            touching.start(rest.nu)
        return touching
    rolling = RollingMotion(dynamics, rest.q, run.plant_step)
    rolling.nu = rolling.nu if rest.nu is None else rest.nu
    return rolling


class SteppedPlant:
    """A simulated robot, a :class:`~rpctl.simulation.plants.protocol.RunningPlant`.

    It simulates no dropped samples, jitter or computing time: these belong to the loop.

    Args:
        robot: The robot as its controller knows it.
        config: The plant, and the control period in which delays are counted.
        q: Configuration at the start (nq,), at rest.

    Attributes:
        rest: The state at the start, and the efforts that hold it.
        sample: The last measurement.
    """

    def __init__(self, robot: Robot, config: Config, q: Array) -> None:
        simulated = config.plant.simulated_dynamics(ReducedDynamics(robot))
        self.rest = rest_at(simulated, config.plant, q)
        self._interface = start_interface(simulated, config, self.rest)
        self._measure = Measurement(robot, config.plant)
        self.sample = self._measured(0.0)

    @property
    def state(self) -> PlantState:
        """The true state, without errors of sensors."""
        return self._interface.state

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was assumed or changed so far."""
        return self._interface.notes

    def step(self, command: ControllerOutput, dt: float) -> PlantSample:
        """Simulate the robot for ``dt``; return the measurement at the end.

        Args:
            command: The controller's output, held for ``dt``.
            dt: Duration, s.

        Raises:
            DivergedError: The state is no longer finite.
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
    plant: str | Plant | None = None,
    q: Array | None = None,
    *,
    config: Config | str | Path | None = None,
    friction: float | None = None,
    period: float | None = None,
) -> SteppedPlant:
    """Return a simulated robot that any controller can step.

    Args:
        robot: The robot as its controller knows it.
        plant: ``"ideal"``, ``"perturbed"``, ``"slipping"``, ``"contact"``, or the settings of a
            plant; None: that of ``config``, or ``"contact"``.
        q: Configuration at the start (nq,), at rest; None: the root link at the origin, all joints
            at 0. A robot that leans is put into balance there.
        config: A configuration, or the path of its TOML file: it says whether the robot takes
            speeds, and has the settings that the other arguments leave out.
        friction: Coefficient of friction between wheels and ground; default: 0.7.
        period: Control period, s; delays are whole multiples of it; default: 2 ms.

    Returns:
        The plant; its ``step(command, dt)`` returns a :class:`PlantSample`.

    Raises:
        UnknownNameError: There is no such plant.
        RpctlError: This plant cannot simulate the robot, or a package that it needs is missing.
    """
    told = as_config(config, robot).with_run(friction=friction, control_period=period)
    if plant is None and config is None:
        plant = "contact"
    chosen = plant_by_name(plant, robot) if isinstance(plant, str) else plant or told.plant
    robot = told.limits.apply(robot)
    return SteppedPlant(
        robot, replace(told, plant=chosen), robot.configuration() if q is None else q
    )
