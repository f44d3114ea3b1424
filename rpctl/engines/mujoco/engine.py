"""``MujocoSimulator``: MuJoCo, as the referee asks it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.wheels import mostly_left
from rpctl.engines.engine import EngineFault, EngineState
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.mends import Touching, mend
from rpctl.engines.mujoco.sentences import mujoco_switches
from rpctl.engines.mujoco.turning import SETTING, TurningRun, calm_speed
from rpctl.engines.mujoco.user_load import PREFIX, compiled, load_as_user
from rpctl.engines.switches import Switch, Switches
from rpctl.engines.tie_rods import STABLE
from rpctl.equivalence.contact.ties import TIE_ROD_BANDWIDTH, Rollers, TieRods
from rpctl.robot.model import Robot

TICK_S = 2e-3  # s: one of MuJoCo's default steps
STEP_ROUNDING = 1e-6  # of a step


@dataclass(frozen=True)
class MujocoSimulator:
    """MuJoCo; :class:`rpctl.engines.engine.Engine` has the attributes.

    Raises:
        EngineMissing: It is not installed.
    """

    name: str = "MuJoCo"
    tick: float = TICK_S
    turning_setting: str = SETTING

    def __post_init__(self) -> None:
        """Refuse to be without the library."""
        mujoco_library()

    @property
    def version(self) -> str:
        """MuJoCo's version."""
        return str(mujoco_library().__version__)

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something of this robot."""
        return mujoco_switches(robot)

    def start(self, robot: Robot, q: Array, switches: Switches, friction: float) -> MujocoRun:
        """Return the robot at rest at q; :meth:`rpctl.engines.engine.Engine.start`.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            switches: What is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.
        """
        loaded = load_as_user(robot)
        touching = mend(loaded.spec, robot, switches, friction)
        model, told = compiled(loaded.spec)
        run = MujocoRun(robot, model, touching, switches, friction)
        run.notes = (*loaded.notes, *(f"MuJoCo: {note}" for note in told))
        run.place(q)
        return run

    def turning_speed(self, friction: float) -> float:
        """Return the speed (m/s) of the rims at which scrubbing wheels stay on the ground."""
        return calm_speed(friction)

    def start_turning(self, robot: Robot, q: Array, friction: float) -> TurningRun:
        """Return the robot at rest at q, its wheels so that they stay on the ground.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            friction: Coefficient between wheels and ground.
        """
        return TurningRun(robot, q, friction)


class MujocoRun:
    """A robot in MuJoCo; :class:`rpctl.engines.engine.EngineRun` has the attributes.

    Args:
        robot: The robot.
        model: Its ``MjModel``.
        touching: What meets the ground.
        switches: What is mended.
        friction: Coefficient along what a roller holds.
    """

    def __init__(
        self, robot: Robot, model: Any, touching: Touching, switches: Switches, friction: float
    ) -> None:
        self._mujoco, self._robot, self._model = mujoco_library(), robot, model
        self._data: Any = self._mujoco.MjData(model)
        self.contacts, self.notes = touching.contacts, tuple[str, ...]()
        self._dofs = {name: int(model.joint(name).dofadr[0]) for name in robot.moving_joint_names}
        index = {name: k for k, name in enumerate(touching.contacts)}
        self._owner = {model.geom(g).id: index[name] for g, name in touching.owner.items()}
        crowned = {name: model.geom(geom).id for name, geom in touching.crowned.items()}
        self._rollers = Rollers(robot, model, self._data, crowned, friction)
        bandwidth = min(TIE_ROD_BANDWIDTH, STABLE / model.opt.timestep)
        self._rods = TieRods(robot, model, self._data, self._dofs, bandwidth)
        self._pulled = switches.mended("mimic") and not touching.tied
        kinds = self._mujoco.mjtWarning
        self._bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        model.opt.disableflags |= int(self._mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        if switches.mended("losses"):
            self._set_losses()
        self._load = np.zeros(len(self.contacts))
        self._wheels = [_WheelBody(robot, model, k) for k in range(len(robot.drive.wheels))]

    def place(self, q: Array) -> None:
        """Put the robot at q (nq,), at rest, its wheels at the height of the ground."""
        data, half = self._data, 0.5 * math.atan2(float(q[3]), float(q[2]))
        data.qpos[:3] = q[0], q[1], -self._robot.drive.ground
        data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        for name, dof in self._dofs.items():
            data.qpos[dof + 1] = self._robot.joint_position(q, name)
        self._mujoco.mj_forward(self._model, data)
        self._rods.measure()

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts for ``dt``; :meth:`rpctl.engines.engine.EngineRun.advance`."""
        data, given = self._data, np.zeros(self._model.nv)
        for name, effort in efforts.items():
            given[self._dofs[name]] = effort
        steps = max(1, math.ceil(dt / self._model.opt.timestep - STEP_ROUNDING))
        self._load[:] = 0.0
        with _silent():
            for _ in range(steps):
                data.qfrc_applied[:] = given
                if self._pulled:
                    self._rods.pull()
                self._step()
                self._load += self._loads() / steps
        if any(data.warning[int(kind)].number for kind in self._bad):
            raise EngineFault(f"MuJoCo diverges {data.time:.3g} s after it was put down")

    def state(self) -> EngineState:
        """Return the state now."""
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        w, x, y, z = data.qpos[3:7]
        joints = {
            name: (float(data.qpos[dof + 1]), float(data.qvel[dof]))
            for name, dof in self._dofs.items()
        }
        return EngineState(
            t=float(data.time),
            pose=np.array([*data.qpos[:3], x, y, z, w]),
            joints=joints,
            load=self._load.copy(),
            slip=np.array([wheel.slip(data) for wheel in self._wheels]).reshape(-1, 2),
            energy=float(data.energy.sum()),
        )

    def _step(self) -> None:
        mujoco, model, data = self._mujoco, self._model, self._data
        if not self._rollers.geoms:
            mujoco.mj_step(model, data)
            return
        mujoco.mj_step1(model, data)
        self._rollers.turn()
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_projectConstraint(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_step2(model, data)

    def _loads(self) -> Array:
        """Return the vertical force of each contact in the last step (n,), N."""
        contacts, wrench, load = self._data.contact, np.zeros(6), np.zeros(len(self.contacts))
        rows = (contacts.geom1, contacts.geom2, contacts.frame[:, 2])
        for k, (one, other, up) in enumerate(zip(*rows, strict=True)):
            owner = self._owner.get(int(other), self._owner.get(int(one)))
            if owner is not None and self._model.geom_bodyid[one] == 0:
                self._mujoco.mj_contactForce(self._model, self._data, k, wrench)
                load[owner] += wrench[0] * up
        return load

    def _set_losses(self) -> None:
        """Give the joints the robot's damping and friction."""
        losses, robot = self._robot.losses, self._robot
        self._model.dof_damping[:], self._model.dof_frictionloss[:] = 0.0, 0.0
        if losses is None:
            return
        for name, dof in self._dofs.items():
            at = robot.velocity_index(name)
            self._model.dof_damping[dof] = losses.damping[at]
            self._model.dof_frictionloss[dof] = losses.friction[at]


@contextmanager
def _silent() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings to the terminal and to a file of its own."""
    mujoco = mujoco_library()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


class _WheelBody:
    """A wheel, whose contact point's velocity is asked."""

    def __init__(self, robot: Robot, model: Any, index: int) -> None:
        wheel = robot.drive.wheels[index]
        joint = robot.description.joint[wheel.joint]
        self._model = model
        self._body = int(model.body(PREFIX + joint.child).id)
        self._axis, self._radius = np.array(wheel.axis), wheel.radius
        self._offset = wheel.offset * self._axis
        self._left = math.copysign(1.0, mostly_left(robot.tree.axis(joint)))

    def slip(self, data: Any) -> tuple[float, float]:
        """Return the velocity of the point below the wheel's centre, ahead and to the left."""
        mujoco, velocity = mujoco_library(), np.zeros(6)
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self._model, data, kind, self._body, velocity, 0)
        R = data.xmat[self._body].reshape(3, 3)
        arm = R @ self._offset - np.array([0.0, 0.0, self._radius])
        moving = velocity[3:] + np.cross(velocity[:3], arm)
        left = self._left * (R @ self._axis)[:2]
        left /= max(float(np.hypot(*left)), 1e-12)
        return float(moving[0] * left[1] - moving[1] * left[0]), float(moving[:2] @ left)
