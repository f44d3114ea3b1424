"""Wheels that roll without slipping: the reduced dynamics, under efforts or following speeds."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, find_contacts
from rpctl.dynamics.motion import Step, Stretch, follow, travel
from rpctl.dynamics.projection import Projector
from rpctl.dynamics.reduced import ReducedDynamics, quasi_force
from rpctl.dynamics.stops import Stops, stopping_step
from rpctl.errors import DivergedError, RpctlError
from rpctl.robot.coordinates import level_pose
from rpctl.robot.model import Robot
from rpctl.simulation.plants.free_tree import FreeTree
from rpctl.simulation.plants.protocol import Ground
from rpctl.simulation.plants.settings import Slipping, Wrench
from rpctl.simulation.plants.slip_step import SlipStepper
from rpctl.simulation.plants.tyres import TyreLaw

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
        before, lost, losses = self._dynamics.energy(q, nu), 0.0, self._dynamics.robot.losses
        after, stretches = self.course(q, nu)
        try:
            for stretch in stretches:
                if losses is not None:
                    v = self._dynamics.basis(q) @ stretch.mean
                    lost -= stretch.duration * float(losses.force(v) @ v)
                q = travel(self._dynamics, q, stretch)
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


class SlippingMotion:
    """A robot that moves on tyres; a :class:`~rpctl.simulation.plants.protocol.Motion`.

    Args:
        robot: The robot.
        settings: Its tyres.
        friction: Coefficient between wheels and ground.
        q: Where it stands at the start (nq,), at rest.
        longest: Longest step, s.
    """

    def __init__(
        self, robot: Robot, settings: Slipping, friction: float, q: Array, longest: float
    ) -> None:
        dynamics = ReducedDynamics(robot)
        contacts = find_contacts(dynamics, friction)
        law = TyreLaw(
            friction,
            settings.slip_stiffness,
            settings.creep_speed,
            settings.rolling_resistance,
        )
        projector = Projector(robot, dynamics.rolling)
        tree = FreeTree(dynamics, contacts)
        self.robot, self._longest, self._t = robot, longest, 0.0
        moved = {robot.velocity_index(name): name for name in robot.moving_joint_names}
        stops = Stops(robot, [moved.get(i, "") for i in tree.free.tolist()])
        self._stepper = SlipStepper(tree, law, projector.columns, stops)
        self._selection = projector.selection
        self._along = tree.contact_velocities.along
        self._leading = leading_wheels(robot)
        self._assumed = _assumptions(robot, contacts)
        self._tipped: float | None = None
        self._held = 0
        self.state = self._stepper.start(np.array(q), np.zeros(robot.nv))

    @property
    def q(self) -> Array:
        """Configuration (nq,)."""
        return self.state.at.q

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,): base speeds of the body as it moves, rates of the joints.

        With steered wheels only, the first speed is that of the first swivel's contact along its
        wheels, whether they roll or slip.
        """
        nu = self._selection.dot(self.state.v)
        if self._leading:
            nu[0] += self.state.contact_velocity[0, list(self._leading)].mean()
        return np.asarray(nu)

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w; world."""
        return level_pose(self.q, -self.robot.drive.ground)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended, in sentences."""
        notes = list(self._assumed)
        if self._tipped is not None:
            notes.append(
                f"from {self._tipped:.4g} s on the robot would tip at times; the simulation keeps "
                "it upright, and contacts that would lift carry no load"
            )
        if self._held:
            notes.append(
                f"in {self._held} steps the loads and tyre forces did not converge; the loads of "
                "the step before were used"
            )
        return tuple(notes)

    def ground(self) -> Ground:
        """Return the load of each contact and the slip of each wheel."""
        (slip, left, _), (cos, sin) = self.state.contact_velocity, self._along
        return Ground(
            self.state.load, np.column_stack([cos * slip - sin * left, sin * slip + cos * left])
        )

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it under constant efforts, in equal steps.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides; their times do not count.

        Raises:
            DivergedError: The state left the finite numbers.
        """

        def one(q: Array, y: Array, stride: float) -> Step:
            with np.errstate(over="ignore", invalid="ignore"):  # what diverges is told
                self.state, *balance = self._stepper.step(self.state, tau, stride, wrenches)
            self._t += stride
            self._held += self.state.held
            if self.state.tips and self._tipped is None:
                self._tipped = self._t
            return Step(self.q, self.state.y, *balance)

        done = in_steps(one, self.q, self.state.y, dt, self._longest)
        return done._replace(nu=self.nu)


def leading_wheels(robot: Robot) -> tuple[int, ...]:
    """Return the wheels whose rolling is the first quasi-velocity, where no axle fixes P."""
    drive = robot.drive
    return () if drive.has_axle or not drive.steered else drive.carried(drive.steered[0])


def _assumptions(robot: Robot, contacts: Contacts | None) -> tuple[str, ...]:
    """Return what the loads of the tyres take for granted, in sentences."""
    if contacts is None:
        return ("the base is fixed, so no wheel slips",)
    notes: list[str] = []
    if contacts.supports.unknown:
        listed = ", ".join(contacts.supports.unknown)
        notes.append(
            f"the tyres carry the whole load: {listed} touch the ground but have only meshes, so "
            "their contact points are unknown"
        )
    elif not contacts.balanced:
        notes.append(
            f"the tyres carry the load as if the robot were balanced: {', '.join(contacts.names)} "
            "stand on one line"
        )
    elif not contacts.determinate:
        notes.append(
            f"{len(contacts.names)} contacts share the load, which statics cannot determine: the "
            "tyres carry the loads of equally stiff contacts"
        )
    if robot.drive.followers:
        listed = ", ".join(swivel.joint for swivel in robot.drive.followers)
        notes.append(f"{listed} steer exactly with the other wheels, as if connected by rods")
    return tuple(notes)
