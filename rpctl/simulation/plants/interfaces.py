"""What a controller's output does to the simulated robot: efforts act, or speeds are followed."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config, delay_periods
from rpctl.simulation.plants.actuators import Actuators
from rpctl.simulation.plants.protocol import Motion, RunningPlant
from rpctl.simulation.plants.rolling import RollingMotion, VelocityPlant
from rpctl.simulation.plants.settings import Wrench

CLOCK_S = 1e-6  # s: of a user's simulator, rounding of its clock


class PlantState(NamedTuple):
    """The true state of a plant at a sample.

    Attributes:
        q: Configuration (nq,), seen from above.
        nu: Quasi-velocities (dof,).
        work: Of the actuators since the start, J.
        lost: What losses took since the start, J.
        felt: Columns of the log by name that only this plant knows: ``root_pose``, ``ground_load``
            and ``wheel_slip``.
    """

    q: Array
    nu: Array
    work: float
    lost: float
    felt: Mapping[str, Array]


class Interface(Protocol):
    """The simulated robot between two samples of its controller."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended so far, in sentences."""

    @property
    def state(self) -> PlantState:
        """The true state now."""

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take what is sent at a sample; return the efforts (n_act,) of the coming period.

        Args:
            output: What the controller sends.
            late: How much after the sample it is sent, s.
        """

    def advance(self, duration: float) -> None:
        """Advance the robot to the next sample.

        Args:
            duration: Until then, s.

        Raises:
            DivergedError: The state left the finite numbers.
        """


class EffortInterface:
    """A robot that takes efforts; they act after the plant's delay.

    Args:
        motion: What moves the robot.
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant.
        rest: Efforts that hold it until the first ones act.
    """

    def __init__(
        self, motion: Motion, dynamics: ReducedDynamics, config: Config, rest: Rest
    ) -> None:
        plant = config.plant
        self._motion = motion
        self._bias, self._wrenches = plant.bias(dynamics.robot), plant.wrenches
        self._actuators = Actuators(dynamics.robot, plant, config.run.control_period, rest.tau)
        self._sent = deque([rest.tau] * delay_periods(config.delay, config.run.control_period))
        self._held, self._t = HeldCommands(rest.tau), 0.0
        self._work = self._lost = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended so far, in sentences."""
        return self._motion.notes

    @property
    def state(self) -> PlantState:
        """See :class:`Interface`."""
        motion = self._motion
        return PlantState(motion.q, motion.nu, self._work, self._lost, felt(motion))

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take efforts; see :class:`Interface`."""
        self._sent.append(output.efforts)
        self._held.send(self._t + late, self._sent.popleft())
        return self._actuators.at(self._held.at(self._t))

    def advance(self, duration: float) -> None:
        """Advance the robot to the next sample; see :class:`Interface`."""
        end = self._t + duration
        for held, command in self._held.during(self._t, duration):
            for piece, tau in self._actuators.true_efforts(command, self._motion, held):
                for part, wrenches in pushes(self._wrenches, self._t, piece):
                    done = self._motion.advance(tau + self._bias, part, wrenches)
                    self._work, self._lost = self._work + done.work, self._lost + done.lost
                    self._t += part
        self._t = end


def felt(motion: Motion) -> dict[str, Array]:
    """Return the columns of a log that only the motion knows; none of one that rolls."""
    if isinstance(motion, RollingMotion):
        return {}
    load, slip = motion.ground()
    return {"root_pose": motion.pose, "ground_load": load, "wheel_slip": slip}


class SpeedInterface:
    """A robot that takes speeds, and whose own controllers find the efforts that follow them.

    What is sent positions is moved by these alone: it is to be where it is told, a period later.
    Joints that are sent efforts are left to those that know how these move them.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
        rest: Where it stands.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, dynamics: ReducedDynamics, config: Config, rest: Rest) -> None:
        robot, plant, run = dynamics.robot, config.plant, config.run
        if config.output is None:
            raise RpctlError("the controller sends efforts, not speeds")
        known = config.output.on(robot)
        truth, names = plant.velocity_interface(known), robot.quasi_velocities
        late = delay_periods(config.delay, run.control_period) * run.control_period
        self._dynamics = dynamics
        self._bias = plant.bias(robot)
        self._held, self._t = HeldCommands(np.zeros(robot.dof)), 0.0
        self._period, self._late = run.control_period, late
        joints = known.sent_efforts(robot)
        self._pushed = np.isin(robot.actuators, joints)
        self._own = np.isin(names, joints)
        self._efforts, self._tau = HeldCommands(rest.tau), rest.tau
        self._plant = VelocityPlant(
            dynamics,
            truth.lag_of(names),
            truth.dead_times_of(names) + late,
            run.control_period,
            run.plant_step,
        )
        self._index = {name: k for k, name in enumerate(names)}
        self._placed = {n: robot.joint_position(rest.q, n) for n in names if n in robot.entries}
        self.state = PlantState(rest.q, np.zeros(robot.dof), 0.0, 0.0, {})

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take speeds; return the efforts that the mean acceleration of the period takes.

        Args:
            output: What the controller sends.
            late: How much after the sample they are sent, s; they count from the next sample on.
        """
        (q, nu, *_), speeds = self.state, output.speeds.copy()
        for command in output.commands.values():
            for name in command.positions.keys() & self._index.keys():
                place = command.positions[name]
                speeds[self._index[name]] = (place - self._placed[name]) / self._period
                self._placed[name] = place
        if output.efforts.size:
            self._efforts.send(self._t + late + self._late, output.efforts)
            self._tau = self._efforts.at(self._t)
        self._held.send(self._t + late, speeds)
        self._plant.send(self._held.at(self._t))
        self._t += self._period
        return np.asarray(self._moving(self._plant.acceleration(q, nu)) - self._bias)

    def _moving(self, nu_dot: Array) -> Array:
        """Return the efforts (n_act,) that an acceleration (dof,) takes now."""
        q, nu, *_ = self.state
        return self._dynamics.efforts(q, self._dynamics.inverse(q, nu, nu_dot))

    def advance(self, duration: float) -> None:
        """Advance the robot by a control period; see :class:`Interface`."""
        before = self.state
        q, nu, work, lost = self._plant.advance(before.q, before.nu)
        self.state = PlantState(q, nu, before.work + work, before.lost + lost, {})


class ArmInterface(SpeedInterface):
    """A robot that rolls whose arm takes efforts, on a base that follows speeds exactly.

    The efforts of the base are what is missing, while the arm pushes it, for it to move so.

    Args:
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
        rest: Where it stands, and the efforts that hold it.
    """

    def __init__(self, dynamics: ReducedDynamics, config: Config, rest: Rest) -> None:
        super().__init__(dynamics, config, rest)
        self._motion = RollingMotion(dynamics, rest.q, config.run.plant_step)

    def advance(self, duration: float) -> None:
        """Advance the robot by a control period; see :class:`Interface`."""
        q, nu, work, lost, _ = self.state
        for dt, mean, change in self._plant.course(q, nu)[1]:
            target = mean + 0.5 * change
            done = self._motion.advance(self._moving((target - self._motion.nu) / dt), dt)
            self._motion.nu = np.where(self._own, done.nu, target)
            work, lost = work + done.work, lost + done.lost
        self.state = PlantState(self._motion.q, self._motion.nu, work, lost, {})

    def _moving(self, nu_dot: Array) -> Array:
        """Return all efforts (n_act,) now; the base has those that make its entries of ν̇ (dof,)."""
        dynamics, led, q, nu = self._dynamics, ~self._own, self._motion.q, self._motion.nu
        tau, missing = np.where(self._pushed, self._tau, 0.0) + self._bias, np.zeros(len(nu))
        reach = np.linalg.inv(dynamics.inertia(q))[np.ix_(led, led)]  # ν̇ of pushes on the base
        missing[led] = np.linalg.solve(reach, (nu_dot - dynamics.forward(q, nu, tau))[led])
        return tau + dynamics.efforts(q, missing)


class OwnInterface:
    """A robot that a simulator of the user's moves; what is measured of it is all that is known."""

    notes: tuple[str, ...] = ()

    def __init__(self, plant: RunningPlant, rest: Rest, dof: int) -> None:
        self._plant, self._t = plant, 0.0
        self._output: ControllerOutput | None = None
        self.state = PlantState(rest.q, np.zeros(dof), 0.0, 0.0, {})

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take efforts; see :class:`Interface`."""
        self._output = output
        return output.efforts

    def advance(self, duration: float) -> None:
        """Advance the robot to the next sample; see :class:`Interface`."""
        if self._output is None:
            raise RpctlError("the plant got an empty command")
        sample, self._t = self._plant.step(self._output, duration), self._t + duration
        if not abs(sample.t - self._t) <= CLOCK_S:
            raise RpctlError(
                f"the plant measures at t = {sample.t:g} s, where it was to be advanced to "
                f"{self._t:g} s; let it go on by the whole dt"
            )
        self.state = self.state._replace(q=sample.q, nu=sample.nu)


def pushes(
    wrenches: Sequence[Wrench], t: float, duration: float
) -> Iterator[tuple[float, tuple[Wrench, ...]]]:
    """Yield how long (s) which wrenches act, one after another.

    Args:
        wrenches: All that there are.
        t: From when on, s.
        duration: For how long, s.
    """
    end = t + duration
    changes = {time for each in wrenches for time in (each.start, each.until)}
    inside = [x for x in sorted(changes) if t + TIME_ROUNDING < x < end - TIME_ROUNDING]
    for begin, after in pairwise((t, *inside, end)):
        yield after - begin, tuple(each for each in wrenches if each.acts(begin))


class HeldCommands:
    """Efforts or speeds that hold until others come."""

    def __init__(self, first: Array) -> None:
        self._held = first
        self._coming = deque[tuple[float, Array]]()

    def send(self, at: float, command: Array) -> None:
        """Send what comes at a time (s), later than those sent before."""
        self._coming.append((at, command))

    def at(self, t: float) -> Array:
        """Return what holds from a time (s) on."""
        while self._coming and self._coming[0][0] <= t + TIME_ROUNDING:
            self._held = self._coming.popleft()[1]
        return self._held

    def during(self, t: float, duration: float) -> Iterator[tuple[float, Array]]:
        """Yield how long (s) what holds, from a time (s) on for a duration (s)."""
        left = duration
        while self._coming and self._coming[0][0] < t + left - TIME_ROUNDING:
            at = self._coming[0][0]
            held = self.at(t)
            if at > t + TIME_ROUNDING:
                yield at - t, held
                t, left = at, left - (at - t)
            self.at(at)
        yield left, self.at(t)
