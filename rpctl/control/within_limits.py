"""Formulas of the predictive law within limits, [MS21, Eq. 25] as a quadratic program.

M and h are those of the middle of the period. Where a limit may bind they are worked out once, for
how the efforts grow with ν̇, and for what the robot does where these are not what is asked for.
The program is solved by :mod:`rpctl.kernels.least_squares`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.bandwidth import by_velocity, usual_gains
from rpctl.control.dynamic import desired_acceleration, midpoint, paper_efforts
from rpctl.control.joint_limits import JointBounds, JointLimits, largest_accelerations
from rpctl.control.law import LawSample
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import require_known
from rpctl.kernels.least_squares import COMPLIANCE, BoundedRows
from rpctl.kernels.scalars import any_true, clipped, factored
from rpctl.robot.model import BASE_NV

NULLSPACE_EFFORT_WEIGHT = 1e-6  # weight of efforts that move nothing, relative to their limits
REST_SPEED_FRACTION = 1e-3  # of the full speed; a slower base has no direction to keep
NO_EFFORT = 1e-9  # of an effort: what of a null space's entries is rounding
# Default weight of a joint's error relative to the base's 1: the base gives way to no joint.
JOINT_ERROR_WEIGHT = 1e-6


class FreeSample(NamedTuple):
    """What the law makes of a sample if no limit binds."""

    tau: Any  # (n_act, 1) of ν̇*
    doubtful: Any  # whether a limit may bind (1, 1)


class BoundSample(NamedTuple):
    """What the law needs to know of a sample where a limit may bind, in the period's middle."""

    M: Any  # (dof, dof)
    push: Any  # ℓ − h (dof, 1): M ν̇ = B τ + push
    acceleration: Any  # ẍ of the limited joints under ν̇* (k, 1)
    bounds: JointBounds  # on ẍ
    binds: Any  # whether a limit binds (1, 1)


class BoundedLaw:
    """The law within limits on one robot at one control period: its formulas over scalars.

    What they take by name, ``s``, are the law's :meth:`numbers`.

    Args:
        law: Its settings, a :class:`rpctl.control.bounded.BoundedDynamic`.
        period: Control period, s.

    Raises:
        UnknownNameError: A weight is of no quasi-velocity of the robot.
    """

    def __init__(self, law: Any, dynamics: ReducedDynamics, period: float) -> None:
        self.robot = robot = dynamics.robot
        require_known("quasi-velocity", law.weights, robot.quasi_velocities)
        self._law = law
        usual = usual_gains(period).horizon_dyn
        self._h1 = law.horizon_dyn or usual
        self.times = by_velocity(dynamics, self._h1, law.joint_horizon_dyn or usual)
        self.held_for = period if law.midpoint else 0.0
        self.joints = JointLimits(robot, period)
        # Largest ν̇ (dof,) that the efforts can give at home, each for itself: the integral is not
        # to hold against more.
        home = robot.configuration_at(np.zeros(BASE_NV), robot.home)
        B = np.abs(dynamics.actuation(home))
        strength = np.multiply(B, robot.effort_limits, where=B > 0.0, out=np.zeros_like(B))
        self.reach = strength.sum(axis=1) / np.diag(dynamics.inertia(home))
        self.effort_limits = robot.effort_limits
        self._limited = np.flatnonzero(np.isfinite(self.effort_limits)).tolist()
        self._drive = {k for k, name in enumerate(robot.actuators) if name not in robot.joint_names}
        # Limited joints of the arm, whose own quasi-velocities their bounds are on; and the others.
        index = robot.quasi_velocities.index
        arm = set(robot.joint_names)
        self.own = {j: index(name) for j, name in enumerate(self.joints.names) if name in arm}
        self.shared = [j for j in range(len(self.joints.names)) if j not in self.own]
        self._unit = np.where(np.isfinite(self.effort_limits), self.effort_limits, 1.0)
        fastest = robot.velocity_limits
        self._fastest = np.where(np.isfinite(fastest), fastest, 1.0)

    def numbers(self) -> dict[str, Any]:
        """Return the numbers among the settings by name; arrays (dof,) are by quasi-velocity."""
        law, robot = self._law, self.robot
        default = dict.fromkeys(robot.drive.base_speeds, 1.0)
        weights = [
            law.weights.get(name, default.get(name, JOINT_ERROR_WEIGHT))
            for name in robot.quasi_velocities
        ]
        return {
            "horizon_dyn": self._h1,
            "along": law.along,
            "time": self.times,
            "root_weight": np.sqrt(weights),
        }

    def free(
        self, dynamics: SymbolicDynamics, sample: LawSample, s: Mapping[str, Any], disturbance: Any
    ) -> FreeSample:
        """Return what every sample needs.

        Args:
            s: The law's numbers.
            disturbance: Acceleration ν̇ (dof, 1) in addition to that of ``dynamics``.
        """
        nu_dot = desired_acceleration(sample, s["time"])
        rows, drift = self.joints.rows(dynamics, sample.q, sample.nu)
        tau = paper_efforts(dynamics, sample, s["time"], self.held_for, disturbance)
        rate, acceleration = rows @ sample.nu, rows @ nu_dot + drift
        doubtful = self.joints.doubtful(sample.q, rate, acceleration, s["horizon_dyn"])
        return FreeSample(tau, math.logic_or(doubtful, self._beyond(tau)))

    def bound(
        self, dynamics: SymbolicDynamics, sample: LawSample, s: Mapping[str, Any], tau: Any
    ) -> BoundSample:
        """Return what limits need.

        Args:
            s: The law's numbers.
            tau: Efforts of ν̇* (n_act, 1).
        """
        nu_dot = desired_acceleration(sample, s["time"])
        at = midpoint(dynamics, sample, self.held_for)
        rows, drift = self.joints.rows(dynamics, sample.q, sample.nu)
        M, minus_h = dynamics.lossless(at.q, at.nu, math.SX.zeros(len(self.robot.actuators), 1))
        gain = dynamics.at(at.q).allocation @ M
        brakes = largest_accelerations(self.effort_limits, tau - gain @ nu_dot, gain, rows)
        bounds = self.joints.bounds(sample.q, rows @ sample.nu, brakes, s["horizon_dyn"])
        acceleration = rows @ nu_dot + drift
        broken = [acceleration < bounds.lower, acceleration > bounds.upper]
        binds = math.logic_or(any_true(math.vertcat(*broken)), self._beyond(tau))
        return BoundSample(M, minus_h + dynamics.losses(at.q, at.nu), acceleration, bounds, binds)

    def _beyond(self, tau: Any) -> Any:
        """Return whether efforts (n_act, 1) are beyond their limits."""
        over = [math.fabs(tau[k]) > self.effort_limits[k] for k in self._limited]
        return any_true(math.vertcat(*over, math.SX(0, 1)))

    def rows(
        self,
        dynamics: SymbolicDynamics,
        sample: LawSample,
        s: Mapping[str, Any],
        tau: Any,
        parts: Mapping[str, Any],
    ) -> dict[str, Any]:
        """Return the quadratic program of a sample, by the names of :class:`BoundedRows`.

        The unknowns are y with δν̇ = T y, and efforts that move nothing. The violation of a wheel's
        bound is the base's h1 times an acceleration, divided by the wheel's full speed. The rows of
        the drive's efforts are those of an arm that follows. Beside what the rows are, the change
        of all efforts over their limits comes with it: ``known`` + ``E`` x, with ``known`` what
        the bounds of the arm's joints ask for.

        Args:
            s: The law's numbers.
            tau: Efforts of ν̇* (n_act, 1).
            parts: Entries of :class:`BoundSample` and of its bounds by name.
        """
        M, now, lower, upper = (parts[name] for name in ("M", "acceleration", "lower", "upper"))
        q, M = midpoint(dynamics, sample, self.held_for).q, math.tril2symm(M)
        change = self._cost_factor(dynamics, q, sample, s, M)
        h1, null = s["horizon_dyn"], self._null_space(dynamics, q)
        full = math.DM(self.joints.full[self.shared])
        gain = _scaled(1.0 / self._unit, dynamics.at(q).allocation @ M)
        E = math.sparsify(math.horzcat(gain @ change, null))
        rigid = math.sparsify(math.horzcat(gain @ self._of_base(change), null))
        hard = [rigid[k, :] if k in self._drive else E[k, :] for k in self._limited]
        rows = dynamics.at(sample.q).S[self.joints.indices, :][self.shared, :]
        K = math.diag(1.0 / full) @ (h1 * (rows @ change))
        K = math.horzcat(K, math.SX(K.shape[0], null.shape[1]))
        G = math.sparsify(math.vertcat(K, *hard))
        shift = self._shift(parts)
        now, lower, upper = (
            math.vertcat(*(each[j] for j in self.shared), math.SX(0, 1))
            for each in (now, lower, upper)
        )
        known, now = gain @ shift, now + rows @ shift
        ratios = [tau[k] / self.effort_limits[k] + known[k] for k in self._limited]
        H = math.tril(G @ G.T + math.diag(math.DM(np.square(self.slacks))))
        return {
            "G": G,
            "H": math.sparsify(H),
            "lower": math.vertcat(h1 * (lower - now) / full, *(-1.0 - each for each in ratios)),
            "upper": math.vertcat(h1 * (upper - now) / full, *(1.0 - each for each in ratios)),
            "E": E,
            "known": known,
        }

    @property
    def slacks(self) -> tuple[float, ...]:
        """√COMPLIANCE of the rows of joints, which are soft, and 0 of those of efforts."""
        return (COMPLIANCE**0.5,) * len(self.shared) + (0.0,) * len(self._limited)

    def program(self, parts: Mapping[str, Any]) -> BoundedRows:
        """Return the quadratic program of what :meth:`rows` returned."""
        G, H, lower, upper = (parts[name] for name in ("G", "H", "lower", "upper"))
        return BoundedRows(G, H, lower, upper, self.slacks)

    def efforts(self, tau: Any, change: Any) -> Any:
        """Return the efforts (n_act, 1) within their limits.

        Args:
            tau: Efforts of ν̇* (n_act, 1).
            change: What limits add to them, over their limits (n_act, 1).
        """
        box = zip(self._unit.tolist(), self.effort_limits.tolist(), strict=True)
        found = [
            clipped(tau[k] + unit * change[k], -most, most) for k, (unit, most) in enumerate(box)
        ]
        return math.vertcat(*found)

    def _cost_factor(
        self, dynamics: SymbolicDynamics, q: Any, sample: LawSample, s: Mapping[str, Any], M: Any
    ) -> Any:
        """Return T (dof, dof) with δν̇ = T y and J = ½ |y|².

        Args:
            q: Configuration in the middle of the period (nq, 1).
            s: The law's numbers.
            M: Inertia there (dof, dof).
        """
        B, count = dynamics.at(q).B, len(self.robot.drive.base_speeds)
        full = math.vertcat(*(self._full_speed(B[i, :]) for i in range(self.robot.dof)))
        free = full / (s["time"] * s["root_weight"])  # δν̇ that costs 1
        T = math.diag(free[:count])
        if count:
            ahead = (sample.nu_d + s["horizon_dyn"] * sample.nu_d_dot)[:count] / full[:count]
            d = ahead / math.sqrt(math.dot(ahead, ahead) + REST_SPEED_FRACTION**2)
            c = 1.0 - math.sqrt(s["along"])
            T @= math.SX.eye(count) + c / (1.0 - c * math.dot(d, d)) * (d @ d.T)
        joints, reach = M[count:, count:], (full / s["time"])[count:]
        unit = math.dot(math.diag(joints), reach**2) / max(joints.shape[0], 1)
        weight = math.diag(math.sqrt(unit) / s["root_weight"][count:])
        return math.diagcat(T, weight @ _inverse_root(joints))

    def _shift(self, parts: Mapping[str, Any]) -> Any:
        """Return δν̇ (dof, 1) that brings each joint of the arm within its own bounds."""
        shift = math.SX.zeros(self.robot.dof, 1)
        for j, k in self.own.items():
            now, lower, upper = (parts[name][j] for name in ("acceleration", "lower", "upper"))
            shift[k] = math.fmin(math.fmax(now, lower), upper) - now
        return shift

    def _of_base(self, change: Any) -> Any:
        """Return δν̇ by y (dof, dof) of the base, where all joints follow."""
        count = len(self.robot.drive.base_speeds)
        return math.horzcat(change[:, :count], math.SX(change.shape[0], change.shape[1] - count))

    def _full_speed(self, row: Any) -> Any:
        """Return the speed at which the first actuator reaches its velocity limit.

        Args:
            row: Of B (1, n_act).
        """
        most = math.SX(0)
        for k, limit in enumerate(self._fastest.tolist()):
            most = math.fmax(most, math.fabs(row[0, k]) / limit)
        return 1.0 / most

    def _null_space(self, dynamics: SymbolicDynamics, q: Any) -> Any:
        """Return columns (n_act, n) of the efforts over their limits that move nothing.

        An orthonormal basis of that space would do as well as the projection onto it, which has
        more columns: x of least length does not depend on it.

        Args:
            q: Configuration (nq, 1).
        """
        at, unit = dynamics.at(q), self._unit
        dof, count = at.B.shape
        if dof >= count:
            return math.SX(count, 0)
        moving = _scaled(1.0 / unit, at.allocation @ at.B @ math.diag(math.DM(unit)))
        projection = math.SX.eye(count) - moving
        kept = [k for k in range(count) if not _is_nothing(projection[:, k])]
        return math.sparsify(projection[:, kept]) / NULLSPACE_EFFORT_WEIGHT**0.5


def _inverse_root(M: Any) -> Any:
    """Return T (n, n) with T Tᵀ = M⁻¹ of a symmetric positive definite M (n, n)."""
    n = M.shape[0]
    L, over = factored([[M[i, j] for j in range(n)] for i in range(n)])
    T = math.SX.eye(n)
    for i, row in enumerate(L):
        for j, factor in row.items():
            T[i, :] -= factor * T[j, :]
    return T @ math.diag(math.vertcat(*(math.sqrt(each) for each in over), math.SX(0, 1)))


def _scaled(factors: Array, matrix: Any) -> Any:
    """Return a matrix whose rows are multiplied by factors (n,)."""
    return math.diag(math.DM(factors)) @ matrix


def _is_nothing(column: Any) -> bool:
    return bool(column.is_constant()) and bool(np.abs(math.DM(column).full()).max() < NO_EFFORT)


class Before(NamedTuple):
    """What the integral remembers of the last sample."""

    nu: Any  # (dof, 1)
    nu_dot: Any  # (dof, 1) since then, if d was right
    sampled: Any  # whether there was one (1, 1)


def learnt(gain: Any, d: Any, nu: Any, before: Before, elapsed: Any) -> Any:
    """Return d (dof, 1) at a sample.

    Args:
        gain: k (dof, 1), 1/s; a longer pause teaches no more than ν̇.
        d: As it was at the last sample (dof, 1).
        nu: Quasi-velocities now (dof, 1).
        elapsed: Time since the last sample, s; 0 if other efforts than the law's were sent since
            then: the integral waits.
    """
    counts = math.logic_and(before.sampled, elapsed > 0.0)
    time = math.if_else(counts, elapsed, 1.0)
    unexpected = nu - before.nu - elapsed * before.nu_dot
    return math.if_else(counts, d + math.fmin(gain, 1.0 / time) * unexpected, d)
