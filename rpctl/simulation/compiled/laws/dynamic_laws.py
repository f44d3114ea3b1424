"""The dynamic laws in CasADi's symbols, up to where limits bind; see :mod:`rpctl.control.bounded`.

M and h are those of the middle of the period. Where a limit may bind they are worked out once, for
how the efforts grow with ν̇, and for what the robot does where these are not what is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedLaw
from rpctl.simulation.compiled.laws.joint_bounds import SymbolicBounds, SymbolicJointLimits
from rpctl.simulation.compiled.laws.kinematic_laws import Settings
from rpctl.simulation.compiled.laws.law_settings import by_name
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


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
