"""The projection onto the quasi-velocities: S, Ṡν, A and B at one configuration.

Basis and drift solve the same equations, [A; W] S = [0; I] and [A; W] Ṡν = −[Ȧv; 0]. Where wheels
swivel, most unknowns have constant columns in them: rates of wheels, trailing casters and the arm.
They are eliminated once, see :func:`eliminate`. The few equations that are left, for the base's
twist and the rates of swivels that follow others, are solved at each q.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.linalg.lapack import dgecon, dgesv, dgetrs

from rpctl.arrays import Array
from rpctl.drive.rows import TurningMatrix
from rpctl.dynamics.rolling import (
    RANK_MARGIN,
    UNDETERMINED,
    RollingConstraints,
    basis,
    selection,
    square_inverse,
)
from rpctl.errors import ActuationError, SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

ROW_MARGIN = 1e-9  # of the largest singular value of B: below it nothing drives that direction


class Elimination(NamedTuple):
    """Equations [A; W] x = [a; ν], solved for the unknowns whose columns are constant.

    With y the other unknowns, M y = N a + R ν and x = X y + P a + C ν.
    """

    core: TurningMatrix  # M (n, n), below it X (nv, n)
    N: Array  # (n, rows)
    P: Array  # (nv, rows)
    R: Array  # (n, dof)
    C: Array  # (nv, dof)


def eliminate(A: TurningMatrix, W: Array, solved: NDArray[np.intp] | None = None) -> Elimination:
    """Return the equations that are left once the unknowns with constant columns are eliminated.

    As many rows E of L = [A; W] as there are such unknowns J give them, x_J = L_EJ⁻¹ (b_E − L_E y).
    So the other rows K leave M = L_K − L_KJ L_EJ⁻¹ L_E of the columns that turn.

    Args:
        A: Constraint matrix (rows, nv).
        W: Selection of the quasi-velocities (dof, nv), rows + dof = nv.
        solved: The rows E, as :func:`rows_to_solve` finds them for this matrix or one like it;
            None: as it finds them.

    Raises:
        SingularBasisError: No rows determine those unknowns.
    """
    rows, nv = A.constant.shape
    kept, gone = np.flatnonzero(A.turning), np.flatnonzero(np.logical_not(A.turning))
    constant = np.vstack([A.constant, W])[:, gone]
    E = rows_to_solve(A, W) if solved is None else solved
    K = np.setdiff1d(np.arange(nv), E)
    P = np.zeros((nv, nv))
    P[np.ix_(gone, E)] = square_inverse(constant[E])
    N = np.eye(nv)[K] - constant[K] @ P[gone]
    both = np.vstack([N, -P])
    core = A.map(lambda part: both[:, :rows] @ part[..., kept])
    rest = both[:, rows:] @ W[:, kept] + np.eye(len(both))[:, len(N) + kept]
    maps = (
        np.ascontiguousarray(part) for part in (N[:, :rows], P[:, :rows], N[:, rows:], P[:, rows:])
    )
    return Elimination(replace(core, constant=core.constant + rest), *maps)


def rows_to_solve(A: TurningMatrix, W: Array) -> NDArray[np.intp]:
    """Return the rows of [A; W] that determine the unknowns with constant columns best."""
    constant = np.vstack([A.constant, W])[:, np.logical_not(A.turning)]
    order = qr(constant.T, mode="r", pivoting=True)[1]
    return np.sort(order[: constant.shape[1]])


@dataclass(frozen=True, eq=False)
class Projection(ABC):
    """What rolling makes of velocities and efforts at one configuration q.

    Attributes:
        S: Basis (nv, dof): v = S ν.
        projector: The robot's, which made it.
    """

    S: Array
    projector: Any = field(repr=False)

    @property
    @abstractmethod
    def A(self) -> Array:
        """Constraint matrix (rows, nv): A v = 0."""

    @property
    @abstractmethod
    def W(self) -> Array:
        """Selection of the quasi-velocities (dof, nv): ν = W v."""

    @abstractmethod
    def drift(self, nu: Array) -> Array:
        """Return Ṡν (nv,): the part of v̇ = S ν̇ + Ṡν that the motion itself brings."""

    @property
    @abstractmethod
    def twist(self) -> Array:
        """Map (3, dof) from ν to P's speed ahead and to the left (m/s), and the turning rate."""

    @cached_property
    def B(self) -> Array:
        """Actuation map (dof, n_act), from efforts to quasi-forces."""
        return np.asarray(self.S.T.dot(self.projector.columns))

    @cached_property
    def allocation(self) -> Array:
        """Right inverse of B (n_act, dof) of least efforts relative to their limits.

        Raises:
            ActuationError: B lacks full row rank; the undriven quasi-velocities are named.
        """
        return _allocation(self.projector.robot, self.B)

    @cached_property
    def multipliers(self) -> Array:
        """Map (rows, nv) from Aᵀλ to the λ of least norm; no λ is of a wheel that glides."""
        found = np.asarray(np.linalg.pinv(self.A.T, rcond=RANK_MARGIN), dtype=float)
        found[list(self.projector.gliding)] = 0.0
        return found


@dataclass(frozen=True, eq=False)
class LevelProjection(Projection):
    """The projection of a robot whose root link stays level."""

    _u: Array = field(repr=False)
    _core: tuple[Array, Array, Array] | None = field(repr=False)  # M's LU factors, pivots, X

    @cached_property
    def A(self) -> Array:
        """Constraint matrix (rows, nv): A v = 0."""
        A = self.projector.rolling.matrix.at(self._u)
        A.setflags(write=False)
        return np.asarray(A)

    @property
    def W(self) -> Array:
        """Selection of the quasi-velocities (dof, nv): ν = W v."""
        return np.asarray(self.projector.selection)

    @cached_property
    def twist(self) -> Array:
        """Map (3, dof) from ν to P's speed ahead and to the left (m/s), and the turning rate."""
        return np.asarray(self.projector.robot.point_velocity @ self.S[:BASE_NV])

    def drift(self, nu: Array) -> Array:
        """Return Ṡν (nv,): the part of v̇ = S ν̇ + Ṡν that the motion itself brings."""
        if self._core is None:
            still: Array = self.projector.still
            return still
        return self._solve(self._core, -self.projector.rolling.drift(self._u, self.S.dot(nu)))

    def _solve(self, core: tuple[Array, Array, Array], right: Array) -> Array:
        """Return x (nv, ...) with A x = right (rows, ...) and W x = 0."""
        lu, pivots, X = core
        _, N, P, _, _ = self.projector.equations
        # SciPy counts the pivots up and down again in place, while other threads run: a copy.
        y, _ = dgetrs(lu, pivots.copy(), N.dot(right))
        found: Array = X.dot(y) + P.dot(right)
        return found


class Projector:
    """Makes the projections of one robot; keeps the last.

    Args:
        robot: The robot.
        rolling: Its rolling constraints.
    """

    def __init__(self, robot: Robot, rolling: RollingConstraints) -> None:
        self.robot, self.rolling, self.gliding = robot, rolling, rolling.gliding
        self.rows = len(rolling.matrix.constant)
        self.columns = effort_columns(robot)
        self.still = np.zeros(robot.nv)
        self.still.setflags(write=False)
        self.selection = selection(robot, rolling)  # W
        self._last: tuple[bytes, LevelProjection] | None = None
        # Where nothing turns, A is the same in the base's axes at every q: so is S, and Ṡ = 0.
        self.constant: LevelProjection | None = None
        if not rolling.matrix.harmonics.any():
            S = basis(rolling.matrix.constant, self.selection)
            S[np.abs(S) < np.finfo(float).eps * np.abs(S).max()] = 0.0  # rounding of the solve
            S.setflags(write=False)
            self.constant = LevelProjection(S, self, np.zeros(len(rolling.matrix.harmonics)), None)

    @staticmethod
    def dexpinv(slide: Array, v: Array) -> Array:
        """Return dexp⁻¹ of the root; see :func:`dexpinv`."""
        return np.asarray(dexpinv(slide, v))

    def settle(self, q: Array) -> Array:
        """Return q (nq,) as it is: a planar root keeps its wheels on the ground."""
        return q

    def at(self, q: Array) -> LevelProjection:
        """Return the projection at q (nq,).

        Raises:
            SingularBasisError: At q the steered wheels fix no one motion; their joints are named.
        """
        if self.constant is not None:
            return self.constant
        key = q.tobytes()
        last = self._last  # read once: another thread may write it meanwhile
        if last is None or last[0] != key:
            last = self._last = key, self._project(q)
        return last[1]

    def _project(self, q: Array) -> LevelProjection:
        try:
            core, _, _, R, C = self.equations
            u = self.rolling.turn(q)
            found = core.at(u)
            M, X = found[: len(R)], found[len(R) :]
            lu, pivots, Y, _ = dgesv(M, R)
            if not dgecon(lu, self._size)[0] > RANK_MARGIN:
                raise SingularBasisError(UNDETERMINED)
        except SingularBasisError as error:
            raise SingularBasisError(f"{error}: {self._angles(q)}") from None
        S = X.dot(Y)
        S += C
        S.setflags(write=False)
        return LevelProjection(S, self, u, (lu, pivots, X))

    @cached_property
    def equations(self) -> Elimination:
        """Those of S and of the drift, for a robot whose wheels swivel."""
        return eliminate(self.rolling.matrix, self.selection)

    @cached_property
    def _size(self) -> float:
        """A bound of |M|, the largest sum of a column, at any q."""
        return float(self.equations.core.bound[: len(self.equations.R)].sum(axis=0).max())

    def _angles(self, q: Array) -> str:
        joints = [swivel.joint for swivel in self.robot.drive.swivels]
        angles = (math.degrees(self.robot.joint_position(q, name)) for name in joints)
        return ", ".join(f"{n} at {a:.3g}°" for n, a in zip(joints, angles, strict=True))


def effort_columns(robot: Robot) -> Array:
    """Return the map (nv, n_act) from the actuators' efforts to their generalised force."""
    columns = np.zeros((robot.nv, len(robot.actuators)))
    for column, name in enumerate(robot.actuators):
        columns[robot.velocity_index(name), column] = 1.0
    return columns


def _allocation(robot: Robot, B: Array) -> Array:
    limits = robot.effort_limits
    scale = np.where(np.isfinite(limits), limits, 1.0)
    U, singular, Vt = np.linalg.svd(B * scale, full_matrices=False)
    driven = singular > ROW_MARGIN * singular.max(initial=0.0)
    if np.count_nonzero(driven) < len(B):
        free = np.abs(np.eye(len(B)) - U[:, driven] @ U[:, driven].T).max(axis=1)
        names = [n for n, f in zip(robot.quasi_velocities, free, strict=True) if f > 1e-6]
        undriven = f"no actuator drives {', '.join(names)} of {robot.name}"
        raise ActuationError(f"{undriven}; {_way_out(robot, names)}")
    return np.asarray(scale[:, None] * (Vt.T / singular) @ U.T)


def _way_out(robot: Robot, names: list[str]) -> str:
    """Return what to write so that actuators drive these quasi-velocities, or hold their joints."""
    drive, joint = robot.drive, robot.description.joint
    arm = [name for name in names if name in robot.joint_names]
    idle = [f'"{name}" (line {joint[name].line})' for name in arm]
    fixes = [f"freeze it with {' '.join(f'--lock {name}' for name in arm)}"] if arm else []
    if len(arm) < len(names):
        casters = {swivel.joint for swivel in drive.swivels if swivel.trails}
        base = [w.joint for w in drive.wheels if not (w.driven or w.slides or w.swivel in casters)]
        base += [s.joint for s in drive.steered if not s.driven]
        idle += [f'"{name}" (line {joint[name].line})' for name in base]
        fixes.append("set driven = true of the wheels or swivels in a drive file")
    return f"{', '.join(fixes)}, or give an effort limit above 0 to {', '.join(idle)}"


def dexpinv(slide: Any, v: Any) -> Any:
    """Return dexp⁻¹ of the planar root to second order: v + ½[u, v] + ¹⁄₁₂[u, [u, v]].

    Only the root's three velocities (body frame) fail to commute. Both may be symbols.
    """
    x, y, turn = slide[0], slide[1], slide[2]
    bx, by = turn * -v[1] + v[2] * y, turn * v[0] - v[2] * x
    corrected = 1.0 * v
    corrected[0] += 0.5 * bx - turn * by / 12.0
    corrected[1] += 0.5 * by + turn * bx / 12.0
    return corrected
