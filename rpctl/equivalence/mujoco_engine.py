"""MuJoCo as one more engine: its reading of the URDF, its inertia, bias and Jacobians.

Neither ``rpctl.dynamics`` nor Pinocchio takes part. The wheels' rolling is imposed on the free
tree, whose base velocity is in world axes, through MuJoCo's Jacobians J and their rates J̇:

    [A; W] v = [0; ν],   [A; W] S = [0; I],   [A; W] Ṡν = −[Ȧ; Ẇ] v,
    M = Sᵀ M_free S,   h = Sᵀ (h_free + M_free Ṡν),   B = Sᵀ × actuators' columns.

MuJoCo (Todorov, Erez, Tassa, IROS 2012) is optional, and imported when an engine is made.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module, metadata
from importlib.util import find_spec
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.equivalence.file_reading import FileReading, read
from rpctl.equivalence.mujoco_model import EngineRefused, MujocoModel
from rpctl.equivalence.planar import JointRate, follower_rate
from rpctl.equivalence.tree import FLOATS, Tree, cross, cross_columns
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

__all__ = ["EngineRefused", "EngineTerms", "MujocoEngine", "installed"]

DOWN = np.array([0.0, 0.0, -1.0])
OLDEST_MUJOCO = (3, 14)  # before it MuJoCo turned an inertia read from a URDF to its principal axes
CONTRADICTION_TOLERANCE = 1e-9  # of the solution: rows that no motion meets; rounding leaves 1e-13


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
        self._drive = reading.drive
        tree = MujocoModel(robot, reading)
        self.refused, self.fused = tree.refused, tree.fused
        self._model, self._root, self._joints = tree.mjm, tree.root, tree.joints
        self._data = self._mujoco.MjData(self._model)
        self._tree = Tree(robot, FLOATS, reading)
        self._rows_of = self._row_numbers()
        held = 3 if self._drive.type == "fixed" else 0
        self._constraints = len(self._drive.wheels) + len(set(self._rows_of.values())) + held
        self._always = self._constant_rows()
        self._columns = np.zeros((robot.nv, len(robot.actuators)))
        for column, name in enumerate(robot.actuators):
            self._columns[self._joints[name], column] = 1.0

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling.

        Raises:
            RpctlError: The constraints and ν do not determine one motion.
        """
        self._move(q, np.zeros(self._robot.nv))
        rows = self._rows(self._mujoco.mj_jac) + self._always
        for name, rate in self._follower_rates(q, np.zeros(self._robot.nv)):
            rows[self._rows_of[name]] -= rate.row
        wanted = np.zeros((len(rows), len(nu)))
        wanted[self._constraints :] = np.eye(len(nu))
        S = _solve(rows, wanted)
        v = S @ nu
        self._move(q, v)
        drift = self._rows(self._mujoco.mj_jacDot) @ v
        drift += self._turning_drift(v)
        for name, rate in self._follower_rates(q, v):
            drift[self._rows_of[name]] -= rate.drift
        Sdot_nu = _solve(rows, -drift)
        M = self._inertia()
        h = S.T @ (self._data.qfrc_bias + M @ Sdot_nu)
        return EngineTerms(S.T @ M @ S, h, S.T @ self._columns, S.T @ self._data.qfrc_passive)

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

        A wheel's row is the velocity of its contact point, v_c + ω × (−r ẑ), along the direction
        in which it stands still; one on a swivel, and the swivel's lateral row, are of the place
        where the swivel's axis meets the ground. With an axle two rows are of P: its velocity to
        the left, and its forward speed; else one each of the base's velocity along its own axes.
        """
        rows = np.zeros((self._constraints + self._robot.dof, self._robot.nv))
        for at, direction, _, J in self._directed_rows(kind):
            rows[at] += direction @ J
        return rows

    def _turning_drift(self, v: Array) -> Array:
        """Return what the turning of the directions adds to the rate of :meth:`_rows` times v."""
        drift = np.zeros(self._constraints + self._robot.dof)
        for at, direction, turn, J in self._directed_rows(self._mujoco.mj_jac):
            drift[at] += (turn @ v) * cross(-DOWN, direction) @ (J @ v)
        return drift

    def _directed_rows(self, kind: Any) -> Iterator[tuple[int, Array, Array, Array]]:
        """Yield a row, its direction (3,), the turning of it (nv,), J or J̇ (3, nv) of its point."""
        drive, R = self._drive, self._data.xmat[self._root].reshape(3, 3)
        turn, first = np.eye(self._robot.nv)[2], self._constraints
        for at, wheel in enumerate(drive.wheels):
            if wheel.swivel is None:
                yield at, R @ [*wheel.direction, 0.0], turn, self._contact(kind, wheel)
        for swivel in drive.swivels:
            index = self._joints[swivel.joint]
            swing = turn + swivel.sign * np.eye(self._robot.nv)[index]
            angle = swivel.heading + swivel.sign * self._data.qpos[index]
            ahead = R @ [math.cos(angle), math.sin(angle), 0.0]
            J = self._base(kind, swivel.pivot)
            for wheel_row in drive.carried(swivel):
                yield wheel_row, ahead, swing, J
            if swivel.role != "follower":
                yield self._rows_of[swivel.joint], cross(-DOWN, ahead), swing, J
        P = self._base(kind, drive.point)
        if drive.has_axle:
            ahead = R @ [math.cos(drive.heading), math.sin(drive.heading), 0.0]
            yield self._rows_of["P"], cross(-DOWN, ahead), turn, P
            yield first, ahead, turn, P
        elif drive.wheels and not drive.steered:
            yield first, R[:, 0], turn, P
            yield first + 1, R[:, 1], turn, P

    def _contact(self, kind: Any, wheel: Wheel) -> Array:
        """Return J or J̇ (3, nv) of the contact point of a wheel that the root link holds."""
        joint, data = self._model.joint(wheel.joint).id, self._data
        centre = data.xanchor[joint] + wheel.offset * data.xaxis[joint]
        linear, angular = self._jacobian(kind, centre, self._model.jnt_bodyid[joint])
        J = linear + cross_columns(angular, wheel.radius * DOWN)
        left = self._drive.heading + 0.5 * math.pi
        grip = (wheel.shift * math.cos(left), wheel.shift * math.sin(left))
        return J + self._base(kind, grip) - self._base(kind, (0.0, 0.0))

    def _base(self, kind: Any, place: tuple[float, float]) -> Array:
        """Return J or J̇ (3, nv) of a place of the root link's frame that moves along with it."""
        R = self._data.xmat[self._root].reshape(3, 3)
        point = self._data.xpos[self._root] + R @ np.array([*place, 0.0])
        return self._jacobian(kind, point, self._root)[0]

    def _follower_rates(self, q: Array, v: Array) -> Iterator[tuple[str, JointRate]]:
        """Yield the swivels that follow others, and their rates as rows of v (nv,)."""
        drive, identity = self._drive, np.eye(self._robot.nv)
        rates = {s.joint: JointRate(identity[self._joints[s.joint]], 0.0) for s in drive.swivels}
        positions = {name: self._robot.joint_position(q, name) for name in rates}
        for swivel in drive.followers:
            yield swivel.joint, follower_rate(self._tree, drive, swivel, positions, v, rates)

    def _row_numbers(self) -> dict[str, int]:
        """Return the rows of A by what they are of: after the wheels, P, swivels and mimics."""
        drive = self._drive
        names = ["P"] if drive.has_axle else []
        names += [s.joint for s in drive.swivels if s.shares is None]
        names += [f"mimic {joint.name}" for joint in self._robot.mimics]
        rows = {name: len(drive.wheels) + k for k, name in enumerate(names)}
        return rows | {s.joint: rows[s.shares] for s in drive.swivels if s.shares is not None}

    def _jacobian(self, kind: Any, point: Array, body: int) -> tuple[Array, Array]:
        """Return J or J̇ (3, nv), linear and angular, of a point (world) fixed in a body."""
        linear, angular = np.zeros((2, 3, self._robot.nv))
        kind(self._model, self._data, linear, angular, point, body)
        return linear, angular

    def _constant_rows(self) -> Array:
        """Return the rows of [A; W] that no motion changes: mimics, a held base, turn, joints."""
        robot, drive, turn = self._robot, self._drive, np.eye(self._robot.nv)[2]
        rows = np.zeros((self._constraints + robot.dof, robot.nv))
        speed = self._constraints
        for swivel in drive.swivels:
            swing = turn.copy()
            swing[self._joints[swivel.joint]] = swivel.sign
            if swivel.role == "follower":
                rows[self._rows_of[swivel.joint], self._joints[swivel.joint]] = 1.0
            else:
                rows[self._rows_of[swivel.joint]] += swivel.trail * swing
            for at in drive.carried(swivel):
                wheel = drive.wheels[at]
                lever = self._tree.wheels[wheel.joint].lever
                rows[at] -= wheel.lateral * swing
                rows[at, self._joints[wheel.joint]] = -lever
                if not drive.has_axle and drive.steered and swivel == drive.steered[0]:
                    share = lever / len(drive.carried(swivel))
                    rows[speed, self._joints[wheel.joint]] = share
        if drive.type == "fixed":
            rows[:3, :3] = np.eye(3)
        for joint in robot.mimics:
            at = self._rows_of[f"mimic {joint.name}"] + 3 * (drive.type == "fixed")
            rows[at, self._joints[joint.name]] = 1.0
            leader, factor = self._tree.leader(joint.name)
            if leader in self._joints:
                rows[at, self._joints[leader]] -= factor
        if drive.base_speeds and not drive.steered:
            rows[self._constraints + len(drive.base_speeds) - 1, 2] = 1.0
        own = [*(swivel.joint for swivel in drive.steered), *robot.joint_names]
        for row, name in enumerate(own, start=len(rows) - len(own)):
            rows[row, self._joints[name]] = 1.0
        return rows


def _solve(rows: Array, wanted: Array) -> Array:
    """Solve [A; W] X = ``wanted``, which has one solution if the robot has one motion.

    A second pass on what is left brings 1e-13, the singular value decomposition's, to rounding.

    Raises:
        RpctlError: It has none, or many.
    """
    solution, _, rank, _ = np.linalg.lstsq(rows, wanted, rcond=CONTRADICTION_TOLERANCE)
    solution += np.linalg.lstsq(rows, wanted - rows @ solution, rcond=CONTRADICTION_TOLERANCE)[0]
    gap = np.abs(rows @ solution - wanted).max()
    if rank < rows.shape[1] or gap > CONTRADICTION_TOLERANCE * max(
        1.0, float(np.abs(solution).max())
    ):
        raise RpctlError("rolling wheels and quasi-velocities do not determine one motion")
    return np.asarray(solution)
