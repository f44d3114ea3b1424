"""The closed loop: reference → tracking error → kinematic law → dynamic law → plant."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import Controller
from rpctl.control.error import tracking_error
from rpctl.control.horizon.law import SimulatedTime, in_simulated_time
from rpctl.control.law import Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import Reference, ReferenceState, configuration_along, require_state
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.loop.computing import ComputingController
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.plants.sensors import Measurement, sample_times
from rpctl.simulation.plants.starting import start_interface

DIVERGED_SPEED = 1e6  # m/s or rad/s: no robot moves so; the loop has diverged


Watcher = Callable[[LoopSample], object]


@dataclass
class LoopRecord:
    """What a closed loop leaves beside its log.

    Attributes:
        controller: What it stepped; None before it began.
        wall_time: s until the last sample, without what watched it.
        backend: ``"compiled"`` or ``"pinocchio"``: what computed the samples.
        remarks: What became of the choice of a backend, in sentences.
        assumed: What the plant assumed or mended, in sentences.
        approaches: How many ways up to the reference a compiled loop began with; None where its
            base needs none.
    """

    controller: Controller | None = None
    wall_time: float = 0.0
    backend: str = "pinocchio"
    remarks: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    approaches: int | None = None

    @property
    def report(self) -> dict[str, float]:
        """What the kinematic law has counted so far, by name."""
        if self.controller is not None:
            return self.controller.kinematic_report()
        return {} if self.approaches is None else {"approaches": self.approaches}

    @property
    def notes(self) -> tuple[str, ...]:
        """What became of the controller, in sentences."""
        found = () if self.controller is None else self.controller.notes()
        return *self.remarks, *self.assumed, *found

    def known(self) -> dict[str, Any]:
        """Return what is known so far, by the names of a run's entries."""
        return {"kinematic_report": self.report, "wall_time": self.wall_time}


def close_loop(
    dynamics: ReducedDynamics,
    config: Config,
    reference: Reference,
    steps: int,
    take: Watcher | None,
    loop: LoopRecord,
    progress: Callable[[int, int], object] | None = None,
    watch: Watcher | None = None,
) -> None:
    """Close the loop for a number of control periods.

    Args:
        dynamics: Of the simulated robot, without what the plant adds.
        config: Laws, circumstances and plant; its limits are the robot's already.
        reference: What is tracked.
        steps: Number of control periods.
        take: Gets every sample; None keeps no log, which takes half of the time.
        loop: Filled when the loop ends, early or not.
        progress: Called with the samples done and their total.
        watch: Called with every sample.

    Raises:
        DivergedError: The motion left the finite numbers.
    """
    robot, plant, period = dynamics.robot, config.plant, config.run.control_period
    simulated = plant.simulated_dynamics(dynamics)
    rest = rest_at_start(simulated, config, reference)
    simulated_time = SimulatedTime(plant.computing_time)
    with in_simulated_time(simulated_time):
        controller = Controller(
            plant.known_robot(robot),
            reference,
            config.kinematic,
            config.dynamic,
            period,
            config.output or "effort",
            rest,
        )
    computing = ComputingController(controller, simulated_time)
    loop.controller, started_at = controller, time.perf_counter()
    measure = Measurement(plant.known_robot(robot), plant)
    times = sample_times(plant, period, steps + 1).tolist()
    interface, arrives = start_interface(simulated, config, rest), plant.arrives(steps + 1)
    try:
        for k in range(steps + 1):
            t = times[k]
            state = require_state(robot, reference(t), t)
            q, nu, work, lost, felt = interface.state
            e = tracking_error(robot, state, q)
            measured = measure(q, nu, t)
            if arrives[k]:
                output = computing.step(t, *measured)
            tau = interface.take(output, computing.late(t))
            loop.wall_time = time.perf_counter() - started_at
            sample = LoopSample(
                t, q, e, tau, state, nu, output.command.nu_d, output.speeds, work, lost,
                output.limits, felt,
            )  # fmt: skip
            if take is not None:
                take(sample)
            if not np.abs(nu).max() < DIVERGED_SPEED:
                raise DivergedError(diverged_at(t))
            if watch is not None:
                shown = time.perf_counter()
                watch(sample)
                started_at += time.perf_counter() - shown
            if k < steps:
                interface.advance(times[k + 1] - t if plant.jitter else period)
                controller.prepare()
            if progress is not None:
                progress(k, steps)
    finally:
        loop.assumed = interface.notes
        loop.wall_time = time.perf_counter() - started_at


def diverged_at(t: float) -> str:
    """Return the sentence that a motion left the finite numbers at a time (s)."""
    return (
        f"the motion diverged at t = {t:g} s; shorten the control period or lengthen the horizons"
    )


def rest_at_start(simulated: ReducedDynamics, config: Config, reference: Reference) -> Rest:
    """Return where the simulated robot stands before the first sample, and what holds it there.

    Args:
        simulated: Its dynamics.
        config: Its start and its plant.
        reference: What is tracked.

    Raises:
        RpctlError: The error at the start is none that the robot can have.
    """
    robot = simulated.robot
    first = require_state(robot, reference(0.0), 0.0)
    q = start_configuration(robot, first, config.run.initial_error)
    holding = simulated.efforts(q, simulated.bias(q, np.zeros(robot.dof)))
    return Rest(q, np.asarray(holding - config.plant.bias(robot)))


def start_configuration(
    robot: Robot, state: ReferenceState, initial_error: Sequence[float]
) -> Array:
    """Return q (nq,) that has the tracking error asked for, arm on its reference.

    Args:
        robot: The robot.
        state: Its reference at the start.
        initial_error: How far that is ahead (m), to the left (m) and turned (rad).

    Raises:
        RpctlError: The error is none that the robot can have.
    """
    if len(initial_error) != 3 or not all(map(math.isfinite, initial_error)):
        raise RpctlError(f"initial error {initial_error}: give three finite numbers X,Y,THETA")
    x1, x2, x3 = initial_error
    if not robot.drive.base_speeds and any(initial_error):
        raise RpctlError(f"{robot.name} has a fixed base: it starts without a base error")
    theta = state.pose[2] - x3
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = state.pose[0] - cos * x1 + sin * x2, state.pose[1] - sin * x1 - cos * x2
    return configuration_along(robot, state, np.array([x, y, theta]))
