"""MuJoCo as one more engine: its reading of the URDF, its inertia, bias and Jacobians.

Neither ``rpctl.dynamics`` nor Pinocchio takes part. The wheels' rolling is imposed on the free
tree, whose base velocity is in world axes, through MuJoCo's Jacobians J and their rates J̇:

    [A; W] v = [0; ν],   [A; W] S = [0; I],   [A; W] Ṡν = −[Ȧ; Ẇ] v,
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

from rpctl.description.records import Array
from rpctl.equivalence.mujoco_model import EngineRefused, MujocoModel
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

__all__ = ["EngineRefused", "EngineTerms", "MujocoEngine", "installed"]

DOWN = np.array([0.0, 0.0, -1.0])
OLDEST = (3, 14)  # before it MuJoCo turned an inertia read from a URDF to its principal axes
CONTRADICTION = 1e-9  # of the solution: rows that no motion meets; rounding leaves 1e-13


@dataclass(frozen=True)
class EngineTerms:
    """M ν̇ + h = B τ at one state.

    Attributes:
        M: Reduced inertia (dof, dof).
        h: Reduced bias (dof,).
        B: Actuation map (dof, n_act).
    """

    M: Array
    h: Array
    B: Array


def installed() -> bool:
    """Return whether a MuJoCo that is new enough can be imported, without importing it."""
    if find_spec("mujoco") is None:
        return False
    major, minor = metadata.version("mujoco").split(".")[:2]
    return (int(major), int(minor)) >= OLDEST


class MujocoEngine:
    """The equations of one robot by MuJoCo.

    Args:
        robot: The robot; its file, drive, locked joints and names are used, not its model.

    Attributes:
        refused: Links that MuJoCo refuses, each with the reason.
        fused: What was done about them: made one body with the links fixed to them.

    Raises:
        EngineRefused: A moving body is unphysical even as a whole; its links are named.
    """

    def __init__(self, robot: Robot) -> None:
        self._mujoco: Any = import_module("mujoco")
        self._robot = robot
        tree = MujocoModel(robot)
        self.refused, self.fused = tree.refused, tree.fused
        self._model, self._root, self._joints = tree.mjm, tree.root, tree.joints
        self._data = self._mujoco.MjData(self._model)
        base = 3 if robot.drive.type == "fixed" else 0
        self._rolling = len(robot.drive.wheels) + robot.drive.has_axle
        self._constraints = self._rolling + base + len(robot.mimics)
        self._always = self._constant_rows()
        self._columns = np.zeros((robot.nv, len(robot.actuators)))
        for column, name in enumerate(robot.actuators):
            self._columns[self._joints[name], column] = 1.0

    def full(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return inertia (nv, nv) and bias (nv,) of the free tree, as Pinocchio orders v (nv,).

        Pinocchio's base velocity is in the body's axes: v_MuJoCo = T v, and Ṫ v = ω ẑ × T v.
        """
        robot, cos, sin = self._robot, q[2], q[3]
        T = np.zeros((robot.nv, robot.nv))
        T[:3, :3] = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
        for name, index in self._joints.items():
            T[index, robot.velocity_index(name)] = 1.0
        speed = T @ v
        turning = np.zeros(robot.nv)
        turning[:2] = -speed[2] * speed[1], speed[2] * speed[0]
        self._move(q, speed)
        M = self._inertia()
        return T.T @ M @ T, T.T @ (self._data.qfrc_bias + M @ turning)

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling.

        Raises:
            RpctlError: The constraints and ν do not determine one motion.
        """
        self._move(q, np.zeros(self._robot.nv))
        rows = self._rows(self._mujoco.mj_jac) + self._always
        wanted = np.zeros((len(rows), len(nu)))
        wanted[self._constraints :] = np.eye(len(nu))
        S = _solve(rows, wanted)
        v = S @ nu
        self._move(q, v)
        drift = self._rows(self._mujoco.mj_jacDot) @ v
        drift += self._turning(v)
        Sdot_nu = _solve(rows, -drift)
        M = self._inertia()
        h = S.T @ (self._data.qfrc_bias + M @ Sdot_nu)
        return EngineTerms(S.T @ M @ S, h, S.T @ self._columns)

    def _move(self, q: Array, speed: Array) -> None:
        """Set MuJoCo's state: q (nq,) as Pinocchio's, the speed (nv,) as MuJoCo's."""
        self._data.qpos[:3] = q[0], q[1], math.atan2(q[3], q[2])
        for name, index in self._joints.items():
            self._data.qpos[index] = self._robot.joint_position(q, name)
        self._data.qvel[:] = speed
        self._mujoco.mj_fwdPosition(self._model, self._data)
        self._mujoco.mj_fwdVelocity(self._model, self._data)

    def _inertia(self) -> Array:
        """Return the free tree's inertia (nv, nv): its product with each unit vector."""
        M = np.zeros((self._robot.nv, self._robot.nv))
        for row, unit in zip(M, np.eye(self._robot.nv), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        return M

    def _rows(self, kind: Any) -> Array:
        """Return [A; W], or its rate, as far as Jacobians ``kind`` make it; zero elsewhere.

        One row a wheel: the velocity of its contact point, v_c + ω × (−r ẑ), along the direction
        in which it stands still. With an axle two rows for P: its velocity to the left, and its
        forward speed; else one each for the base's velocity along its own axes.
        """
        rows = np.zeros((self._constraints + self._robot.dof, self._robot.nv))
        for at, direction, point in self._directed(self._points(kind)):
            rows[at] = direction @ point
        return rows

    def _turning(self, v: Array) -> Array:
        """Return what the turning of the directions adds to the rate of :meth:`_rows` times v."""
        drift = np.zeros(self._constraints + self._robot.dof)
        points = [J @ v for J in self._points(self._mujoco.mj_jac)]
        for at, direction, velocity in self._directed(points):
            drift[at] = v[2] * np.cross(-DOWN, direction) @ velocity
        return drift

    def _directed(self, points: list[Array]) -> list[tuple[int, Array, Array]]:
        """Return (row, direction (3,) in the world, point's entry) of every row that turns."""
        drive, R = self._robot.drive, self._data.xmat[self._root].reshape(3, 3)
        *contacts, P = points
        found = [
            (at, R @ [*wheel.direction, 0.0], contact)
            for at, (wheel, contact) in enumerate(zip(drive.wheels, contacts, strict=True))
        ]
        first = self._constraints
        if drive.has_axle:
            ahead = R @ [math.cos(drive.heading), math.sin(drive.heading), 0.0]
            return [*found, (self._rolling - 1, np.cross(-DOWN, ahead), P), (first, ahead, P)]
        if drive.base_speeds:
            return [*found, (first, R[:, 0], P), (first + 1, R[:, 1], P)]
        return found

    def _points(self, kind: Any) -> list[Array]:
        """Return J or J̇ (3, nv) of each wheel's contact point, then of P."""
        model, data, drive = self._model, self._data, self._robot.drive
        jacobians = []
        for wheel in drive.wheels:
            joint = model.joint(wheel.joint).id
            centre = data.xanchor[joint] + wheel.offset * data.xaxis[joint]
            linear, angular = self._jacobian(kind, centre, model.jnt_bodyid[joint])
            jacobians.append(linear + np.cross(angular, wheel.radius * DOWN, axisa=0, axisc=0))
        R = data.xmat[self._root].reshape(3, 3)
        P = data.xpos[self._root] + R @ np.array([*drive.point, 0.0])
        return [*jacobians, self._jacobian(kind, P, self._root)[0]]

    def _jacobian(self, kind: Any, point: Array, body: int) -> tuple[Array, Array]:
        """Return J or J̇ (3, nv), linear and angular, of a point (world) fixed in a body."""
        linear, angular = np.zeros((2, 3, self._robot.nv))
        kind(self._model, self._data, linear, angular, point, body)
        return linear, angular

    def _constant_rows(self) -> Array:
        """Return the rows of [A; W] that no motion changes: mimics, a held base, turn, joints."""
        robot = self._robot
        rows = np.zeros((self._constraints + robot.dof, robot.nv))
        at = self._rolling
        if robot.drive.type == "fixed":
            rows[at : at + 3, :3] = np.eye(3)
            at += 3
        for row, joint in enumerate(robot.mimics, start=at):
            rows[row, self._joints[joint.name]] = 1.0
            if joint.mimic is not None and joint.mimic.joint in self._joints:
                rows[row, self._joints[joint.mimic.joint]] -= joint.mimic.multiplier
        if robot.drive.base_speeds:
            rows[self._constraints + len(robot.drive.base_speeds) - 1, 2] = 1.0
        first = self._constraints + len(robot.drive.base_speeds)
        for row, joint in enumerate(robot.joints, start=first):
            rows[row, self._joints[joint.name]] = 1.0
        return rows


def _solve(rows: Array, wanted: Array) -> Array:
    """Solve [A; W] X = ``wanted``, which has one solution if the robot has one motion.

    A second pass on what is left brings 1e-13, the singular value decomposition's, to rounding.

    Raises:
        RpctlError: It has none, or many.
    """
    solution, _, rank, _ = np.linalg.lstsq(rows, wanted, rcond=CONTRADICTION)
    solution += np.linalg.lstsq(rows, wanted - rows @ solution, rcond=CONTRADICTION)[0]
    gap = np.abs(rows @ solution - wanted).max()
    if rank < rows.shape[1] or gap > CONTRADICTION * max(1.0, float(np.abs(solution).max())):
        raise RpctlError("rolling wheels and quasi-velocities do not determine one motion")
    return np.asarray(solution)
