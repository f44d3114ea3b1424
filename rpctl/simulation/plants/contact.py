"""The plant in MuJoCo: a free body on a ground, whose wheels roll because friction lets them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.basis import selection
from rpctl.dynamics.motion import Step
from rpctl.dynamics.rolling import find_rolling
from rpctl.engines.mujoco.build import build
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.world import MujocoWorld
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.plants.motion import Ground
from rpctl.simulation.plants.wrench import Wrench

MAX_TILT = 0.2  # rad: a robot that leans further as it settles has fallen
STEEP = 0.7  # rad: likewise on a ground that is no plane
REACH = 1.0  # m about the root link: nothing of the ground there stands above where it is let fall
TOLD_TILT = 2e-3  # rad; soft contacts let a robot lean by a tenth of it
TOLD_SINK = 2e-3  # m, likewise


class MujocoMotion:
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
        self._robot = robot
        built = build(robot, settings, friction)
        self._world = MujocoWorld(robot, built)
        self._selection = selection(robot, find_rolling(robot))
        self._level = built.heights is None
        self._height = 0.0 if built.heights is None else built.heights.highest(q[0], q[1], REACH)
        self._world.place(q, self._height - robot.drive.ground)
        self._world.settle()
        self._require_standing(built.contacts, MAX_TILT if self._level else STEEP)
        self._energy = self._world.energy
        self.notes: tuple[str, ...] = (*built.repairs, *built.notes, *self._settled_notes())

    @property
    def q(self) -> Array:
        """Configuration (nq,): x, y and heading of the root link, then the joints."""
        return self._world.q

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,): base speeds of P as it moves, rates of steering and joints."""
        return np.asarray(self._selection @ self._world.v)

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w; world."""
        return self._world.pose

    def ground(self) -> Ground:
        """Return the load of each contact, and how the wheels' lowest points slip."""
        return Ground(self._world.loads(), self._world.slips())

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it under constant efforts.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides; their times do not count.

        Returns:
            q and ν then, the work of ``tau`` and of what pushes it, and what was lost of that.

        Raises:
            DivergedError: The state left the finite numbers.
        """
        world = self._world
        for wrench in wrenches:
            world.push(wrench.link, wrench.force, wrench.moment)
        before = [(world.origin(w.link), world.velocity(w.link)[3:]) for w in wrenches]
        work = world.advance(tau, dt)
        pushed = 0.0
        for wrench, (origin, spin) in zip(wrenches, before, strict=True):
            turned = 0.5 * dt * (spin + world.velocity(wrench.link)[3:])
            pushed += float(np.dot(wrench.force, world.origin(wrench.link) - origin))
            pushed += float(np.dot(wrench.moment, turned))
        if wrenches:
            world.release()
        energy = world.energy
        lost = work + pushed - (energy - self._energy)
        self._energy = energy
        return Step(self.q, self.nu, work + pushed, lost)

    def _require_standing(self, contacts: tuple[str, ...], most: float) -> None:
        """Refuse a robot that leans by more than ``most`` (rad) once it has settled."""
        tilt = self._world.tilt
        if not tilt <= most:
            raise RpctlError(
                f"{self._robot.name} falls over: it leans {math.degrees(tilt):.0f}° standing "
                f"on {len(contacts)} contacts ({', '.join(contacts)}), which the rolling model "
                "holds upright; draw a caster as <collision>, or set props of [plant.contact]"
            )

    def _settled_notes(self) -> tuple[str, ...]:
        tilt = self._world.tilt
        sink = self._height - self._robot.drive.ground - float(self.pose[2])
        said: tuple[str, ...] = ()
        if tilt > TOLD_TILT and self._level:
            said += (f"it stands {math.degrees(tilt):.2g}° out of the level",)
        if abs(sink) > TOLD_SINK and self._level:
            said += (f"its root link stands {1e3 * sink:.1f} mm lower than the file has it",)
        return said
