"""``MujocoSimulator``: MuJoCo as an engine of the referee."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.engine import (
    EngineFault,
    EngineState,
    LinkMotion,
    Mended,
    Switch,
    in_order,
    joint_losses,
    wheel_slips,
)
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.switches import mend, mujoco_switches
from rpctl.engines.mujoco.user_load import PREFIX, compiled, load_as_user
from rpctl.engines.mujoco.world import MujocoWorld, build
from rpctl.equivalence.contact.mujoco_body import MujocoBody, RollingBody, Touching, mujoco_library
from rpctl.robot.model import Robot

SETTINGS = ContactSettings(wheel_shape="crowned")  # those that ``rpctl export`` writes
LIFT = 0.7  # largest fraction of a wheel's load that scrubbing may lift
GRAVITY = 9.81  # m/s²
SETTING = (
    "give the wheels the crowned shapes and the contact pairs that `rpctl export` writes, and "
    "turn slowly: a wheel that slides faster than about 0.1 m/s hops even then"
)
TICK_S = 2e-3  # s: one of MuJoCo's default steps
STEP_ROUNDING = 1e-6  # of a step


@dataclass(frozen=True)
class MujocoSimulator:
    """MuJoCo, an :class:`rpctl.engines.engine.Engine`.

    Raises:
        EngineMissing: MuJoCo is not installed.
    """

    name: str = "MuJoCo"
    tick: float = TICK_S
    turning_setting: str = SETTING

    def __post_init__(self) -> None:
        """Refuse to be made if MuJoCo is not installed."""
        mujoco_library()

    @property
    def version(self) -> str:
        """MuJoCo's version."""
        return str(mujoco_library().__version__)

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that matter for this robot."""
        return in_order(mujoco_switches(robot))

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> MujocoRun:
        """Return the robot at rest at q (nq,); :meth:`rpctl.engines.engine.Engine.start`."""
        spec, notes = load_as_user(robot)
        touching = mend(spec, robot, mended, friction)
        model, told = compiled(spec)
        run = MujocoRun(robot, model, touching, friction)
        run.notes = (*notes, *(f"MuJoCo: {note}" for note in told))
        if "losses" in mended:
            run.set_losses()
        run.start(q, tied="mimic" in mended and not touching.tied)
        return run

    def turning_speed(self, friction: float) -> float:
        """Return the speed (m/s) of the rims at which scrubbing wheels stay on the ground.

        MuJoCo's friction is relaxed: a contact that slides at a speed v is lifted by μ b v/k, where
        b is the rate at which friction ends slip and k the stiffness under the load. With MuJoCo's
        defaults a wheel that scrubs faster than g/(μ b) hops, spins up in the air and grips where
        it lands, which slows the turn.
        """
        slipping_ends = 2.0 / SETTINGS.time_constant  # b, 1/s
        return LIFT * GRAVITY / (friction * slipping_ends)

    def start_turning(self, robot: Robot, q: Array, friction: float) -> TurningRun:
        """Return the robot at rest at q (nq,), with wheels that stay on the ground."""
        return TurningRun(robot, q, friction)


class TurningRun(MujocoWorld):
    """A robot whose wheels stay on the ground while they scrub; an ``EngineRun``."""

    def __init__(self, robot: Robot, q: Array, friction: float) -> None:
        built = build(robot, SETTINGS, friction)
        super().__init__(robot, built)
        self.notes = built.notes
        self.place(q, -robot.drive.ground)
        self.settle()

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        self.run(tau, dt)

    def state(self) -> EngineState:
        """Return the state now."""
        return body_state(self, self.loads(), self.slips())


def body_state(body: MujocoBody, load: Array, slip: Array) -> EngineState:
    """Return the state of a robot in MuJoCo with its loads and slip."""
    joints = {name: body.joint(name) for name in body.dofs}
    return EngineState(body.pose, joints, load, slip, body.energy)


class MujocoRun(RollingBody):
    """A robot in MuJoCo as a user loads it, or mended; an ``EngineRun``."""

    def __init__(self, robot: Robot, model: Any, touching: Touching, friction: float) -> None:
        super().__init__(robot, model, PREFIX + robot.description.root, touching, friction)
        self.notes: tuple[str, ...] = ()
        self._load = np.zeros(len(self.contacts))

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        steps = max(1, math.ceil(dt / self.mjm.opt.timestep - STEP_ROUNDING))
        self._load[:] = 0.0
        for _ in self.steps(tau, steps):
            self._load += self.loads() / steps
        if self.diverged:
            raise EngineFault(f"MuJoCo diverges {self.data.time:.3g} s after the start")

    def state(self) -> EngineState:
        """Return the state now."""
        self.mujoco.mj_fwdPosition(self.mjm, self.data)
        self.mujoco.mj_fwdVelocity(self.mjm, self.data)
        return body_state(self, self._load.copy(), wheel_slips(self.robot, self._motion))

    def _motion(self, link: str) -> LinkMotion:
        body = int(self.mjm.body(PREFIX + link).id)
        twist = self.twist(self.mujoco.mjtObj.mjOBJ_XBODY, body)
        rotation = self.data.xmat[body].reshape(3, 3)
        return LinkMotion(rotation, self.data.xpos[body], twist[:3], twist[3:])

    def set_losses(self) -> None:
        """Give the joints the robot's damping and friction."""
        model = self.mjm
        model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
        for name, dof in self.dofs.items():
            model.dof_damping[dof], model.dof_frictionloss[dof] = joint_losses(self.robot, name)
