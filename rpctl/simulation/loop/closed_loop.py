"""The closed loop: reference → tracking error → kinematic law → dynamic law → plant."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import Controller, ControllerOutput
from rpctl.control.error import tracking_error
from rpctl.control.horizon.simulated import SimulatedTime, in_simulated_time
from rpctl.control.law import Rest
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import Reference, ReferenceState, configuration_along, require_state
from rpctl.robot.leaning import lies
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.plants.sensors import Measurement, sample_times
from rpctl.simulation.plants.starting import rest_at, start_interface

DIVERGED_SPEED = 1e6  # m/s or rad/s: no robot moves so; the loop has diverged
Shown = ParamSpec("Shown")


@dataclass
class Loop:
    """A closed loop: what it needs, and what it leaves beside its log.

    Attributes:
        dynamics: Of the simulated robot, without what the plant adds.
        config: Laws, circumstances and plant; its limits are the robot's already.
        reference: What is tracked.
        steps: Number of control periods.
        progress: Called with the samples done and their total.
        watch: Called with every sample; what it takes is not counted as the loop's.
        controller: What it stepped; None before it began.
        wall_time: s until the last sample, without what watched it.
        backend: ``"compiled"`` or ``"pinocchio"``: what computed the samples.
        remarks: What became of the choice of a backend, in sentences.
        assumed: What the plant assumed or mended, in sentences.
        approaches: How many ways up to the reference a compiled loop began with; None where its
            base needs none.
    """

    dynamics: ReducedDynamics
    config: Config
    reference: Reference
    steps: int
    progress: Callable[[int, int], object] | None = None
    watch: Callable[[LoopSample], object] | None = None
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
        """What became of the controller and of who looks on, in sentences."""
        stepped = () if self.controller is None else self.controller.notes()
        watched = [w.note for w in (self.watch, self.progress) if isinstance(w, Watching)]
        return *self.remarks, *self.assumed, *stepped, *filter(None, watched)

    def known(self) -> dict[str, Any]:
        """Return what is known so far, by the names of a run's entries."""
        return {"kinematic_report": self.report, "wall_time": self.wall_time}


class Watching(Generic[Shown]):
    """Calls a watcher; its first fault ends the watching, never the simulation.

    What asks for the simulation's end by KeyboardInterrupt is obeyed.

    Args:
        what: What watches, in words that begin a note.
        watcher: Is called.

    Attributes:
        note: A sentence on its fault, or nothing.
    """

    def __init__(self, what: str, watcher: Callable[Shown, object]) -> None:
        self._what, self._watcher = what, watcher
        self.note = ""

    def __call__(self, *values: Shown.args, **named: Shown.kwargs) -> None:
        """Call the watcher, unless it has failed before."""
        if self.note:
            return
        try:
            self._watcher(*values, **named)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}".removesuffix(": ")
            self.note = f"{self._what} failed and was not called again ({reason})"


def close_loop(loop: Loop, take: Callable[[LoopSample], object]) -> None:
    """Close a loop in Python; ``take`` gets every sample."""
    config, robot, steps = loop.config, loop.dynamics.robot, loop.steps
    plant, period = config.plant, config.run.control_period
    simulated = plant.simulated_dynamics(loop.dynamics)
    rest = rest_at_start(simulated, config, loop.reference)
    computing = ComputingController(loop, rest)
    started_at = time.perf_counter()
    measure = Measurement(plant.known_robot(robot), plant)
    times = sample_times(plant, period, steps + 1).tolist()
    interface, arrives = start_interface(simulated, config, rest), plant.arrives(steps + 1)
    try:
        for k, t in enumerate(times):
            state = require_state(robot, loop.reference(t), t)
            q, nu, work, lost, felt = interface.state
            measured = measure(q, nu, t)
            if arrives[k]:
                output = computing.step(t, *measured)
            tau, e = interface.take(output, computing.late(t)), tracking_error(robot, state, q)
            loop.wall_time = time.perf_counter() - started_at
            command, limits = output.command, output.limits
            sample = LoopSample(
                t, q, e, tau, state, nu, command.nu_d, output.speeds, work, lost, limits, felt
            )
            take(sample)
            if not np.abs(nu).max() < DIVERGED_SPEED:
                raise DivergedError(diverged_at(t))
            if loop.watch is not None:
                shown = time.perf_counter()
                loop.watch(sample)
                started_at += time.perf_counter() - shown
            if robot.drive.leans and lies(q):
                break  # on the ground the model ends
            if k < steps:
                interface.advance(times[k + 1] - t if plant.jitter else period)
            if loop.progress is not None:
                loop.progress(k, steps)
    finally:
        loop.assumed = interface.notes
        loop.wall_time = time.perf_counter() - started_at


class ComputingController:
    """The controller of a loop, whose computing takes simulated time.

    Answers come late, and a busy controller misses samples. A law that plans now and then takes its
    time for its plans, any other law at each sample. What is computed beside the samples delays
    what it brings, and no sample.

    Args:
        loop: Gets the controller.
        rest: Where the robot stands before the first sample.
    """

    def __init__(self, loop: Loop, rest: Rest) -> None:
        config, plant = loop.config, loop.config.plant
        self._simulated = SimulatedTime(plant.computing_time)
        with in_simulated_time(self._simulated):
            self.controller = loop.controller = Controller(
                plant.known_robot(loop.dynamics.robot),
                loop.reference,
                kinematic=config.kinematic,
                dynamic=config.dynamic,
                period=config.run.control_period,
                output=config.output or "effort",
                rest=rest,
                guards=config.guards,
                compiled=False,
                rates=config.run.rates,
                delay=config.run.delay,
            )
        self._busy_until = 0.0  # s
        self._output: ControllerOutput | None = None

    def step(self, t: float, q: Array, nu: Array) -> ControllerOutput:
        """Return the controller's answer to a sample, or its last one as long as it computes.

        Args:
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
        """
        if self._output is not None and t < self._busy_until - TIME_ROUNDING:
            return self._output
        before, beside = self.controller.kinematic_report(), self._simulated.spent_in_background
        began = time.thread_time()
        self._output = output = self.controller.step(t, q, nu)
        spent = time.thread_time() - began - (self._simulated.spent_in_background - beside)
        self._busy_until = t + self._charge(before, self.controller.kinematic_report(), spent)
        return output

    def late(self, t: float) -> float:
        """Return how much after a sample's time (s) the controller sends its answer, s."""
        return max(self._busy_until - t, 0.0)

    def _charge(self, before: dict[str, float], after: dict[str, float], spent: float) -> float:
        """Return what a sample takes, s.

        Args:
            before: What the kinematic law had counted before it.
            after: What it has now.
            spent: Processor time, s.
        """
        stated = self._simulated.computing_time
        if isinstance(stated, str):
            return spent
        if "solves" not in after:
            return stated
        beside = "largest_delay" in after
        return stated if after["solves"] > before["solves"] and not beside else 0.0


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
        RpctlError: The error at the start is none that the robot can have, or a bicycle stands.
    """
    robot = simulated.robot
    first = require_state(robot, reference(0.0), 0.0)
    q = start_configuration(robot, first, config.run.initial_error)
    return rest_at(simulated, config.plant, q, first)


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
