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

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.projection import eliminate
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import RANK_MARGIN, find_rolling, selection
from rpctl.errors import SingularBasisError
from rpctl.robot.coordinates import write_root
from rpctl.robot.model import BASE_NV, Robot

LARGEST_TANH = 1.0 - 1e-9  # of the step's decay: a caster that heads backwards stays determinate
STILL = 1e-9  # 1/s: with a smaller s a caster turns as if s were 0
Indices = NDArray[np.intp]


class Casters:
    """The powered casters of one robot."""

    def __init__(self, robot: Robot) -> None:
        casters = robot.drive.powered_casters
        self._root_velocity = robot.root_velocity
        self._pivots = np.array([complex(*swivel.pivot) for swivel in casters], dtype=complex)
        self._behind = np.array([-swivel.trail for swivel in casters])  # k, m
        self._headings = np.array([swivel.heading for swivel in casters])
        self._signs = np.array([swivel.sign for swivel in casters])
        self._entries = tuple(robot.entries[swivel.joint] for swivel in casters)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._entries)

    def read(self, q: Array) -> Array:
        """Return the positions (n,) in q, rad."""
        return np.array([entry.read(q) for entry in self._entries])

    def write(self, q: Array, positions: Array) -> None:
        """Set positions (n,), rad, in q."""
        for entry, position in zip(self._entries, positions.tolist(), strict=True):
            entry.write(q, position)

    def follow(self, positions: Array, twists: Array, dt: float) -> Array:
        """Return the positions (N + 1, n) along a motion, rad.

        Args:
            twists: P's twists (N, 3), constant in each step.
            dt: Length of a step, s.
        """
        if not len(self):
            return np.empty((len(twists) + 1, 0))
        z = np.exp(1j * (self._headings + self._signs * positions))
        found = [z]
        for x, y, turn in (twists @ self._root_velocity.T).tolist():
            z = self._turned(z, complex(x, y) + 1j * turn * self._pivots, turn, dt)
            found.append(z)
        turned = np.angle(np.array(found) * np.exp(-1j * self._headings))
        return np.asarray(self._signs * turned)

    def _turned(self, z: Array, V: Array, turn: float, dt: float) -> Array:
        """Return the headings (n,) after a step; V (n,) are the pivots' velocities, m/s."""
        a = V / (2.0 * self._behind)
        square = np.abs(a) ** 2 - 0.25 * turn**2
        s = np.maximum(np.sqrt(np.abs(square)), STILL)
        decays = square > 0.0
        c = np.where(decays, 1.0, np.cos(s * dt))
        sigma = np.where(decays, np.minimum(np.tanh(s * dt), LARGEST_TANH), np.sin(s * dt)) / s
        swing = 0.5j * turn
        moved = c * z + sigma * (a - swing * z)
        moved /= c + sigma * (a.conj() * z + swing)
        return np.asarray(moved / np.abs(moved))


class PredictedMotion(NamedTuple):
    """A predicted motion over N steps of constant accelerations."""

    start: Array  # (nq,) initial configuration
    pose: Array  # (N + 1, 3) of P: m, m, rad
    joints: Array  # (N + 1, n_joints)
    nu: Array  # (N + 1, dof)
    nu_dot: Array  # (N, dof)
    twist: Array  # (N, 3) of the base at the middle of each step
    twist_map: Array  # (N, 3, dof) or (1, 3, dof): twist = twist_map ν, at the middle of each step
    casters: Array  # (N + 1, n_powered_casters) rad


class PoseJacobian(NamedTuple):
    """Derivatives of the base's pose after each step by the state and acceleration before it.

    The derivative by the pose itself is the identity plus ``heading``.
    """

    heading: Array  # (N, 2) of x, y
    nu: Array  # (N, 3, base_columns)
    nu_dot: Array  # (N, 3, base_columns)
    steering: Array  # (N, 3, n_steered)


class Steering:
    """The twist of P as a linear function of the base's speed and the steering rates.

    Its maps are the base's rows of S at many steering angles δ at a time. Casters and followers do
    not determine them, so they glide here. With M(δ) y = R ν and T = X(δ) y + C ν from
    :func:`rpctl.dynamics.projection.eliminate`,

        ∂T/∂δ_i = (∂X/∂δ_i) y − X M⁻¹ (∂M/∂δ_i) y   at given ν.
    """

    def __init__(self, robot: Robot) -> None:
        drive = robot.drive
        gliding = [s.joint for s in drive.swivels if s.role in ("caster", "follower")]
        rolling = find_rolling(robot, gliding)
        core, _, _, R, C = eliminate(rolling.matrix, selection(robot, rolling))
        speeds = len(drive.base_speeds)
        self._R, self._C = R[:, :speeds], C[:BASE_NV, :speeds]
        self._point_velocity = robot.point_velocity
        leaders = [swivel.joint for swivel in drive.steered]
        spread, offset = np.zeros((len(drive.swivels), len(leaders))), np.zeros(len(drive.swivels))
        for i, swivel in enumerate(drive.swivels):
            if swivel.role == "steered":
                spread[i, leaders.index(swivel.joint)] = 1.0
            elif swivel.role == "mimic":
                spread[i, leaders.index(str(swivel.shares))] = swivel.ratio
                offset[i] = swivel.offset
        base = core.map(lambda part: part[..., : len(R) + BASE_NV, :])
        self._matrix = base.following(spread, offset)

    def maps(self, angles: Array) -> Array:
        """Return the maps (K, 3, 1 + n_steered) at steering angles (K, n_steered), rad.

        Raises:
            SingularBasisError: Some steering angles are singular.
        """
        inverse, X = self._solve(self._matrix.turn(angles))
        return np.asarray(self._point_velocity @ (X @ (inverse @ self._R) + self._C))

    def jacobian(self, angles: Array, speeds: Array) -> Array:
        """Return the derivatives (K, 3, n_steered) of the twists by the angles.

        Args:
            angles: Steering angles (K, n_steered), rad.
            speeds: The base's speed and the steering rates (K, 1 + n_steered).
        """
        u = self._matrix.turn(angles)
        inverse, X = self._solve(u)
        y = inverse @ (speeds @ self._R.T)[:, :, None]  # (K, n, 1)
        change = self._matrix.rate(u[:, None], np.eye(angles.shape[1])) @ y[:, None]
        change = np.swapaxes(change[..., 0], 1, 2)  # (K, n + 3, n_steered)
        count = len(self._R)
        jacobian = change[:, count:] - X @ (inverse @ change[:, :count])
        return np.asarray(self._point_velocity @ jacobian)

    def _solve(self, u: Array) -> tuple[Array, Array]:
        """Return M⁻¹ (K, n, n) and X (K, 3, n) at each set of angles."""
        found, count = self._matrix.at(u), len(self._R)
        M = found[:, :count]
        try:
            inverse = np.asarray(np.linalg.inv(M), dtype=float)
        except np.linalg.LinAlgError:
            inverse = np.full(M.shape, np.inf)
        size = np.abs(M).max(axis=(1, 2)) * np.abs(inverse).max(axis=(1, 2))
        if not (size * RANK_MARGIN < 1.0).all():
            raise SingularBasisError("the steered wheels fix no one motion ahead")
        return inverse, found[:, count:]


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
        steering: The steered joints' effect on the twist, None without them.
        twist_map: Map (3, dof) from ν to the twist; its columns of the arm alone with ``steering``.
        joint_columns: Map (nv, n_joints) from the joints' rates to v, mimic joints included.
        entries: The entry in q of each joint.
        casters: The powered casters, whose angles the base's motion fixes.
    """

    def __init__(self, dynamics: ReducedDynamics, steps: int, dt: float) -> None:
        self.dynamics, self.steps, self.dt = dynamics, steps, dt
        self.robot, steered = dynamics.robot, dynamics.robot.drive.steered
        joint, self.steered = self.robot.description.joint, len(steered)
        self.base = len(self.robot.drive.base_speeds) - self.steered
        self.joints = tuple(joint[swivel.joint] for swivel in steered) + self.robot.joints
        self.entries = tuple(self.robot.entries[each.name] for each in self.joints)
        self.steering = Steering(self.robot) if steered else None
        self.casters = Casters(self.robot)
        q = self.robot.configuration_at(np.zeros(BASE_NV), self.robot.home)
        self.twist_map = np.asarray(dynamics.twist(q, np.eye(self.robot.dof)))
        self.joint_columns = dynamics.basis(q)[:, self.base :].copy()
        self.joint_columns[:BASE_NV] = 0.0

    @property
    def base_columns(self) -> int:
        """Number of quasi-velocities that move the base, the steered joints' rates among them."""
        return self.base + self.steered

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
        if self.robot.mimics or self.robot.drive.followers:
            q = self._configuration_by_name(joints, pose)
        else:
            q = self._configuration_by_entry(joints, pose)
        if casters is not None:
            self.casters.write(q, casters)
        return q

    def _configuration_by_entry(self, joints: Array, pose: Array | None) -> Array:
        q: Array = pin.neutral(self.robot.model)
        for entry, position in zip(self.entries, joints.tolist(), strict=True):
            entry.write(q, position)
        if pose is not None:
            write_root(q, *self.robot.root_pose(pose))
        return q

    def _configuration_by_name(self, joints: Array, pose: Array | None) -> Array:
        if pose is not None:
            return self.robot.configuration_at(pose, joints[self.steered :], joints[: self.steered])
        names = (joint.name for joint in self.joints)
        return self.robot.configuration(joints=dict(zip(names, joints.tolist(), strict=True)))

    def predict(self, q: Array, nu: Array, nu_dot: Array) -> PredictedMotion:
        """Return the motion under accelerations that are constant in each step.

        ν and the joints are exact; the base moves with the twist at the middle of each step in the
        heading there, which is exact to second order.
        """
        dt, pose, joints = self.dt, self.robot.base_pose(q), self.joint_positions(q)
        speeds = np.vstack([nu, nu + dt * np.cumsum(nu_dot, axis=0)])
        mid_speeds = speeds[:-1] + 0.5 * dt * nu_dot
        joint_change = dt * np.cumsum(mid_speeds[:, self.base :], axis=0)
        arm = np.vstack([joints, joints + joint_change])
        twist_map = self._twist_maps(arm[:-1], speeds[:-1], nu_dot)
        twist = (twist_map @ mid_speeds[:, :, None])[:, :, 0]
        poses = np.empty((self.steps + 1, BASE_NV))
        poses[0] = pose
        poses[1:, 2] = pose[2] + dt * np.cumsum(twist[:, 2])
        middle = poses[:-1, 2] + 0.5 * dt * twist[:, 2]
        cos, sin = np.cos(middle), np.sin(middle)
        poses[1:, 0] = pose[0] + dt * np.cumsum(cos * twist[:, 0] - sin * twist[:, 1])
        poses[1:, 1] = pose[1] + dt * np.cumsum(sin * twist[:, 0] + cos * twist[:, 1])
        casters = self.casters.follow(self.casters.read(q), twist, dt)
        return PredictedMotion(q, poses, arm, speeds, nu_dot, twist, twist_map, casters)

    def _twist_maps(self, joints: Array, nu: Array, nu_dot: Array) -> Array:
        if self.steering is None:
            return self.twist_map[None]
        found = np.tile(self.twist_map, (self.steps, 1, 1))
        found[:, :, : self.base_columns] = self.steering.maps(self._angles(joints, nu, nu_dot))
        return found

    def _angles(self, joints: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the steering angles (N, n_steered) at the middle of each step."""
        joints, rates, accelerations = (
            part[:, first : first + self.steered]
            for part, first in ((joints, 0), (nu, self.base), (nu_dot, self.base))
        )
        return joints + 0.5 * self.dt * rates + 0.125 * self.dt**2 * accelerations

    def jacobian(self, motion: PredictedMotion) -> PoseJacobian:
        """Return the derivatives of the poses by the state and acceleration before each."""
        dt, n = self.dt, self.steps
        middle = motion.pose[:-1, 2] + 0.5 * dt * motion.twist[:, 2]
        cos, sin = np.cos(middle), np.sin(middle)
        rotation = np.zeros((n, 3, 3))
        rotation[:, 0, 0], rotation[:, 0, 1] = cos, -sin
        rotation[:, 1, 0], rotation[:, 1, 1] = sin, cos
        rotation[:, 2, 2] = 1.0
        twist_by_heading = np.empty((n, 2))  # d/dθ of R(θ) (vx, vy)
        twist_by_heading[:, 0] = -sin * motion.twist[:, 0] - cos * motion.twist[:, 1]
        twist_by_heading[:, 1] = cos * motion.twist[:, 0] - sin * motion.twist[:, 1]
        rotation[:, :2, 2] += 0.5 * dt * twist_by_heading
        by_nu = dt * rotation @ motion.twist_map[:, :, : self.base_columns]
        by_nu_dot = 0.5 * dt * by_nu
        by_steering = np.zeros((n, 3, self.steered))
        if self.steering is not None:
            angles = self._angles(motion.joints[:-1], motion.nu[:-1], motion.nu_dot)
            speeds = (motion.nu[:-1] + 0.5 * dt * motion.nu_dot)[:, : self.base_columns]
            by_steering = dt * rotation @ self.steering.jacobian(angles, speeds)
            by_nu[:, :, self.base :] += 0.5 * dt * by_steering
            by_nu_dot[:, :, self.base :] += 0.125 * dt**2 * by_steering
        return PoseJacobian(dt * twist_by_heading, by_nu, by_nu_dot, by_steering)
