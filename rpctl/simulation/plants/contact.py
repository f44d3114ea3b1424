"""The plant in MuJoCo: a free body on a ground, whose wheels roll because friction lets them.

What moves it are efforts, or servos of its joints that take speeds and positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.dynamics.leaning import LeaningProjector
from rpctl.dynamics.motion import Step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import find_rolling, selection
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.world import MujocoWorld, build
from rpctl.equivalence.contact.leaning_body import LeaningBody
from rpctl.errors import RpctlError
from rpctl.robot.leaning import FREE_NV
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.plants.interfaces import PlantState, SpeedInterface, felt
from rpctl.simulation.plants.protocol import Ground
from rpctl.simulation.plants.settings import Wrench

MAX_TILT = 0.2  # rad: a robot that leans further as it settles has fallen
STEEP = 0.7  # rad: likewise on a ground that is no plane
REACH = 1.0  # m about the root link: nothing of the ground there stands above where it is let fall
TOLD_TILT = 2e-3  # rad; soft contacts let a robot lean by a tenth of it
TOLD_SINK = 2e-3  # m, likewise
TYRES = (
    "its wheels are tyres with the cross-section given in the drive, and touch the ground at "
    "one point each"
)


class MujocoMotion(MujocoWorld):
    """A robot in MuJoCo, settled in its contacts and at rest.

    What it loses is what efforts and pushes do less what its energy gains: damping and friction of
    joints, sliding of contacts, and what MuJoCo's soft contacts and its integrator take.

    Args:
        robot: The robot.
        settings: How it meets the ground.
        friction: Coefficient between wheels and ground.
        q: Where it starts (nq,); it settles there, its joints held.

    Raises:
        EngineMissing: MuJoCo is not installed.
        RpctlError: It does not stand there.
    """

    def __init__(self, robot: Robot, settings: ContactSettings, friction: float, q: Array) -> None:
        built = build(robot, settings, friction)
        super().__init__(robot, built)
        self._level = built.heights is None
        self._height = 0.0 if built.heights is None else built.heights.highest(q[0], q[1], REACH)
        self.place(q, self._height - robot.drive.floor)
        self.settle()
        self._require_standing(MAX_TILT if self._level else STEEP)
        self._before = self.energy
        self.notes: tuple[str, ...] = (*built.repairs, *built.notes, *self._settled_notes())

    @cached_property
    def _selection(self) -> Array:
        return selection(self.robot, find_rolling(self.robot))

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,): base speeds of P as it moves, rates of steering and joints."""
        return np.asarray(self._selection @ self.v)

    def ground(self) -> Ground:
        """Return the load of each contact, and how the wheels' lowest points slip."""
        return Ground(self.loads(), self.slips())

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it; see :class:`~rpctl.simulation.plants.protocol.Motion`."""
        for wrench in wrenches:
            self.push(wrench.link, wrench.force, wrench.moment)
        before = [(self.origin(w.link), self.velocity(w.link)[3:]) for w in wrenches]
        work = self.run(tau, dt)
        for wrench, (origin, spin) in zip(wrenches, before, strict=True):
            turned = 0.5 * dt * (spin + self.velocity(wrench.link)[3:])
            work += float(np.dot(wrench.force, self.origin(wrench.link) - origin))
            work += float(np.dot(wrench.moment, turned))
        self.release()
        energy = self.energy
        gained, self._before = energy - self._before, energy
        return Step(self.q, self.nu, work, work - gained)

    def _require_standing(self, most: float) -> None:
        """Refuse a robot that leans by more than ``most`` (rad) once it has settled."""
        tilt = self.tilt
        if not tilt <= most:
            raise RpctlError(
                f"{self.robot.name} falls over: it leans {math.degrees(tilt):.0f}° standing on "
                f"{len(self.contacts)} contacts ({', '.join(self.contacts)}); only the rolling "
                "model keeps it upright. Add a caster as <collision>, or set props of "
                "[plant.contact]"
            )

    def _settled_notes(self) -> tuple[str, ...]:
        tilt = self.tilt
        sink = self._height - self.robot.drive.ground - float(self.pose[2])
        said: tuple[str, ...] = ()
        if self.rods:
            names = ", ".join(self.rods)
            said += (f"stiff tie rods hold {names} to the common centre of rotation",)
        if tilt > TOLD_TILT and self._level:
            said += (f"it stands tilted by {math.degrees(tilt):.2g}°",)
        if abs(sink) > TOLD_SINK and self._level:
            said += (f"its root link stands {1e3 * sink:.1f} mm lower than in the file",)
        return said


class LeaningMotion(LeaningBody, MujocoMotion):
    """A robot that leans in MuJoCo, put into balance; see :class:`MujocoMotion`.

    While it settles in its contacts, its tilt and its heading are held.
    """

    @cached_property
    def _projector(self) -> LeaningProjector:
        return LeaningProjector(self.robot)

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,) of the motion that it has, rolling or not."""
        return np.asarray(self._projector.equations(self.q)[self._projector.rows :] @ self.v)

    def start(self, nu: Array) -> None:
        """Set it in motion as it would roll with ν (dof,)."""
        rows, data = self._projector.rows, self.data
        v = np.linalg.solve(self._projector.equations(self.q), np.concatenate([np.zeros(rows), nu]))
        data.qvel[self.root_rate] = [*data.xmat[self.root].reshape(3, 3) @ v[:3], *v[3:FREE_NV]]
        data.qvel[self._joints[1]] = v[self._columns]
        self.mujoco.mj_forward(self.mjm, data)
        self._before = self.energy

    def _held(self) -> Array:
        held, heading = super()._held(), self.robot.drive.heading
        along = heading if self.robot.rolls_sideways else heading + 0.5 * math.pi
        held[self.root_rate][3:] = abs(math.cos(along)), abs(math.sin(along)), 1.0
        return held

    def _return(self, q: Array) -> None:
        self.data.qpos[:2] = q[:2]
        self.set_joints(q)

    def _require_standing(self, most: float) -> None:
        """Take it as it is: what holds it up is its controller."""

    def _settled_notes(self) -> tuple[str, ...]:
        return (TYRES,)


WHEEL_TIME = 0.01  # s in which a wheel's servo comes to its speed, were there no limit of effort
WHEEL_REST = 0.05  # s in which it makes up for what resists it
BANDWIDTH = 40.0  # rad/s: least one of the other servos, damped critically or more
FIRM = 0.02  # rad or m by which a joint is off where its servo has its whole effort, or less


class ServoInterface(SpeedInterface):
    """A robot in MuJoCo whose servos follow what it is sent, within its effort limits.

    They are to follow the motion that a robot would have which follows its commands exactly as late
    as the plant says. Servos of speed, proportional and integral, turn driven wheels like those of
    a base that rolls; servos of position hold the joints of arm and steering where their rates lead
    to. They begin without sag, as those that know the robot's weight at the start, and nothing
    winds up while an effort is at its limit. MuJoCo takes their damping implicitly, so that what
    they do and what is lost cannot be told apart: the work is what the robot's energy gains.

    Args:
        motion: The robot in MuJoCo.
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
        rest: Where it stands, and the efforts that hold it.
    """

    def __init__(
        self, motion: MujocoMotion, dynamics: ReducedDynamics, config: Config, rest: Rest
    ) -> None:
        super().__init__(dynamics, config, rest)
        robot, self._motion, self._ideal = dynamics.robot, motion, np.zeros(dynamics.robot.dof)
        M, B = dynamics.inertia(rest.q), dynamics.actuation(rest.q)
        each = 1.0 / np.diag(B.T @ np.linalg.solve(M, B))  # what a motor moves, all others free
        own = dict(zip(robot.quasi_velocities, np.diag(M), strict=True))
        felt_by = np.array([own.get(n, x) for n, x in zip(robot.actuators, each, strict=True)])
        wheels = {wheel.joint for wheel in robot.drive.wheels}
        rolls, limits = np.array([n in wheels for n in robot.actuators]), robot.effort_limits
        firm = np.maximum(BANDWIDTH**2 * felt_by, np.where(np.isfinite(limits), limits / FIRM, 0.0))
        stiffness = np.where(rolls, felt_by / (WHEEL_TIME * WHEEL_REST), firm)
        self._ahead = np.where(rolls, WHEEL_REST, 2.0 / BANDWIDTH)  # s of a rate
        firm = np.where(self._pushed, 0.0, stiffness)
        motion.serve(firm, self._ahead * firm)
        self._at, self._reach = motion.places + rest.tau / stiffness, limits / stiffness
        self._rows = [robot.velocity_index(name) for name in robot.actuators]
        self.state = self.state._replace(q=motion.q, felt=felt(motion))
        self.notes = motion.notes

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take what is sent; return the efforts (n_act,) that the servos have now."""
        super().take(output, late)
        return np.array(self._motion.data.actuator_force)

    def advance(self, duration: float) -> None:
        """Advance the robot by a control period; see the protocol."""
        work, motion = self.state.work, self._motion
        self._ideal, stretches = self._plant.course(motion.q, self._ideal)
        for dt, nu, _ in stretches:
            rates = (self._dynamics.basis(motion.q) @ nu)[self._rows]
            places = motion.places
            self._at = np.clip(self._at + dt * rates, places - self._reach, places + self._reach)
            places = np.where(self._pushed, self._tau, self._at + self._ahead * rates)
            done = motion.advance(places, dt)
            work += done.work - done.lost  # what the energy gains
        self.state = PlantState(motion.q, motion.nu, work, 0.0, felt(motion))
