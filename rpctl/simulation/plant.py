"""The plant of a run: what moves the robot, and how that differs from the controller's model."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.settings import NO_FILE_CAN_SAY
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import RpctlError, UnknownNameError, require_positive, require_within
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.robot.slope import Slope, on_slope, require_slope
from rpctl.robot.variation import Offset, Variation, vary
from rpctl.robot.vary import add_friction, scale_losses
from rpctl.simulation.noise import Noise
from rpctl.simulation.periods import delay_periods
from rpctl.simulation.plants.carried_load import CarriedLoad
from rpctl.simulation.plants.protocol import PlantModel
from rpctl.simulation.plants.sensor_settings import SensorBias, require_bits
from rpctl.simulation.plants.slipping import Slipping
from rpctl.simulation.plants.wrench import Wrench

SIMULATED = ("rolling", "slipping", "contact")  # kinds that rpctl simulates itself
PLANT_KINDS = (*SIMULATED, "own")


def require_not_negative(name: str, value: float) -> None:
    """Refuse what is no finite number of 0 or more.

    Raises:
        RpctlError: It is not.
    """
    require_within(name, [value])
    if value < 0.0:
        raise RpctlError(f"{name} is {value:g}; give 0 or more")


@dataclass(frozen=True)
class Plant:
    """Differences between the simulated robot and the controller's model.

    Attributes:
        tau_bias: Efforts (N·m or N) that push besides the controller's, by pattern of the names of
            actuators; the last that matches counts.
        delay: Time from a measurement to the efforts it leads to, s; the nearest whole number of
            control periods is simulated, halves up, and logged.
        controller_model: The robot that the controller computes with; None: the simulated one.
        joint_friction: Dry friction (N·m or N), which the simulated robot has besides what the
            controller knows, by pattern of the names of actuators; the last that
            matches counts.
        dropped: Share of the samples that never reach the controller, 0 or more and below 1. Which
            ones is drawn, and the same in every run of one seed; the first one arrives.
        computing_time: Time that computing takes, s, or "measured": the processor's time. The
            efforts of a sample come as much later, and what would be sampled meanwhile is missed. A
            stated time is that of a plan, for a law that plans now and then, or else of a sample.
        masses: Scales of masses by pattern of link names, as of
            :class:`~rpctl.robot.variation.Variation`, like the five that follow: the simulated
            robot has them, its controller does not know of them.
        centres: Offsets of centres of mass (x, y, z), m, by pattern of link names.
        inertias: Scales of inertias by pattern of link names.
        radii: Scales of radii by pattern of wheel joints.
        track: Scale of the track.
        damping: Added damping, N·m·s/rad or N·s/m, by pattern of joint names.
        payload: A load that the simulated robot carries.
        losses: Scale of the damping and dry friction of the simulated robot's own joints, without
            those that the plant adds.
        effort: Scale of the effort limits at which the true actuators saturate.
        effort_lag: First-order lag between commanded and true efforts, s.
        backlash: Width of the gap between actuator and joint, rad or m, by pattern of the names of
            actuators; see :class:`~rpctl.simulation.plants.actuators.Actuators`.
        encoder_bits: Bits of the joints' encoders; 0: exact. See
            :class:`~rpctl.simulation.plants.sensors.Measurement`.
        sensor_bias: Constant errors of what the controller measures.
        jitter: Standard deviation of the moments at which the controller samples, s; none is
            farther off than .45 of a control period, so they stay in order.
        slope: Angles (2,), rad, by which the ground rises along the x and the y axis of the world;
            the world's frame stays that of the ground.
        wrenches: What pushes and pulls the simulated robot from outside.
        noise: Of what the controller measures.
        lag: Of a robot that takes speeds, the lag with which it follows them, s; None: as the
            controller knows it.
        lags: Lag by name of the quasi-velocity, where it differs, s.
        dead_time: Time until such a robot begins to follow, s; None: as the controller knows it.
        seed: Of all that is drawn at random.
        kind: What moves it: ``"rolling"``, wheels that roll without slipping, as the controller's
            model has it; ``"slipping"``, tyres; ``"contact"``, MuJoCo; ``"own"``, what
            ``own`` is. The coefficient of friction is the run's.
        slipping: The tyres of a slipping one.
        contact: How a robot in MuJoCo meets the ground.
        own: A simulator of the user's in their place, in which nothing else of a plant counts.
    """

    tau_bias: Mapping[str, float] = field(default_factory=dict)
    delay: float = 0.0
    controller_model: Robot | None = field(default=None, metadata=NO_FILE_CAN_SAY)
    joint_friction: Mapping[str, float] = field(default_factory=dict)
    dropped: float = 0.0
    computing_time: float | str = 0.0
    lag: float | None = None
    lags: Mapping[str, float] = field(default_factory=dict)
    dead_time: float | None = None
    masses: Mapping[str, float] = field(default_factory=dict)
    centres: Mapping[str, Offset] = field(default_factory=dict)
    inertias: Mapping[str, float] = field(default_factory=dict)
    radii: Mapping[str, float] = field(default_factory=dict)
    track: float = 1.0
    damping: Mapping[str, float] = field(default_factory=dict)
    payload: CarriedLoad = field(default_factory=CarriedLoad)
    losses: float = 1.0
    effort: float = 1.0
    effort_lag: float = 0.0
    backlash: Mapping[str, float] = field(default_factory=dict)
    encoder_bits: int = 0
    sensor_bias: SensorBias = field(default_factory=SensorBias)
    jitter: float = 0.0
    slope: Slope = (0.0, 0.0)
    wrenches: tuple[Wrench, ...] = ()
    noise: Noise = field(default_factory=Noise)
    seed: int = 0
    kind: str = "rolling"
    slipping: Slipping = field(default_factory=Slipping)
    contact: ContactSettings = field(default_factory=ContactSettings)
    own: PlantModel | None = field(default=None, metadata=NO_FILE_CAN_SAY)

    def __post_init__(self) -> None:
        """Refuse what is no time or no effort."""
        if self.kind not in PLANT_KINDS:
            raise UnknownNameError("plant", self.kind, PLANT_KINDS)
        if not (math.isfinite(self.delay) and self.delay >= 0.0):
            raise RpctlError(f"delay is {self.delay:g}; give a time in s, 0 or more")
        require_within("delay", [self.delay])
        if not 0.0 <= self.dropped < 1.0:
            raise RpctlError(f"dropped is {self.dropped:g}; give a share from 0 to less than 1")
        if isinstance(self.computing_time, str):
            if self.computing_time != "measured":
                raise RpctlError(
                    f'computing_time is {self.computing_time!r}; give seconds, or "measured"'
                )
        elif not (math.isfinite(self.computing_time) and self.computing_time >= 0.0):
            raise RpctlError(
                f"computing_time is {self.computing_time:g}; give a time in s, 0 or more"
            )
        else:
            require_within("computing_time", [self.computing_time])
        for name, bias in self.tau_bias.items():
            require_within(f"tau_bias of {name}", [bias])
        for name, friction in self.joint_friction.items():
            if not (math.isfinite(friction) and friction >= 0.0):
                raise RpctlError(
                    f"joint_friction of {name} is {friction:g}; give an effort of 0 or more"
                )
            require_within(f"joint_friction of {name}", [friction])
        if self.seed < 0:
            raise RpctlError(f"seed is {self.seed}; give a whole number, 0 or more")
        require_positive("effort", self.effort)
        require_not_negative("losses", self.losses)
        require_not_negative("effort_lag", self.effort_lag)
        require_not_negative("jitter", self.jitter)
        for name, gap in self.backlash.items():
            require_not_negative(f"backlash of {name}", gap)
        require_bits(self.encoder_bits)
        require_slope(self.slope)
        self.variation  # noqa: B018 (refuses what no robot can have)
        VelocityOutput(self.lag or 0.0, self.dead_time or 0.0, self.lags)

    @property
    def variation(self) -> Variation:
        """How the simulated robot was built otherwise than the controller's model."""
        return Variation(
            self.masses, self.centres, self.inertias, self.radii, self.track, self.damping
        )

    def velocity_interface(self, output: VelocityOutput) -> VelocityOutput:
        """Return how the simulated robot follows speeds.

        Args:
            output: How the controller knows it.
        """
        lags = self.lags if self.lag is not None or self.lags else output.lags
        return replace(
            output,
            lag=output.lag if self.lag is None else self.lag,
            lags=lags,
            dead_time=output.dead_time if self.dead_time is None else self.dead_time,
        )

    def bias(self, robot: Robot) -> Array:
        """Return the efforts (n_act,) that push besides the controller's.

        Raises:
            UnknownNameError: One is of no actuator.
        """
        found = by_pattern(self.tau_bias, robot.actuators, "actuator")
        return np.array([found.get(name, 0.0) for name in robot.actuators])

    def saturation(self, robot: Robot) -> Array:
        """Return the efforts (n_act,) beyond which the true actuators have none, N·m or N.

        An effort scale of 1 leaves commands as they are, even beyond the limits of the robot's
        file: there the summary of a run tells what was exceeded.

        Args:
            robot: The robot, with the limits that its controller knows.
        """
        limits = robot.effort_limits
        return np.full(len(limits), math.inf) if self.effort == 1.0 else self.effort * limits

    def simulated_dynamics(self, dynamics: ReducedDynamics) -> ReducedDynamics:
        """Return the dynamics of the simulated robot.

        Args:
            dynamics: Those of the robot that varies.

        Raises:
            UnknownNameError: Something that varies is of no link, joint, wheel or actuator.
            RpctlError: A wheel would not reach the ground, or there would be no dynamics.
        """
        robot = self.simulated_robot(dynamics.robot)
        return dynamics if robot is dynamics.robot else ReducedDynamics(robot)

    def simulated_robot(self, robot: Robot) -> Robot:
        """Return the robot that is simulated, which the controller takes for another.

        Args:
            robot: The one that varies; itself where nothing does.

        Raises:
            UnknownNameError: Something that varies is of no link, joint, wheel or actuator.
            RpctlError: A wheel would not reach the ground, or there would be no dynamics.
        """
        for each in self.wrenches:
            if not robot.model.existBodyName(each.link):
                raise UnknownNameError("link", each.link, robot.description.link)
        friction = by_pattern(self.joint_friction, robot.actuators, "actuator")
        varied = vary(scale_losses(robot, self.losses), self.variation)
        return on_slope(self.payload.on(add_friction(varied, friction)), self.slope)

    def known_dynamics(self, dynamics: ReducedDynamics) -> ReducedDynamics:
        """Return the dynamics that the controller computes with.

        Args:
            dynamics: Of the simulated robot, without what the plant adds.

        Raises:
            RpctlError: The controller's model has other coordinates than the simulated robot.
        """
        robot = self.known_robot(dynamics.robot)
        return dynamics if robot is dynamics.robot else ReducedDynamics(robot)

    def known_robot(self, robot: Robot) -> Robot:
        """Return the robot that the controller computes with.

        Args:
            robot: The simulated robot.

        Raises:
            RpctlError: The controller's model has other coordinates than the simulated robot.
        """
        model = self.controller_model
        if model is None:
            return robot
        for names in ("quasi_velocities", "actuators"):
            if getattr(model, names) != getattr(robot, names):
                raise RpctlError(
                    f"the controller's model, {model.name}, has other {names} than {robot.name}; "
                    "vary its masses or limits only"
                )
        return model

    def arrives(self, samples: int) -> NDArray[np.bool_]:
        """Return of each sample (samples,) whether it reaches the controller."""
        arrives = np.random.default_rng(self.seed).random(samples) >= self.dropped
        arrives[:1] = True
        return np.asarray(arrives)

    def pipeline(self, hold: Array, control_period: float) -> deque[Array]:
        """Return the efforts on their way at the start: those that hold the robot still."""
        return deque([hold] * delay_periods(self.delay, control_period))
