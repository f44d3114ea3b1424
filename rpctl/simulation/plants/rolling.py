"""Wheels that roll without slipping: the reduced dynamics, under efforts or following speeds."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.motion import Step, Stretch, follow, travel
from rpctl.dynamics.pushes import quasi_force
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.stops import Stops, stopping_step
from rpctl.errors import DivergedError, RpctlError
from rpctl.robot.coordinates import level_pose
from rpctl.simulation.plants.protocol import Ground
from rpctl.simulation.plants.settings import Wrench

ROUNDING = 1e-9  # of a control period: a rest of a dead time this small is none


class RollingMotion:
    """A robot that moves as the reduced dynamics say; see :class:`Motion`.

    Args:
        dynamics: Of the simulated robot.
        q: Configuration (nq,) at rest.
        longest: Longest step of the integration, s.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, dynamics: ReducedDynamics, q: Array, longest: float) -> None:
        self._dynamics, self._stops, self._longest = dynamics, Stops(dynamics.robot), longest
        self.q, self.nu = q, np.zeros(dynamics.robot.dof)

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): it stays level."""
        return level_pose(self.q, -self._dynamics.robot.drive.ground)

    def ground(self) -> Ground:
        """Return nothing: the log derives it from the motion."""
        return Ground()

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance the robot; see :class:`Motion`.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides.
        """
        outside = partial(quasi_force, self._dynamics, wrenches=wrenches) if wrenches else None

        def one(q: Array, nu: Array, stride: float) -> Step:
            return stopping_step(self._dynamics, self._stops, (q, nu), tau, stride, outside)

        done = in_steps(one, self.q, self.nu, dt, self._longest)
        self.q, self.nu = done.q, done.nu
        return done


def substeps(duration: float, longest: float) -> int:
    """Return in how many equal steps of at most ``longest`` (s) a ``duration`` (s) is taken."""
    return max(1, math.ceil(duration / longest - 1e-9))


def advance(
    dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, duration: float, longest: float
) -> Step:
    """Advance the reduced dynamics from q (nq,) and ν (dof,) under a constant τ (n_act,).

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        duration: How far, s.
        longest: Longest step, s.

    Raises:
        DivergedError: The state left the finite numbers.
    """
    motion = RollingMotion(dynamics, q, longest)
    motion.nu = nu
    return motion.advance(tau, duration)


def in_steps(
    one: Callable[[Array, Array, float], Step], q: Array, nu: Array, duration: float, longest: float
) -> Step:
    """Take ``duration`` (s) in equal steps, none above ``longest`` (s); work and losses add up.

    Raises:
        DivergedError: The state left the finite numbers.
    """
    steps, work, lost = substeps(duration, longest), 0.0, 0.0
    try:
        for _ in range(steps):
            q, nu, done, gone = one(q, nu, duration / steps)
            work, lost = work + done, lost + gone
    except (RpctlError, np.linalg.LinAlgError) as error:
        raise DivergedError(f"the motion diverged: {error}") from error
    if not (np.isfinite(q).all() and np.isfinite(nu).all()):
        raise DivergedError("the motion diverged; shorten the control period or lengthen horizons")
    return Step(q, nu, work, lost)


class VelocityPlant:
    """A robot whose own controllers follow commanded speeds: T ν̇(t) = c(t − T_d) − ν(t), exactly.

    Commands are held between samples. A dead time need be no whole number of control periods: the
    commands then change within them. A joint that comes to a limit of its position stops there.

    Args:
        dynamics: Of the simulated robot.
        lag: T of each quasi-velocity (dof,), s.
        dead_times: T_d likewise, or one of all, s.
        period: Control period, s.
        longest: Longest step in which the configuration is integrated, s.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        lag: Array,
        dead_times: Array | float,
        period: float,
        longest: float,
    ) -> None:
        self._dynamics, self._lag, self._period = dynamics, lag, period
        self._stops = Stops(dynamics.robot)
        dead_times = np.broadcast_to(dead_times, lag.shape)
        whole = np.floor(dead_times / period + ROUNDING)
        rests = np.maximum(dead_times - whole * period, 0.0)
        rests = np.where(rests > ROUNDING * period, rests, 0.0)
        starts = np.unique([0.0, *rests])
        # What was sent a whole dead time ago acts once its rest is over, before it the one before.
        self._ago = np.array([whole + (start < rests) for start in starts], dtype=np.intp)
        count = int(whole.max(initial=0.0)) + 2
        self._sent = deque([np.zeros(dynamics.robot.dof)] * count, maxlen=count)
        parts = np.diff([*starts, period])
        self._counts = [substeps(part, longest) for part in parts]
        self._durations = np.repeat(np.divide(parts, self._counts), self._counts)

    def send(self, speeds: Array) -> None:
        """Send commanded speeds (dof,) at the beginning of a control period."""
        self._sent.append(speeds)

    def acceleration(self, q: Array, nu: Array) -> Array:
        """Return the mean ν̇ (dof,) of the coming control period, from q (nq,) and ν (dof,) on."""
        return np.asarray((self.course(q, nu)[0] - nu) / self._period)

    def advance(self, q: Array, nu: Array) -> Step:
        """Advance the robot by a control period.

        The work is that of actuators which let it move so: the change of its energy, and what
        losses take.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).

        Raises:
            DivergedError: The state left the finite numbers.
        """
        before, lost = self._dynamics.energy(q, nu), 0.0
        after, stretches = self.course(q, nu)
        try:
            for stretch in stretches:
                start, q = q, travel(self._dynamics, q, stretch)
                lost += self._loss(start, q, stretch)
        except RpctlError as error:
            raise DivergedError(f"the motion diverged: {error}") from error
        if not (np.isfinite(q).all() and np.isfinite(after).all()):
            raise DivergedError("the motion diverged; give longer horizons, or the true lag")
        return Step(q, after, self._dynamics.energy(q, after) - before + lost, lost)

    def course(self, q: Array, nu: Array) -> tuple[Array, list[Stretch]]:
        """Return ν (dof,) after the coming period, and the stretches on the way there.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
        """
        commands, durations = self._commands(), self._durations
        if not self._stops.any:
            return follow(nu, commands, durations, self._lag)
        room, found = np.subtract(self._stops.ends(q), self._stops.places(q)), list[Stretch]()
        for k in range(len(durations)):
            nu, (stretch,) = follow(nu, commands[k : k + 1], durations[k : k + 1], self._lag)
            way = stretch.duration * stretch.mean
            done = np.clip(way, *room)
            blocked, room = done != way, room - done
            if blocked.any():
                nu, change = np.where(blocked, 0.0, [nu, stretch.change])
                stretch = Stretch(stretch.duration, done / stretch.duration, change)
            found.append(stretch)
        return nu, found

    def _commands(self) -> Array:
        """Return the commands (n, dof) that act in the stretches of the coming period."""
        sent = np.array(self._sent)
        acting = sent[len(sent) - 1 - self._ago, np.arange(sent.shape[1])]
        return np.repeat(acting, self._counts, axis=0)

    def _loss(self, start: Array, end: Array, stretch: Stretch) -> float:
        """Return what losses take in a stretch (J), by Simpson's rule.

        Args:
            start: Configuration at its beginning (nq,).
            end: Configuration at its end (nq,).
            stretch: ν on the way.
        """
        losses, dynamics = self._dynamics.robot.losses, self._dynamics
        if losses is None:
            return 0.0
        S = dynamics.basis(start), dynamics.basis(end)
        half = 0.5 * stretch.change
        first, middle, last = (
            losses.force(v) @ v
            for v in (
                S[0] @ (stretch.mean - half),
                0.5 * (S[0] + S[1]) @ stretch.mean,
                S[1] @ (stretch.mean + half),
            )
        )
        return float(-stretch.duration / 6.0 * (first + 4.0 * middle + last))
