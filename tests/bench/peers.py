"""What rpctl's loops are timed beside: MuJoCo on the same robot, rolling on a plane."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.equivalence.contact.model import ContactModel
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.simulation.plants.contact import MujocoMotion

HOLDING = 20.0  # rad/s: bandwidth at which a joint of the arm is held, critically damped


class MujocoPeer:
    """A robot in MuJoCo, on its wheels, its arm held by the efforts of the reduced model.

    Args:
        robot: The robot.
        dt: Time step, s.
    """

    def __init__(self, robot: Robot, dt: float) -> None:
        self.mujoco: Any = pytest.importorskip("mujoco")
        self._rollout: Any = pytest.importorskip("mujoco.rollout")
        dynamics = ReducedDynamics(robot)
        model, q = ContactModel(robot), robot.configuration_at(np.zeros(3), robot.home)
        model.start(q)
        self.model, self.data, self.robot = model.mjm, model.data, robot
        self.model.opt.timestep = dt
        tau = dynamics.efforts(q, dynamics.bias(q, np.zeros(robot.dof)))
        self._began = float(self.data.time)
        self._dofs = [model.dofs[name] for name in robot.actuators]
        self.force = np.zeros(self.model.nv)
        self.force[self._dofs] = tau
        M = np.zeros((self.model.nv, self.model.nv))
        self.mujoco.mj_fullM(self.model, self.data, M)
        self._inertia = M[self._dofs, self._dofs]

    def rollouts(self, count: int, steps: int) -> float:
        """Return the processor time, s, of runs without feedback, one after the other."""
        m = self.mujoco
        spec = m.mjtState.mjSTATE_FULLPHYSICS
        start = np.zeros(m.mj_stateSize(self.model, spec))
        m.mj_getState(self.model, self.data, start, spec)
        kind = m.mjtState.mjSTATE_QFRC_APPLIED
        control = np.tile(self.force, (1, steps, 1))
        began = time.process_time()
        for _ in range(count):
            states, _ = self._rollout.rollout(
                self.model, self.data, start[None], control, control_spec=int(kind)
            )
        took = time.process_time() - began
        self._require_sound(float(states[0, -1, 0]) - steps * self.model.opt.timestep)
        return took

    def with_python_control(self, steps: int) -> float:
        """Return the processor time, s, of one run whose arm a controller in Python holds."""
        m, data, dofs = self.mujoco, self.data, self._dofs
        q0: Array = data.qpos[np.array(dofs) + 1].copy()
        p, d = HOLDING**2 * self._inertia, 2.0 * HOLDING * self._inertia
        began = time.process_time()
        for _ in range(steps):
            error = q0 - data.qpos[np.array(dofs) + 1]
            data.qfrc_applied[dofs] = self.force[dofs] + p * error - d * data.qvel[dofs]
            m.mj_step(self.model, data)
        took = time.process_time() - began
        self._require_sound(data.time - steps * self.model.opt.timestep)
        return took

    def _require_sound(self, late: float) -> None:
        """Refuse a time that was not simulated: MuJoCo begins anew where a motion diverges.

        Args:
            late: How much later than expected it ended, s.
        """
        if abs(late - self._began) > 1e-6:
            raise ValueError("MuJoCo's robot diverged: its time says nothing")


def same_world(robot: Robot, dt: float, steps: int) -> float:
    """Return the processor time, s, of the contact plant's own world, its arm held from Python.

    Args:
        robot: The robot.
        dt: Control period, s; the world divides it into steps as the plant does.
        steps: Control periods.
    """
    dynamics, q = ReducedDynamics(robot), robot.configuration_at(np.zeros(3), robot.home)
    world = MujocoMotion(robot, ContactSettings(), RunSettings().friction, q)
    model, data = world.mjm, world.data
    dofs = model.jnt_dofadr[[model.actuator(name).trnid[0] for name in robot.actuators]]
    held, M = world.places, np.zeros((model.nv, model.nv))
    world.mujoco.mj_fullM(model, data, M)
    p = HOLDING**2 * M[dofs, dofs]
    tau = dynamics.efforts(q, dynamics.bias(q, np.zeros(robot.dof)))
    began = time.process_time()
    for _ in range(steps):
        world.run(tau + p * (held - world.places - 2.0 / HOLDING * data.qvel[dofs]), dt)
    return time.process_time() - began
