"""What rpctl's loops are timed beside: MuJoCo on the same robot, rolling on a plane."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.contact.model import ContactModel
from rpctl.robot.model import Robot

HOLDING = {"p": 100.0, "d": 10.0}  # of a joint of the arm, N·m/rad and N·m·s/rad


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
        self.model, self.data, self.robot = model._model, model._data, robot
        self.model.opt.timestep = dt
        tau = dynamics.efforts(q, dynamics.bias(q, np.zeros(robot.dof)))
        self._dofs = [model._dofs[name] for name in robot.actuators]
        self.force = np.zeros(self.model.nv)
        self.force[self._dofs] = tau

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
            self._rollout.rollout(
                self.model, self.data, start[None], control, control_spec=int(kind)
            )
        return time.process_time() - began

    def with_python_control(self, steps: int) -> float:
        """Return the processor time, s, of one run whose arm a controller in Python holds."""
        m, data, dofs = self.mujoco, self.data, self._dofs
        q0: Array = data.qpos[np.array(dofs) + 1].copy()
        began = time.process_time()
        for _ in range(steps):
            error = q0 - data.qpos[np.array(dofs) + 1]
            data.qfrc_applied[dofs] = (
                self.force[dofs] + HOLDING["p"] * error - HOLDING["d"] * data.qvel[dofs]
            )
            m.mj_step(self.model, data)
        return time.process_time() - began
