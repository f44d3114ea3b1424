"""Benchmark scenarios (model errors, delay, reduced limits) and the pairs of laws to compare."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference.motion import Reference
from rpctl.reference.quasi_velocities import configuration_along
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses, set_limits
from rpctl.simulation.loop import default_duration
from rpctl.simulation.plant import Plant

ARM_MASS_RATIO = 0.7  # of the arm's mass: what the controller takes it for
BIAS_RATIO = 0.05  # of the first wheel's effort limit
DEFAULT_BIAS_NM = 1.0  # N·m, where it has none
DELAY_S = 0.02  # s
EFFORT_LIMIT_RATIO = 0.5  # of what holding still leaves of each effort limit
HOLDING_SAMPLE_S = 0.1  # s: at a reference, for what holding still takes


class Case(NamedTuple):
    """The robot that is simulated and controlled, and what its controller does not know of."""

    robot: Robot
    plant: Plant


@dataclass(frozen=True)
class Scenario:
    """A disturbance or model error that a run is made with.

    Attributes:
        summary: What it is, in a line.
        make: The case of a robot on a reference.
    """

    summary: str
    make: Callable[[Robot, Reference], Case]


def _light_arm(robot: Robot) -> Case:
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm")
    controller_model = robot
    for joint in robot.joints:
        controller_model = scale_masses(controller_model, glob.escape(joint.name), ARM_MASS_RATIO)
    return Case(robot, Plant(controller_model=controller_model))


def _wheel_bias(robot: Robot) -> Case:
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    for name, limit in zip(robot.actuators, robot.effort_limits, strict=True):
        if name in wheels:
            bias = BIAS_RATIO * float(limit) if np.isfinite(limit) else DEFAULT_BIAS_NM
            return Case(robot, Plant(tau_bias={name: bias}))
    raise RpctlError(f"{robot.name} has no driven wheel")


def _half_limits(robot: Robot, reference: Reference) -> Case:
    """Halve what each effort limit exceeds the largest static effort of the reference by."""
    limits, holding_efforts = robot.effort_limits, _holding_efforts(robot, reference)
    left = limits - EFFORT_LIMIT_RATIO * np.maximum(limits - holding_efforts, 0.0)
    efforts = {
        glob.escape(name): float(limit)
        for name, limit in zip(robot.actuators, left, strict=True)
        if np.isfinite(limit)
    }
    return Case(set_limits(robot, effort=efforts), Plant())


def _holding_efforts(robot: Robot, reference: Reference) -> Array:
    """Return the largest efforts (n_act,) that hold the robot still anywhere on a reference."""
    dynamics, still = ReducedDynamics(robot), np.zeros(robot.dof)
    found = []
    for t in np.arange(0.0, default_duration(reference), HOLDING_SAMPLE_S).tolist():
        q = configuration_along(robot, reference(t))
        found.append(np.abs(dynamics.efforts(q, dynamics.bias(q, still))))
    return np.asarray(np.max(found, axis=0))


SCENARIOS = {
    "nominal": Scenario("the model is right", lambda robot, _: Case(robot, Plant())),
    "arm-mass": Scenario(
        "the controller takes every moving link of the arm to weigh 30 % less than it does",
        lambda robot, _: _light_arm(robot),
    ),
    "wheel-bias": Scenario(
        "the first driven wheel is pushed by 5 % of its effort limit (1 N·m without one)",
        lambda robot, _: _wheel_bias(robot),
    ),
    "delay": Scenario(
        "20 ms from a measurement to the efforts it leads to",
        lambda robot, _: Case(robot, Plant(delay=DELAY_S)),
    ),
    "computing": Scenario(
        "computing takes the time that it takes here: efforts come later, samples are missed",
        lambda robot, _: Case(robot, Plant(computing_time="measured")),
    ),
    "half-limits": Scenario(
        "half of each effort limit, beyond what holding still takes; references stay",
        _half_limits,
    ),
}


@dataclass(frozen=True)
class LawPair:
    """A kinematic and a dynamic law, by name."""

    kinematic: str
    dynamic: str

    def __str__(self) -> str:
        """Return ``KINEMATIC+DYNAMIC``."""
        return f"{self.kinematic}+{self.dynamic}"


PAPER = LawPair("paper", "paper")
PROPOSED = LawPair("end-effector", "integral")  # what rpctl proposes for a robot with an arm
PROPOSED_ARMLESS = LawPair("horizon", "integral")  # the same without an end effector to keep
# Dynamic laws differ only if limits bind or the model is wrong: one kinematic law shows that.
LAW_PAIRS = (
    PAPER,
    LawPair("unified", "paper"),
    LawPair("unified", "bounded"),
    LawPair("unified", "integral"),
    PROPOSED,
    PROPOSED_ARMLESS,
    LawPair("kanayama", "paper"),
    LawPair("feedback-linearization", "paper"),
)


def proposed(robot: Robot) -> LawPair:
    """Return the controller that rpctl proposes for a robot."""
    return PROPOSED if robot.joints else PROPOSED_ARMLESS


def controllers(laws: Sequence[str] = (), dynamic: str | None = None) -> list[LawPair]:
    """Return the controllers that are asked for.

    Args:
        laws: ``KINEMATIC+DYNAMIC``, or ``KINEMATIC`` alone: with ``dynamic``, else every pair of
            :data:`PAIRS` that has it. Nothing: all kinematic laws.
        dynamic: The dynamic law of kinematic laws that stand alone.

    Raises:
        UnknownNameError: There is no such law.
    """
    chosen: list[LawPair] = []
    for name in laws or KINEMATIC_LAWS:
        kinematic, _, own = name.partition("+")
        if kinematic not in KINEMATIC_LAWS:
            raise UnknownNameError("kinematic law", kinematic, KINEMATIC_LAWS)
        wanted = own or dynamic
        if wanted is not None and wanted not in DYNAMIC_LAWS:
            raise UnknownNameError("dynamic law", wanted, DYNAMIC_LAWS)
        pairs = [pair for pair in LAW_PAIRS if pair.kinematic == kinematic]
        if wanted is not None:
            pairs = [LawPair(kinematic, wanted)]
        chosen += pairs or [LawPair(kinematic, "bounded")]
    order = {pair: place for place, pair in enumerate(LAW_PAIRS)}
    return sorted(dict.fromkeys(chosen), key=lambda pair: order.get(pair, len(LAW_PAIRS)))
