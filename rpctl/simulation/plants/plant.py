"""The plant of a run: what moves the robot, and how that differs from the controller's model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.output_groups import DEAD_TIME, LAG
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import LARGEST, RpctlError, UnknownNameError
from rpctl.files.records import (
    IN_PYTHON,
    NOT_NEGATIVE,
    POSITIVE,
    SHARE,
    WITHIN,
    OneOf,
    Range,
    Setting,
)
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.robot.variation import Variation, vary
from rpctl.simulation.plants.protocol import PlantModel
from rpctl.simulation.plants.settings import (
    MAX_BITS,
    Noise,
    SensorBias,
    Slipping,
    Wrench,
)

SIMULATED = ("rolling", "slipping", "contact")  # kinds that rpctl simulates itself
PLANT_KINDS = (*SIMULATED, "own")


MAX_SEED = 2**63 - 1  # a file's largest whole number


@dataclass(frozen=True, kw_only=True)
class Plant(Variation):
    """Differences between the simulated robot and the controller's model."""

    tau_bias: Annotated[
        Mapping[str, float],
        WITHIN,
        Setting(
            "N·m or N",
            "Bias",
            "Constant efforts added to the controller's, by pattern of actuator names; the last "
            "match counts.",
        ),
    ] = field(default_factory=dict)
    delay: Annotated[
        float,
        Range(0.0, LARGEST, "a time in s, 0 or more"),
        Setting(
            "s",
            "Delay",
            "Time from a measurement to the efforts that answer it, rounded to whole control "
            "periods.",
        ),
    ] = 0.0
    controller_model: Annotated[Robot | None, IN_PYTHON] = None
    dropped: Annotated[
        float,
        SHARE,
        Setting(
            "",
            "Fraction of samples dropped",
            "Fraction of the samples that never reach the controller, chosen at random by the "
            "seed; the first one always arrives.",
        ),
    ] = 0.0
    computing_time: Annotated[
        float | str,
        Range(0.0, LARGEST, "a time in s, 0 or more"),
        Setting(
            "s",
            "Computing time",
            'Time that computing takes, or "measured" for the processor\'s time. Efforts act '
            "that much later, and samples due meanwhile are missed. For a law that plans now and "
            "then, a number is the time of one plan; else of one sample.",
        ),
    ] = 0.0
    lag: Annotated[
        float | None,
        LAG,
        Setting(
            "s",
            "Lag",
            "Lag with which a robot follows speeds; default: the lag that the controller assumes.",
        ),
    ] = None
    lags: Annotated[
        Mapping[str, float],
        LAG,
        Setting("s", "Lag", "Lag by name of the quasi-velocity, where it differs."),
    ] = field(default_factory=dict)
    dead_time: Annotated[
        float | None,
        DEAD_TIME,
        Setting(
            "s",
            "Dead time",
            "Dead time before a robot follows speeds; default: the dead time that the controller "
            "assumes.",
        ),
    ] = None
    effort: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "Scale of the effort limits",
            "Scale of the effort limits at which the true actuators saturate.",
        ),
    ] = 1.0
    effort_lag: Annotated[
        float,
        NOT_NEGATIVE,
        Setting("s", "Lag of efforts", "First-order lag between commanded and true efforts."),
    ] = 0.0
    backlash: Annotated[
        Mapping[str, float],
        NOT_NEGATIVE,
        Setting(
            "rad or m",
            "Backlash",
            "Backlash between actuator and joint, by pattern of actuator names.",
        ),
    ] = field(default_factory=dict)
    encoder_bits: Annotated[
        int,
        Range(0, MAX_BITS, f"a whole number from 0 to {MAX_BITS}"),
        Setting("", "", "Bits of the joints' encoders; 0: exact."),
    ] = 0
    sensor_bias: Annotated[
        SensorBias,
        Setting("", "Constant error", "Constant errors of what the controller measures."),
    ] = field(default_factory=SensorBias)
    jitter: Annotated[
        float,
        NOT_NEGATIVE,
        Setting(
            "s",
            "Jitter of samples",
            "Standard deviation of the sampling times; none is off by more than 0.45 control "
            "periods, so they stay in order.",
        ),
    ] = 0.0
    wrenches: Annotated[
        tuple[Wrench, ...],
        Setting("", "Push", "Forces and moments on the simulated robot from outside."),
    ] = ()
    noise: Annotated[
        Noise, Setting("", "", "Standard deviations of what the controller measures.")
    ] = field(default_factory=Noise)
    seed: Annotated[
        int,
        Range(0, MAX_SEED, "a whole number, 0 or more"),
        Setting("", "", "Seed of all random numbers."),
    ] = 0
    kind: Annotated[
        str,
        OneOf(PLANT_KINDS),
        Setting(
            "",
            "",
            "Simulator: rolling, wheels that roll without slipping, as in the controller's "
            "model; slipping, tyres; contact, MuJoCo; own, a simulator of the user's. The "
            "friction coefficient is that of [run].",
        ),
    ] = "rolling"
    slipping: Annotated[Slipping, Setting("", "", "Tyres of the slipping plant.")] = field(
        default_factory=Slipping
    )
    contact: Annotated[
        ContactSettings, Setting("", "", "Contacts of the robot with the ground in MuJoCo.")
    ] = field(default_factory=ContactSettings)
    own: Annotated[PlantModel | None, IN_PYTHON] = None

    def __post_init__(self) -> None:
        """Refuse what is no plant."""
        super().__post_init__()
        if isinstance(self.computing_time, str) and self.computing_time != "measured":
            raise RpctlError(
                f'computing_time is {self.computing_time!r}; give seconds, or "measured"'
            )
        if type(self.encoder_bits) is not int:
            raise RpctlError(
                f"encoder_bits is {self.encoder_bits}; give a whole number from 0 to {MAX_BITS}"
            )

    def velocity_interface(self, output: VelocityOutput) -> VelocityOutput:
        """Return lag and dead time with which the simulated robot follows speeds.

        Args:
            output: The output as the controller knows it, with the settings of its groups.
        """
        lag, dead = self.lag, self.dead_time
        return replace(
            output,
            lag=output.lag if lag is None else lag,
            lags={**(output.lags if lag is None else {}), **self.lags},
            dead_time=output.dead_time if dead is None else dead,
            dead_times=output.dead_times if dead is None else {},
        )

    def bias(self, robot: Robot) -> Array:
        """Return the constant efforts (n_act,), N·m or N, that act besides the controller's.

        Args:
            robot: The robot.

        Raises:
            UnknownNameError: A pattern matches no actuator.
        """
        found = by_pattern(self.tau_bias, robot.actuators, "actuator")
        return np.array([found.get(name, 0.0) for name in robot.actuators])

    def saturation(self, robot: Robot) -> Array:
        """Return the efforts (n_act,), N·m or N, at which the true actuators saturate.

        With an effort scale of 1 they are infinite: commands act even beyond the limits of the
        robot's file, and the summary of a run reports the excess.

        Args:
            robot: The robot, with the limits that its controller knows.
        """
        limits = robot.effort_limits
        return np.full(len(limits), math.inf) if self.effort == 1.0 else self.effort * limits

    def simulated_dynamics(self, dynamics: ReducedDynamics) -> ReducedDynamics:
        """Return the dynamics of the simulated robot.

        Args:
            dynamics: The dynamics of the robot as its controller knows it.

        Raises:
            UnknownNameError: A pattern matches no link, joint, wheel or actuator.
            RpctlError: A wheel would not reach the ground, or the inertia would not be physical.
        """
        robot = self.simulated_robot(dynamics.robot)
        return dynamics if robot is dynamics.robot else ReducedDynamics(robot)

    def simulated_robot(self, robot: Robot) -> Robot:
        """Return the simulated robot, which differs from the one that its controller knows.

        Args:
            robot: The robot as its controller knows it; returned itself if nothing differs.

        Raises:
            UnknownNameError: A pattern matches no link, joint, wheel or actuator.
            RpctlError: A wheel would not reach the ground, or the inertia would not be physical.
        """
        for each in self.wrenches:
            if not robot.model.existBodyName(each.link):
                raise UnknownNameError("link", each.link, robot.description.link)
        return vary(robot, self)

    def known_dynamics(self, dynamics: ReducedDynamics) -> ReducedDynamics:
        """Return the dynamics of the controller's model.

        Args:
            dynamics: The dynamics of the simulated robot, without the plant's differences.

        Raises:
            RpctlError: The controller's model has other coordinates than the simulated robot.
        """
        robot = self.known_robot(dynamics.robot)
        return dynamics if robot is dynamics.robot else ReducedDynamics(robot)

    def known_robot(self, robot: Robot) -> Robot:
        """Return the controller's model.

        Args:
            robot: The simulated robot, without the plant's differences.

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
                    "vary only its masses or limits"
                )
        return model

    def arrives(self, samples: int) -> NDArray[np.bool_]:
        """Return whether each sample (samples,) reaches the controller.

        Args:
            samples: Number of samples.
        """
        arrives = np.random.default_rng(self.seed).random(samples) >= self.dropped
        arrives[:1] = True
        return np.asarray(arrives)
