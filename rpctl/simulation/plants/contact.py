"""The plant in MuJoCo: a free body on a ground, whose wheels roll because friction lets them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.motion import Step
from rpctl.dynamics.rolling import find_rolling, selection
from rpctl.engines.mujoco.build import build
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.world import MujocoWorld
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.plants.protocol import Ground
from rpctl.simulation.plants.settings import Wrench

MAX_TILT = 0.2  # rad: a robot that leans further as it settles has fallen
STEEP = 0.7  # rad: likewise on a ground that is no plane
REACH = 1.0  # m about the root link: nothing of the ground there stands above where it is let fall
TOLD_TILT = 2e-3  # rad; soft contacts let a robot lean by a tenth of it
TOLD_SINK = 2e-3  # m, likewise


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
        self._selection = selection(robot, find_rolling(robot))
        self._level = built.heights is None
        self._height = 0.0 if built.heights is None else built.heights.highest(q[0], q[1], REACH)
        self.place(q, self._height - robot.drive.ground)
        self.settle()
        self._require_standing(MAX_TILT if self._level else STEEP)
        self._before = self.energy
        self.notes: tuple[str, ...] = (*built.repairs, *built.notes, *self._settled_notes())

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
                f"{self.robot.name} falls over: it leans {math.degrees(tilt):.0f}° standing "
                f"on {len(self.contacts)} contacts ({', '.join(self.contacts)}), which the rolling "
                "model holds upright; draw a caster as <collision>, or set props of [plant.contact]"
            )

    def _settled_notes(self) -> tuple[str, ...]:
        tilt = self.tilt
        sink = self._height - self.robot.drive.ground - float(self.pose[2])
        said: tuple[str, ...] = ()
        if self.rods:
            names = ", ".join(self.rods)
            said += (f"stiff tie rods hold {names} to the common centre of rotation",)
        if tilt > TOLD_TILT and self._level:
            said += (f"it stands {math.degrees(tilt):.2g}° out of the level",)
        if abs(sink) > TOLD_SINK and self._level:
            said += (f"its root link stands {1e3 * sink:.1f} mm lower than the file has it",)
        return said
