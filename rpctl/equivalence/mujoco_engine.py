"""MuJoCo as one more engine: its reading of the URDF, its inertia and its bias.

Neither ``rpctl.dynamics`` nor Pinocchio takes part. The free tree's base velocity is in world axes;
that the wheels roll is said by the S and Ṡν of the Gibbs-Appell derivation, which come from the
file, too, and of which the certificate has rows of their own:

    M = Sᵀ M_free S,   h = Sᵀ (h_free + M_free Ṡν),   B = Sᵀ × actuators' columns.

MuJoCo (Todorov, Erez, Tassa, IROS 2012) is optional, and imported when an engine is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import import_module, metadata
from importlib.util import find_spec
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.file_reading import FileReading, read
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.mujoco_model import MujocoModel
from rpctl.robot.model import Robot

OLDEST_MUJOCO = (3, 14)  # before it MuJoCo turned an inertia read from a URDF to its principal axes


@dataclass(frozen=True)
class EngineTerms:
    """M ν̇ + h = B τ + ℓ at one state.

    Attributes:
        M: Reduced inertia (dof, dof).
        h: Reduced bias (dof,).
        B: Actuation map (dof, n_act).
        damping: The viscous part of ℓ (dof,); friction is no force in MuJoCo but a constraint.
    """

    M: Array
    h: Array
    B: Array
    damping: Array


def installed() -> bool:
    """Return whether a MuJoCo that is new enough can be imported, without importing it."""
    if find_spec("mujoco") is None:
        return False
    major, minor = metadata.version("mujoco").split(".")[:2]
    return (int(major), int(minor)) >= OLDEST_MUJOCO


class MujocoEngine:
    """The equations of one robot by MuJoCo.

    Args:
        reading: Its file; read anew if None.

    Attributes:
        refused: Links that MuJoCo refuses, each with the reason.
        fused: What was done about them: made one body with the links fixed to them.

    Raises:
        EngineRefused: A moving body is unphysical even as a whole; its links are named.
    """

    def __init__(self, robot: Robot, reading: FileReading | None = None) -> None:
        self._mujoco: Any = import_module("mujoco")
        self._robot = robot
        reading = reading or read(robot)
        tree = MujocoModel(robot, reading)
        self.refused, self.fused = tree.refused, tree.fused
        self._model, self._joints = tree.mjm, tree.joints
        self._data = self._mujoco.MjData(self._model)
        self._oracle = GibbsAppell(robot, reading=reading)
        self._columns = np.zeros((robot.nv, len(robot.actuators)))
        for column, name in enumerate(robot.actuators):
            self._columns[self._joints[name], column] = 1.0

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling."""
        S, drift = self._rolling(q, nu)
        self._data.qpos[:3] = q[0], q[1], math.atan2(q[3], q[2])
        for name, index in self._joints.items():
            self._data.qpos[index] = self._robot.joint_position(q, name)
        self._data.qvel[:] = S @ nu
        self._mujoco.mj_fwdPosition(self._model, self._data)
        self._mujoco.mj_fwdVelocity(self._model, self._data)
        M = np.zeros((self._robot.nv, self._robot.nv))
        for row, unit in zip(M, np.eye(self._robot.nv), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        h = S.T @ (self._data.qfrc_bias + M @ drift)
        return EngineTerms(S.T @ M @ S, h, S.T @ self._columns, S.T @ self._data.qfrc_passive)

    def _rolling(self, q: Array, nu: Array) -> tuple[Array, Array]:
        """Return S (nv, dof) and Ṡν (nv,) in MuJoCo's coordinates, by the Gibbs-Appell walk."""
        root, rates = self._oracle.rolling(q, nu)
        S, drift = np.zeros((self._robot.nv, len(nu))), np.zeros(self._robot.nv)
        S[:2], S[2] = root.J_v[:2], root.J_w[2]
        drift[:2], drift[2] = root.a[:2], root.alpha[2]
        for name, index in self._joints.items():
            S[index], drift[index] = rates.rows[name], rates.drifts[name]
        return S, drift
