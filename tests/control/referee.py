"""The law within limits once more, in NumPy: Pinocchio's dynamics, and DAQP for its program."""

from __future__ import annotations

from typing import Any, NamedTuple

import daqp
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import null_space

from rpctl import BoundedDynamic, IntegralDynamic, ReducedDynamics
from rpctl.arrays import Array
from rpctl.control.joint_limits import (
    BRAKE_FRACTION,
    MAX_BRAKE,
    MIN_BRAKE,
    NO_LIMIT_GAP,
    ROUNDING,
    JointLimits,
)
from rpctl.control.law import Command, Efforts, Limit, Rest
from rpctl.control.within_limits import (
    NULLSPACE_EFFORT_WEIGHT,
    REST_SPEED_FRACTION,
    BoundedLaw,
)
from rpctl.kernels.least_squares import COMPLIANCE, PRIMAL_TOLERANCE


class Solution(NamedTuple):
    """A minimiser, and how hard each row pulls it: negative multipliers belong to lower bounds."""

    x: Array  # (n,)
    hard: Array  # (hard rows,)
    soft: Array  # (soft rows,)


def shortest(
    hard: Array, hard_bounds: tuple[Array, Array], soft: Array, soft_bounds: tuple[Array, Array]
) -> Solution:
    """Return the x of least ½|x|² + ½|s|²/COMPLIANCE with s by how much soft bounds are broken.

    Args:
        hard: Rows (m, n) whose values must stay within ``hard_bounds``.
        hard_bounds: Lower and upper bounds (m,); infinite ones bind nothing.
        soft: Rows (k, n) whose values should stay within ``soft_bounds``.
        soft_bounds: Lower and upper bounds (k,).
    """
    n, m, k = hard.shape[1], len(hard), len(soft)
    rows = np.zeros((m + k, n + k))
    rows[:m, :n], rows[m:, :n] = hard, soft
    rows[m:, n:] = np.sqrt(COMPLIANCE) * np.eye(k)
    lower, upper = (np.concatenate(pair) for pair in zip(hard_bounds, soft_bounds, strict=True))
    blocks = np.eye(n + k), np.zeros(n + k), rows, upper, lower, np.zeros(m + k, dtype=np.int32)
    x, _, flag, info = daqp.solve(*blocks, primal_tol=PRIMAL_TOLERANCE)
    assert flag == 1
    return Solution(np.asarray(x)[:n], info["lam"][:m], info["lam"][m:])


class Bounds(NamedTuple):
    """Bounds on the joints' accelerations, and whether a position is why (or else a rate)."""

    lower: Array  # (k,)
    upper: Array  # (k,)
    by_lower: NDArray[np.bool_]  # (k,)
    by_upper: NDArray[np.bool_]  # (k,)


def joint_bounds(
    limits: JointLimits, q: Array, rate: Array, brakes: tuple[Array, Array], horizon: float
) -> Bounds:
    """Return the bounds on ẍ, as :class:`JointLimits` says."""

    def stop(gap: Array, brake: Array) -> Array:
        gap = np.minimum(gap, NO_LIMIT_GAP)
        straight = brake * horizon**2
        root = np.sqrt(2.0 * brake * np.maximum(gap - 0.5 * straight, 0.5 * straight))
        return np.where(gap < straight, gap / horizon, root)

    down, up = (np.clip(BRAKE_FRACTION * a, MIN_BRAKE, MAX_BRAKE) for a in brakes)
    times = np.array(limits.times)[:, None]
    ahead = q[limits.entries] + times * rate
    rising, falling = stop(limits.upper - ahead, down), stop(ahead - limits.lower, up)
    highest = np.minimum(rising, limits.fastest)
    lowest = np.minimum(np.maximum(-falling, -limits.fastest), highest)
    lower, upper = ((lowest - rate) / times).max(axis=0), ((highest - rate) / times).min(axis=0)
    lower = np.where(upper < 0.0, np.minimum(lower, upper), lower)
    upper = np.maximum(lower, upper)
    return Bounds(
        np.minimum(lower, brakes[1]),
        np.maximum(upper, -brakes[0]),
        np.asarray((falling < limits.fastest).any(axis=0)),
        np.asarray((rising < limits.fastest).any(axis=0)),
    )


class Referee:
    """:class:`BoundedDynamic`, or that with integral action, on one robot."""

    def __init__(self, law: Any, dynamics: ReducedDynamics, period: float, rest: Rest) -> None:
        self.dynamics, self.robot, self._elapsed = dynamics, dynamics.robot, period
        self._gain: Array | None = None
        self._d, self._before = np.zeros(self.robot.dof), tuple[Array, ...]()
        if isinstance(law, IntegralDynamic):
            self._gain = law.gains(dynamics, period)
            self._d = -dynamics.forward(rest.q, self._d, rest.tau)
            law = law.inner
        self._law: BoundedDynamic = law
        self._within = BoundedLaw(law, dynamics, period)
        self._h1 = self._within.numbers()["horizon_dyn"]
        self.box = self.robot.effort_limits
        home = self.robot.configuration_at(np.zeros(3), self.robot.home)
        M, B = dynamics.inertia(home), np.abs(dynamics.actuation(home))
        most = [sum(b * box for b, box in zip(row, self.box, strict=True) if b) for row in B]
        self._reach = np.array(most) / np.diag(M)  # what all motors can give, each ν̇ by itself
        self._unit = np.where(np.isfinite(self.box), self.box, 1.0)

    def sampled_after(self, elapsed: float) -> None:
        self._elapsed = elapsed

    def __call__(self, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,) and the limits that bind."""
        if self._gain is not None and self._before:
            gain = np.minimum(self._gain, 1.0 / self._elapsed)
            self._d = self._d + gain * (nu - self._before[0] - self._elapsed * self._before[1])
        self._d = np.clip(self._d, -self._reach, self._reach)
        nu_dot = command.nu_d_dot - (nu - command.nu_d) / self._within.times
        efforts = self._bounded(q, nu, command, nu_dot)
        if efforts.limits:
            nu_dot = self.dynamics.forward(*self._middle(q, nu, command)[:2], efforts.tau) + self._d
        self._before = nu, nu_dot
        return efforts

    def _middle(self, q: Array, nu: Array, command: Command) -> tuple[Array, Array, Array]:
        half = 0.5 * self._within.held_for
        ahead = pin.integrate(self.robot.model, q, half * (self.dynamics.basis(q) @ nu))
        return ahead, nu + half * command.nu_d_dot, command.nu_d + half * command.nu_d_dot

    def _bounded(self, q: Array, nu: Array, command: Command, nu_dot: Array) -> Efforts:
        dynamics, joints, (at, moving, wanted) = (
            self.dynamics,
            self._within.joints,
            self._middle(q, nu, command),
        )
        rows, drift = dynamics.basis(q)[joints.indices], dynamics.basis_drift(q, nu)[joints.indices]
        force = dynamics.inverse(at, moving, nu_dot - self._d, lossy_nu=wanted)
        tau = dynamics.efforts(at, force)
        gain = dynamics.efforts(at, dynamics.inertia(at))
        cost = gain @ (rows.T / np.maximum(np.square(rows).sum(axis=1), ROUNDING))
        size = np.maximum(np.abs(cost), ROUNDING)
        pull = np.sign(np.where(size > ROUNDING, cost, 0.0)) * (tau - gain @ nu_dot)[:, None]
        box = self.box[:, None]
        brakes = ((box + pull) / size).min(axis=0), ((box - pull) / size).min(axis=0)
        bounds = joint_bounds(joints, q, rows @ nu, brakes, self._h1)
        now = rows @ nu_dot + drift
        if (
            (np.abs(tau) <= self.box).all()
            and (bounds.lower <= now).all()
            and (now <= bounds.upper).all()
        ):
            return Efforts(tau)
        h1, unit = self._h1, self._unit
        B = dynamics.actuation(at)
        change = self._cost_factor(B, dynamics.inertia(at), command)
        still = B[:, :0]
        if B.shape[0] < B.shape[1]:
            still = null_space(B * unit) / np.sqrt(NULLSPACE_EFFORT_WEIGHT)
        efforts = np.hstack([gain @ change / unit[:, None], still])
        shared = np.array([name not in self.robot.joint_names for name in joints.names], dtype=bool)
        soft = (h1 * rows @ change / joints.full[:, None])[shared]
        shift = np.zeros(self.robot.dof)
        for k, name in enumerate(joints.names):
            if name in self.robot.joint_names:
                wanted_there = np.clip(now[k], bounds.lower[k], bounds.upper[k])
                shift[self.robot.quasi_velocities.index(name)] = wanted_there - now[k]
        beyond = rows @ shift
        now, tau = now + beyond, tau + gain @ shift
        count = len(self.robot.drive.base_speeds)
        rows_of_efforts = efforts.copy()
        for k, name in enumerate(self.robot.actuators):
            if name not in self.robot.joint_names:  # a wheel's limit asks nothing of the arm
                rows_of_efforts[k, count : self.robot.dof] = 0.0
        found = shortest(
            rows_of_efforts,
            ((-self.box - tau) / unit, (self.box - tau) / unit),
            np.hstack([soft, np.zeros((len(soft), still.shape[1]))]),
            (
                (h1 * (bounds.lower - now) / joints.full)[shared],
                (h1 * (bounds.upper - now) / joints.full)[shared],
            ),
        )
        bound = np.clip(tau + unit * (efforts @ found.x), -self.box, self.box)
        at_limit = np.abs(bound) > (1.0 - 1e-6) * self.box
        limits = [Limit(self.robot.actuators[i], "effort") for i in np.flatnonzero(at_limit)]
        pulls = -beyond
        pulls[shared] = found.soft
        for i in np.flatnonzero(pulls):
            upper = pulls[i] > 0.0
            by_position = (bounds.by_upper if upper else bounds.by_lower)[i]
            kind = ("upper" if upper else "lower") if by_position else "velocity"
            limits.append(Limit(joints.names[i], kind))
        return Efforts(bound, tuple(limits))

    def _cost_factor(self, B: Array, M: Array, command: Command) -> Array:
        """Return T (dof, dof) with δν̇ = T y and J = ½ |y|²."""
        fastest = self.robot.velocity_limits
        fastest = np.where(np.isfinite(fastest), fastest, 1.0)
        full = 1.0 / np.abs(B / fastest).max(axis=1)
        root = self._within.numbers()["root_weight"]
        T = np.diag(full / root / self._within.times)
        count = len(self.robot.drive.base_speeds)
        base, arm = slice(count), slice(count, None)
        ahead = (command.nu_d + self._h1 * command.nu_d_dot)[base] / full[base]
        d = ahead / np.hypot(np.linalg.norm(ahead), REST_SPEED_FRACTION)
        c = 1.0 - np.sqrt(self._law.along)
        T[base, base] @= np.eye(len(d)) + c / (1.0 - c * (d @ d)) * np.outer(d, d)
        if count < self.robot.dof:
            usual = np.mean(np.diag(M)[arm] * np.square(full / self._within.times)[arm])
            metric = np.outer(root[arm], root[arm]) * M[arm, arm] / usual
            T[arm, arm] = np.linalg.cholesky(np.linalg.inv(metric))
        return T
