"""The reduced dynamics M(q) ν̇ + h(q, ν) = B(q) τ of a robot whose wheels do not slip."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dposv

from rpctl.arrays import Array
from rpctl.dynamics.basis import Basis, basis, selection
from rpctl.dynamics.rolling import ROOT_JOINT, constraint, constraint_drift, find_rolling
from rpctl.errors import ActuationError, RpctlError, SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

RANK_MARGIN = 1e-9  # of the largest singular value of B: below it nothing drives that direction


class ReducedDynamics:
    """Pinocchio's dynamics projected onto the quasi-velocities.

    With v = S ν: M = SᵀM(q)S, h = Sᵀ rnea(q, Sν, Ṡν), B = Sᵀ times the actuators' columns. This
    is [MS21, Eq. 5] (its Re is −h) for any drive. The object owns a workspace: use one a thread.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._model = robot.model
        self._data = robot.model.createData()
        self._columns = np.zeros((robot.nv, len(robot.actuators)))
        for column, name in enumerate(robot.actuators):
            self._columns[robot.velocity_index(name), column] = 1.0
        self.rolling = find_rolling(robot)
        self._W = selection(robot, self.rolling)
        # Where no wheel swivels, A is the same in the base's axes at every q: so is S, and Ṡ = 0.
        self._S: Array | None = None
        if not robot.drive.swivels:
            S = basis(self.rolling.constant, self._W).S
            S[np.abs(S) < np.finfo(float).eps * np.abs(S).max()] = 0.0  # rounding of the solve
            S.setflags(write=False)
            self._S = S
        self._known: tuple[Array, Array, Basis] | None = None  # the last q, its A and its S
        self._constant_allocation: Array | None = None
        self._still = np.zeros(robot.nv)
        self._v = np.zeros(robot.nv)
        self._MS = np.zeros((robot.nv, robot.dof))
        self._M = np.zeros((robot.dof, robot.dof))

    def constraint(self, q: Array) -> Array:
        """Return A(q) (rows, nv)."""
        return self.rolling.constant if self.constant else self._at(q)[0]

    def basis(self, q: Array) -> Array:
        """Return S(q) (nv, dof): v = S ν, A S = 0.

        Raises:
            SingularBasisError: At q the steered wheels fix no one motion; their joints are named.
        """
        return self._at(q)[1].S if self._S is None else self._S

    def _at(self, q: Array) -> tuple[Array, Basis]:
        """Return A and S at q, for a robot whose wheels swivel."""
        if self._known is None or not np.array_equal(self._known[0], q):
            A = constraint(self.robot, self.rolling, q)
            try:
                found = basis(A, self._W)
            except SingularBasisError as error:
                raise SingularBasisError(f"{error}: {self._angles(q)}") from None
            A.setflags(write=False)
            found.S.setflags(write=False)
            self._known = q.copy(), A, found
        return self._known[1:]

    def _angles(self, q: Array) -> str:
        joints = [swivel.joint for swivel in self.robot.drive.swivels]
        angles = (math.degrees(self.robot.joint_position(q, name)) for name in joints)
        return ", ".join(f"{n} at {a:.3g}°" for n, a in zip(joints, angles, strict=True))

    def twist(self, q: Array, nu: Array) -> Array:
        """Return the base's twist (3,) at ν: P's speed forward and left (m/s), turning rate."""
        return self.robot.point_velocity @ (self.basis(q)[:BASE_NV] @ nu)

    def basis_drift(self, q: Array, nu: Array) -> Array:
        """Return Ṡν (nv,): the part of v̇ = S ν̇ + Ṡ ν that the motion itself brings."""
        if self._S is not None:
            return self._still
        S, D = self._at(q)[1]
        return -D @ constraint_drift(self.robot, self.rolling, q, S @ nu)

    def inertia(self, q: Array) -> Array:
        """Return M(q) (dof, dof), symmetric positive definite."""
        S = self.basis(q)
        M = S.T @ pin.crba(self._model, self._data, q) @ S
        return 0.5 * (M + M.T)

    def bias(self, q: Array, nu: Array) -> Array:
        """Return h(q, ν) (dof,): Coriolis, centrifugal and gravity terms."""
        return self.inverse(q, nu, np.zeros(self.robot.dof))

    def actuation(self, q: Array) -> Array:
        """Return B(q) (dof, n_act)."""
        return self.basis(q).T @ self._columns

    def inverse(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the quasi-force M ν̇ + h (dof,) that a motion takes.

        This is ∂G/∂ν̇ of the Gibbs function ([MS21, Eq. 1-3]).
        """
        S = self.basis(q)
        acceleration = S @ nu_dot + self.basis_drift(q, nu)
        return S.T @ pin.rnea(self._model, self._data, q, S @ nu, acceleration)

    def forward(self, q: Array, nu: Array, tau: Array) -> Array:
        """Return ν̇ (dof,) under actuator efforts τ (n_act,).

        Raises:
            RpctlError: M is not positive definite at q, or the state is not finite.
        """
        S = self.basis(q)
        np.dot(S, nu, out=self._v)
        force = pin.rnea(self._model, self._data, q, self._v, self.basis_drift(q, nu))
        mass = pin.crba(self._model, self._data, q)
        np.dot(mass, S, out=self._MS)
        np.dot(S.T, self._MS, out=self._M)
        right = S.T @ (self._columns @ tau - force)
        _, nu_dot, info = dposv(self._M, right)
        if info or not np.isfinite(nu_dot[0]):
            raise RpctlError(f"{self.robot.name}: the reduced inertia is not positive definite")
        return np.asarray(nu_dot)

    @property
    def constant(self) -> bool:
        """Whether A and S are the same at every q."""
        return self._S is not None

    def placements(self, q: Array) -> pin.Data:
        """Return the workspace with the joints' placements at q; the next call overwrites it."""
        pin.forwardKinematics(self._model, self._data, q)
        return self._data

    def reaction(self, q: Array, nu: Array, tau: Array) -> tuple[Array, Array]:
        """Return what the ground does to the robot while it moves under τ.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.

        Returns:
            The constraints' generalized force Aᵀλ = M v̇ + h − B τ of the whole tree (nv,), and
            the wrench through the planar root (6,): force (N), then moment (N·m) about the root
            link's origin, in the root link's axes. The wrench is the rate of the robot's momentum
            less gravity's share ([F08, Ch. 5]), so it has what the planar joint hides: the
            vertical force, the roll and the pitch moment.
        """
        S = self.basis(q)
        acceleration = S @ self.forward(q, nu, tau) + self.basis_drift(q, nu)
        force = pin.rnea(self._model, self._data, q, S @ nu, acceleration)
        return force - self._columns @ tau, self._data.f[ROOT_JOINT].vector.copy()

    def energy(self, q: Array, nu: Array) -> float:
        """Return kinetic plus potential energy, J; the latter is 0 at the root link's height."""
        kinetic = pin.computeKineticEnergy(self._model, self._data, q, self.basis(q) @ nu)
        return float(kinetic + pin.computePotentialEnergy(self._model, self._data, q))

    def efforts(self, q: Array, quasi_force: Array) -> Array:
        """Return τ (n_act,) with B τ = ``quasi_force``.

        Where actuators outnumber quasi-velocities, it is the τ of least effort relative to the
        actuators' limits (limits that the URDF leaves out count as 1).

        Raises:
            ActuationError: B lacks full row rank; the undriven quasi-velocities are named.
        """
        if self._S is None:
            return self._allocation(q) @ quasi_force
        if self._constant_allocation is None:
            self._constant_allocation = self._allocation(q)
        return self._constant_allocation @ quasi_force

    def _allocation(self, q: Array) -> Array:
        """Return the right inverse of B (n_act, dof), weighted by the effort limits."""
        B = self.actuation(q)
        limits = self.robot.effort_limits
        scale = np.where(np.isfinite(limits), limits, 1.0)
        U, singular, Vt = np.linalg.svd(B * scale, full_matrices=False)
        driven = singular > RANK_MARGIN * singular[0]
        if np.count_nonzero(driven) < len(B):
            free = np.abs(np.eye(len(B)) - U[:, driven] @ U[:, driven].T).max(axis=1)
            names = [n for n, f in zip(self.robot.quasi_velocities, free, strict=True) if f > 1e-6]
            raise ActuationError(f"no actuator drives {', '.join(names)} of {self.robot.name}")
        return np.asarray(scale[:, None] * (Vt.T / singular) @ U.T)
