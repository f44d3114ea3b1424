"""The prediction of the horizon law: a motion under given accelerations, and its derivatives.

The angles of powered casters are no part of its state: what the base does turns them. With V the
velocity of a caster's pivot (a complex number, in the base's axes), ω the turning rate, k the
distance of its contact behind its axis and z = exp(iθ) its heading, θ̇ = Im(V z̄)/k − ω, so that

    ż = a − i ω z − ā z²,    a = V/2k,

a Riccati equation. Over a step of constant twist its solution is the exact, and so stable,

    z(t) = (c z + σ (a − ½ i ω z)) / (c + σ (ā z + ½ i ω)),    c = cosh st, σ = sinh(st)/s,

with s² = |a|² − ω²/4; divided by cosh st where s is real.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl import math
from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import RANK_MARGIN
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import SingularBasisError
from rpctl.kernels.sheet import Evaluator
from rpctl.robot.model import BASE_NV

LARGEST_TANH = 1.0 - 1e-9  # of the step's decay: a caster that heads backwards stays determinate
STILL = 1e-9  # 1/s: with a smaller s a caster turns as if s were 0
Indices = NDArray[np.intp]


class StageValues(NamedTuple):
    """One number, or the index in x, of each deviation from a motion at the N stages.

    Stage k holds ν̇ of step k, and pose, joints and ν after it.
    """

    nu_dot: Any  # (N, dof)
    pose: Any  # (N, 3)
    joints: Any  # (N, n_joints)
    nu: Any  # (N, dof)

    def flat(self) -> Array:
        """Return them in the order of x."""
        return np.hstack(self).ravel()


class PredictedMotion(NamedTuple):
    """A predicted motion over N steps of constant accelerations.

    ``jacobian`` holds the derivatives of the base's move in each step, x, y and heading: by the
    heading before it, the steering angles before it, and the ν before it and the ν̇ that move it.
    """

    start: Array  # (nq,) initial configuration
    pose: Array  # (N + 1, 3) of P: m, m, rad
    joints: Array  # (N + 1, n_joints)
    nu: Array  # (N + 1, dof)
    nu_dot: Array  # (N, dof)
    casters: Array  # (N + 1, n_powered_casters) rad
    jacobian: Array  # (N, 3, 1 + n_steered + 2 base_columns)


class Model:
    """Precomputed data of the prediction for one robot.

    Its joints are those whose rates are in ν after the base's own speeds: the steered ones, then
    the arm's. All of them are states that integrate their rates.

    Args:
        dynamics: The robot's dynamics.
        steps: Number of steps N.
        dt: Length of a step, s.

    Attributes:
        base: Number of quasi-velocities of the base that are no joints' rates; 0 if it is fixed.
        joints: The steered joints, then the arm's.
        steered: Number of steered joints: the base's twist at given ν depends on them.
        base_columns: Number of quasi-velocities that move the base, the steered joints' rates too.
        casters: Joints of the powered casters, whose angles the base's motion fixes.
        symbolic: The robot's dynamics in scalars.
        indices: Index in x of each stage's deviations.
    """

    def __init__(self, dynamics: ReducedDynamics, steps: int, dt: float) -> None:
        self.dynamics, self.steps, self.dt = dynamics, steps, dt
        self.robot, steered = dynamics.robot, dynamics.robot.drive.steered
        joint, self.steered = self.robot.description.joint, len(steered)
        self.base_columns = len(self.robot.drive.base_speeds)
        self.base = self.base_columns - self.steered
        self.joints = tuple(joint[swivel.joint] for swivel in steered) + self.robot.joints
        self.casters = [swivel.joint for swivel in self.robot.drive.powered_casters]
        self.symbolic = SymbolicDynamics(self.robot)
        dof = self.robot.dof
        ends = np.cumsum([dof, BASE_NV, len(self.joints), dof])
        every = np.arange(steps * ends[-1]).reshape(steps, -1)
        self.indices = StageValues(*np.split(every, ends[:-1], axis=1))
        self._moves = Evaluator(self._step().mapaccum(steps))

    def pose_and_joints(self, stages: Sequence[int]) -> Indices:
        """Return the indices in x (K, 3 + n_joints) of pose and joints at some stages."""
        return np.hstack([self.indices.pose[stages], self.indices.joints[stages]])

    def joint_positions(self, q: Array) -> Array:
        """Return the joints' positions (n_joints,) in q."""
        return np.array([self.robot.joint_position(q, joint.name) for joint in self.joints])

    def configuration(
        self, joints: Array, pose: Array | None = None, casters: Array | None = None
    ) -> Array:
        """Return q (nq,); casters that nothing drives are at 0.

        Mimic joints and swivels that follow are set from the joints that they follow.

        Args:
            joints: Positions of the model's joints (n_joints,), rad or m.
            pose: Pose of P (3,); None puts the root link at the origin.
            casters: Positions of the powered casters (n_powered_casters,), rad; None for 0.
        """
        root = (0.0, 0.0, 0.0) if pose is None else self.robot.root_pose(pose)
        names = (joint.name for joint in self.joints)
        positions = dict(zip(names, joints.tolist(), strict=True))
        if casters is not None:
            positions |= dict(zip(self.casters, casters.tolist(), strict=True))
        return self.robot.configuration(*root, joints=positions)

    def named(self, joints: Any) -> dict[str, Any]:
        """Return positions of the model's joints, or of the first of them, by name."""
        names = (joint.name for joint in self.joints)
        return dict(zip(names, math.vertsplit(joints), strict=False))

    def predict(self, q: Array, nu: Array, nu_dot: Array) -> PredictedMotion:
        """Return the motion under accelerations that are constant in each step.

        ν and the joints are exact; the base moves with the twist at the middle of each step in the
        heading there, which is exact to second order.

        Raises:
            SingularBasisError: Steering angles on the way are singular.
        """
        dt, n, moving = self.dt, self.steps, self.base_columns
        speeds = np.vstack([nu, nu + dt * np.cumsum(nu_dot, axis=0)])
        middle = speeds[:-1] + 0.5 * dt * nu_dot
        joints = self.joint_positions(q) + np.vstack(
            [np.zeros(len(self.joints)), dt * np.cumsum(middle[:, self.base :], axis=0)]
        )
        start = [*self.robot.base_pose(q), *(self.robot.joint_position(q, c) for c in self.casters)]
        beside = np.hstack([joints[:-1, : self.steered], speeds[:-1, :moving], nu_dot[:, :moving]])
        ends, jacobian, margins = self._moves(start, beside.ravel())
        if not (margins > RANK_MARGIN).all():
            raise SingularBasisError("the steered wheels do not determine the motion ahead")
        poses, casters = np.hsplit(np.vstack([start, ends.reshape(n, -1)]), [BASE_NV])
        jacobian = jacobian.reshape(n, BASE_NV, -1)
        return PredictedMotion(q, poses, joints, speeds, nu_dot, casters, jacobian)

    def _step(self) -> Any:
        """Return the function of a step: (pose, casters) and (angles, ν, ν̇) to the next ones.

        Beside them it has the derivatives of the pose's move, row by row, and how far the steering
        is from a singular one.
        """
        dt, first, SX = self.dt, self.base, math.SX
        pose, angles = SX.sym("pose", BASE_NV), SX.sym("angles", self.steered)
        nu, nu_dot = (SX.sym(name, self.base_columns) for name in ("nu", "nu_dot"))
        middle = angles + 0.5 * dt * nu[first:] + 0.125 * dt**2 * nu_dot[first:]
        twist, margin = self._twist(middle, nu + 0.5 * dt * nu_dot)
        theta = pose[2] + 0.5 * dt * twist[2]
        cos, sin = math.cos(theta), math.sin(theta)
        x, y = cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1]
        move, beside = dt * math.vertcat(x, y, twist[2]), math.vertcat(angles, nu, nu_dot)
        jacobian = math.jacobian(move, math.vertcat(pose[2], beside))
        casters = math.SX.sym("casters", len(self.casters))
        ends = math.vertcat(pose + move, self._turned(casters, twist))
        found = [ends, math.densify(jacobian.T), margin]
        return math.Function("step", [math.vertcat(pose, casters), beside], math.cse(found))

    def _twist(self, angles: Any, nu: Any) -> tuple[Any, Any]:
        """Return P's twist (3, 1) at steering angles and ν of the base, and the margin there.

        Casters and followers do not determine it, so they glide here.
        """
        symbols, swivels = self.symbolic, self.robot.drive.swivels
        gliding = [s.joint for s in swivels if s.trails or s.role == "follower"]
        if gliding:
            symbols = SymbolicDynamics(self.robot, gliding=gliding)
        q = symbols.configuration(math.SX.zeros(BASE_NV), self.named(angles))
        nu = math.vertcat(nu, math.SX.zeros(self.robot.dof - self.base_columns))
        return symbols.twist(q, nu), symbols.rank_margin(q)

    def _turned(self, positions: Any, twist: Any) -> Any:
        """Return the powered casters' positions (n, 1) after a step of P's twist (3, 1)."""
        swivels, dt = self.robot.drive.powered_casters, self.dt
        if not swivels:
            return positions
        heading, sign, behind, px, py = math.horzsplit(
            math.DM([[s.heading, s.sign, -2.0 * s.trail, *s.pivot] for s in swivels])
        )
        vx, vy, turn = math.vertsplit(math.DM(self.robot.root_velocity) @ twist)
        ax, ay, half = (vx - turn * py) / behind, (vy + turn * px) / behind, 0.5 * turn
        x, y = math.cos(heading + sign * positions), math.sin(heading + sign * positions)
        square = ax * ax + ay * ay - half * half
        s, decays = math.fmax(math.sqrt(math.fabs(square)), STILL), square > 0.0
        c = math.if_else(decays, 1.0, math.cos(s * dt))
        tanh = math.fmin(math.tanh(s * dt), LARGEST_TANH)
        sigma = math.if_else(decays, tanh, math.sin(s * dt)) / s
        above = math.atan2(c * y + sigma * (ay - half * x), c * x + sigma * (ax + half * y))
        below = math.atan2(sigma * (ax * y - ay * x + half), c + sigma * (ax * x + ay * y))
        turned = above - below - heading
        return sign * math.atan2(math.sin(turned), math.cos(turned))
