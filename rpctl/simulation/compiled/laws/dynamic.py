"""The dynamic laws in CasADi's symbols, up to where limits bind; see :mod:`rpctl.control.bounded`.

M and h are those of the middle of the period. Where a limit may bind they are worked out once, for
how the efforts grow with ν̇, and for what the robot does where these are not what is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.bounded import ROUNDING, BoundedLaw
from rpctl.control.joint_limits import (
    BRAKE_FRACTION,
    MAX_BRAKE,
    MIN_BRAKE,
    NO_LIMIT_GAP,
    JointLimits,
)
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.linear import reciprocal
from rpctl.kernels.scalars import clipped
from rpctl.simulation.compiled.laws.tracking import Settings, by_name


@dataclass(frozen=True, eq=False)
class LawSample:
    """A sample that a dynamic law answers.

    Attributes:
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        nu_d: Desired ones (dof, 1).
        nu_d_dot: Their derivatives (dof, 1).
        s: Settings of the laws by name.
    """

    q: Any
    nu: Any
    nu_d: Any
    nu_d_dot: Any
    s: Settings


def desired_acceleration(dynamics: SymbolicDynamics, sample: LawSample) -> Any:
    """Return ν̇* (dof, 1)."""
    times = by_name(sample.s, "time", dynamics.robot.quasi_velocities)
    return sample.nu_d_dot - (sample.nu - sample.nu_d) / times


def middle(dynamics: SymbolicDynamics, sample: LawSample, period: float) -> LawSample:
    """Return the state in the middle of a period, as :func:`rpctl.control.dynamic.midpoint`.

    Args:
        dynamics: The robot's dynamics.
        sample: The sample.
        period: For how long efforts are held, s; 0 returns the sample.
    """
    if period == 0.0:
        return sample
    step = 0.5 * period
    v = dynamics.basis(sample.q) @ sample.nu
    q, ahead_by = dynamics.integrate(sample.q, step * v), step * sample.nu_d_dot
    return LawSample(q, sample.nu + ahead_by, sample.nu_d + ahead_by, sample.nu_d_dot, sample.s)


def paper_efforts(dynamics: SymbolicDynamics, sample: LawSample, period: float) -> Any:
    """Return τ (n_act, 1) of :class:`rpctl.control.dynamic.PaperDynamic`.

    Args:
        dynamics: The robot's dynamics, as far as the controller knows them.
        sample: The sample.
        period: For how long efforts are held, as far as the law takes account of it, s.
    """
    at = middle(dynamics, sample, period)
    nu_dot = desired_acceleration(dynamics, sample)
    return dynamics.efforts(at.q, dynamics.inverse(at.q, at.nu, nu_dot, at.nu_d))


@dataclass(frozen=True, eq=False)
class FreeSample:
    """What the law within limits makes of a sample if no limit binds.

    Attributes:
        nu_dot: ν̇* (dof, 1).
        tau: Efforts of ν̇* (n_act, 1).
        doubtful: Whether a limit may bind (1, 1).
    """

    nu_dot: Any
    tau: Any
    doubtful: Any


def free_sample(
    law: BoundedLaw, dynamics: SymbolicDynamics, sample: LawSample, disturbance: Any
) -> FreeSample:
    """Return the terms of :class:`rpctl.control.bounded.BoundedLaw` that every sample needs.

    Args:
        law: The law on the robot.
        dynamics: The robot's dynamics, as far as the controller knows them.
        sample: The sample.
        disturbance: Acceleration ν̇ (dof, 1) in addition to that of ``dynamics``.
    """
    nu_dot = desired_acceleration(dynamics, sample)
    limits = SymbolicJointLimits(law.joints, sample.s["horizon_dyn"])
    rows, drift = limits.rows(dynamics, sample.q, sample.nu)
    at = middle(dynamics, sample, law.held_for)
    force = dynamics.inverse(at.q, at.nu, nu_dot - disturbance, at.nu_d)
    tau = dynamics.efforts(at.q, force)
    doubtful = limits.doubtful(sample.q, rows @ sample.nu, rows @ nu_dot + drift)
    return FreeSample(nu_dot, tau, casadi.logic_or(doubtful, beyond(law.effort_limits, tau)))


def beyond(limits: Array, tau: Any) -> Any:
    """Return whether efforts (n_act, 1) are beyond their limits (n_act,)."""
    found = casadi.SX(0)
    for k, limit in enumerate(limits.tolist()):
        found = casadi.logic_or(found, casadi.fabs(tau[k]) > limit)
    return found


@dataclass(frozen=True, eq=False)
class BoundedSample:
    """What the law within limits needs to know of a sample where a limit may bind.

    Attributes:
        M: Inertia in the middle of the period (dof, dof).
        push: ℓ − h there (dof, 1): M ν̇ = B τ + push.
        acceleration: ẍ of the limited joints under ν̇* (k, 1).
        bounds: On ẍ.
        binds: Whether a limit binds (1, 1).
    """

    M: Any
    push: Any
    acceleration: Any
    bounds: SymbolicBounds
    binds: Any


def bounded_sample(
    law: BoundedLaw, dynamics: SymbolicDynamics, sample: LawSample, tau: Any
) -> BoundedSample:
    """Return the terms of :class:`rpctl.control.bounded.BoundedLaw` that limits need.

    Args:
        law: The law on the robot.
        dynamics: The robot's dynamics, as far as the controller knows them.
        sample: The sample.
        tau: Efforts of ν̇* (n_act, 1).
    """
    nu_dot = desired_acceleration(dynamics, sample)
    limits = SymbolicJointLimits(law.joints, sample.s["horizon_dyn"])
    rows, drift = limits.rows(dynamics, sample.q, sample.nu)
    at = middle(dynamics, sample, law.held_for)
    M, minus_h = dynamics.lossless(at.q, at.nu, casadi.SX.zeros(len(dynamics.robot.actuators), 1))
    gain = effort_gain(dynamics, at.q, M)
    brakes = limits.brakes(law.effort_limits, tau - gain @ nu_dot, gain, rows)
    bounds = limits.bounds(sample.q, rows @ sample.nu, brakes)
    acceleration = rows @ nu_dot + drift
    binds = casadi.logic_or(limits.broken(acceleration, bounds), beyond(law.effort_limits, tau))
    push = minus_h + dynamics.losses(at.q, at.nu)
    return BoundedSample(M, push, acceleration, bounds, binds)


def effort_gain(dynamics: SymbolicDynamics, q: Any, M: Any) -> Any:
    """Return how efforts change with ν̇ (n_act, dof).

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq, 1).
        M: Inertia there (dof, dof).
    """
    return dynamics.at(q).allocation @ M


def follow(
    dynamics: SymbolicDynamics, sample: LawSample, period: float, parts: Mapping[str, Any], tau: Any
) -> Any:
    """Return ν̇ (dof, 1) in the middle of a period, as the model has it under efforts.

    Args:
        dynamics: The robot's dynamics.
        sample: The sample.
        period: For how long efforts are held, as far as the law takes account of it, s.
        parts: Entries of :class:`BoundedSample` by name.
        tau: Efforts (n_act, 1).
    """
    B = dynamics.at(middle(dynamics, sample, period).q).B
    return dynamics.solve_positive(casadi.tril2symm(parts["M"]), B @ tau + parts["push"])


# A joint without position limits may have any rate below this one (rad/s or m/s), wherever it is,
# at any h1 up to 1000 s: √(2 · 0.1 · ½ · 10⁶) = 316.
NEVER_STOPPED = 300.0


@dataclass(frozen=True, eq=False)
class SymbolicBounds:
    """As :class:`rpctl.control.joint_limits.JointBounds`, (k, 1) each."""

    lower: Any
    upper: Any
    by_lower: Any
    by_upper: Any


class SymbolicJointLimits:
    """:class:`JointLimits` in symbols.

    Args:
        limits: Those of a robot.
        horizon: Time constant h1 of the last approach to a position limit, s.
    """

    def __init__(self, limits: JointLimits, horizon: Any) -> None:
        self._limits, self._horizon = limits, horizon

    def rows(self, dynamics: SymbolicDynamics, q: Any, nu: Any) -> tuple[Any, Any]:
        """Return the joints' rows of S (k, dof) and Ṡν (k, 1): ẋ = rows ν, ẍ = rows ν̇ + drift.

        Args:
            dynamics: The robot's dynamics.
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
        """
        indices, at = self._limits.indices, dynamics.at(q)
        return at.S[indices, :], at.drift(nu)[indices]

    def brakes(self, box: Array, holding: Any, gain: Any, rows: Any) -> list[tuple[Any, Any]]:
        """Return the largest accelerations of each joint alone, down and up.

        Args:
            box: Limits of the efforts (n_act,).
            holding: Efforts at zero acceleration (n_act, 1).
            gain: Derivative of the efforts by ν̇ (n_act, dof).
            rows: Rows of S of the joints (k, dof).
        """
        found = []
        for j in range(rows.shape[0]):
            row = rows[j, :]
            cost = gain @ (row.T / casadi.fmax(casadi.dot(row, row), ROUNDING))
            down, up = casadi.SX(math.inf), casadi.SX(math.inf)
            for k, limit in enumerate(box.tolist()):
                if math.isfinite(limit):
                    size = casadi.fmax(casadi.fabs(cost[k]), ROUNDING)
                    ease = reciprocal(size)
                    room, pull = limit * ease, holding[k] * casadi.copysign(ease, cost[k])
                    pull = casadi.if_else(size > ROUNDING, pull, 0.0)
                    down, up = casadi.fmin(down, room + pull), casadi.fmin(up, room - pull)
            found.append((down, up))
        return found

    def bounds(self, q: Any, rate: Any, brakes: list[tuple[Any, Any]]) -> SymbolicBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            brakes: Largest accelerations of each joint, down and up.
        """
        each = [self._bounds(j, q, rate[j], *pair) for j, pair in enumerate(brakes)]
        none = casadi.SX(0, 1)
        parts = zip(*each, strict=True) if each else ((), (), (), ())
        return SymbolicBounds(*(casadi.vertcat(*part, none) for part in parts))

    def _bounds(self, j: int, q: Any, rate: Any, down: Any, up: Any) -> tuple[Any, Any, Any, Any]:
        limits = self._limits
        braking = [clipped(BRAKE_FRACTION * a, MIN_BRAKE, MAX_BRAKE) for a in (down, up)]
        fastest = float(limits.fastest[j])
        lowers, uppers, by_lower, by_upper = [], [], casadi.SX(0), casadi.SX(0)
        for time in limits.times.ravel().tolist():
            ahead = q[limits.entries[j]] + time * rate
            rising, stops_up = self._stop(float(limits.upper[j]), ahead, braking[0], fastest)
            falling, stops_down = self._stop(-float(limits.lower[j]), -ahead, braking[1], fastest)
            lowest = casadi.fmin(-falling, rising)
            lowers.append((lowest - rate) / time)
            uppers.append((rising - rate) / time)
            by_lower = casadi.logic_or(by_lower, stops_down)
            by_upper = casadi.logic_or(by_upper, stops_up)
        lower, upper = casadi.fmax(*lowers), casadi.fmin(*uppers)
        # An exceeded bound takes precedence over the opposite one.
        lower = casadi.if_else(upper < 0.0, casadi.fmin(lower, upper), lower)
        upper = casadi.fmax(lower, upper)
        return casadi.fmin(lower, up), casadi.fmax(upper, -down), by_lower, by_upper

    def _stop(self, limit: float, ahead: Any, brake: Any, fastest: float) -> tuple[Any, Any]:
        """Return the fastest rate that stops below a limit, and whether that is why.

        Args:
            limit: Upper one, rad or m.
            ahead: Where the joint is, rad or m.
            brake: Deceleration, positive.
            fastest: The largest rate anyway.
        """
        if math.isinf(limit) and fastest < NEVER_STOPPED:
            return casadi.SX(fastest), casadi.SX(0)
        gap = NO_LIMIT_GAP if math.isinf(limit) else casadi.fmin(limit - ahead, NO_LIMIT_GAP)
        straight = brake * self._horizon**2
        half = 0.5 * straight
        root = casadi.sqrt(2.0 * brake * casadi.fmax(gap - half, half))
        rate = casadi.if_else(gap < straight, gap / self._horizon, root)
        return casadi.fmin(rate, fastest), rate < fastest

    def doubtful(self, q: Any, rate: Any, acceleration: Any) -> Any:
        """Return whether bounds may be broken, (1, 1), with what is known without M.

        No joint brakes less than MIN_BRAKE, and none of its bounds is tighter than with that.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            acceleration: ẍ (k, 1).
        """
        limits, found = self._limits, casadi.SX(0)
        for j, fastest in enumerate(limits.fastest.tolist()):
            for time in limits.times.ravel().tolist():
                place, moved = (
                    q[limits.entries[j]] + time * rate[j],
                    rate[j] + time * acceleration[j],
                )
                for limit, sign in ((limits.upper[j], 1.0), (-limits.lower[j], -1.0)):
                    most, _ = self._stop(float(limit), sign * place, MIN_BRAKE, fastest)
                    found = casadi.logic_or(found, sign * moved > most)
        return found

    def broken(self, acceleration: Any, bounds: SymbolicBounds) -> Any:
        """Return whether an acceleration (k, 1) is out of bounds, (1, 1).

        Args:
            acceleration: ẍ.
            bounds: Of it.
        """
        found = casadi.SX(0)
        for j in range(acceleration.numel()):
            found = casadi.logic_or(found, acceleration[j] < bounds.lower[j])
            found = casadi.logic_or(found, acceleration[j] > bounds.upper[j])
        return found
