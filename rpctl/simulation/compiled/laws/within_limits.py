"""Efforts within limits in CasADi's symbols; see :class:`rpctl.control.bounded.BoundedLaw`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import (
    NULLSPACE_EFFORT_WEIGHT,
    REST_SPEED_FRACTION,
    BoundedLaw,
)
from rpctl.control.soft_bound_qp import COMPLIANCE
from rpctl.simulation.compiled.laws.dynamic_laws import LawSample, effort_gain, middle
from rpctl.simulation.compiled.laws.law_fragment import LIMIT_KINDS
from rpctl.simulation.compiled.laws.law_settings import by_name
from rpctl.simulation.compiled.symbols.choices import clipped
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics

NO_EFFORT = 1e-9  # of an effort: what of a null space's entries is rounding


def effort_rows(
    law: BoundedLaw,
    dynamics: SymbolicDynamics,
    sample: LawSample,
    tau: Any,
    parts: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the quadratic program of a sample, by the names of :class:`BoundedRows`.

    The unknowns are y with p = T y, and efforts that move nothing. Beside what its rows are, the
    efforts over their limits, ``E`` (n_act, n), come with it.

    Args:
        law: The law on the robot.
        dynamics: The robot's dynamics, as far as the controller knows them.
        sample: The sample.
        tau: Efforts of ν̇* (n_act, 1).
        parts: Entries of :class:`BoundedSample` by name.
    """
    robot, s, limits = dynamics.robot, sample.s, law.effort_limits
    M, now, lower, upper = (parts[name] for name in ("M", "acceleration", "lower", "upper"))
    q = middle(dynamics, sample, law.held_for).q
    unit = np.where(np.isfinite(limits), limits, 1.0)
    rates = casadi.diag(1.0 / by_name(s, "time", robot.quasi_velocities))
    change = rates @ _cost_factor(law, dynamics, q, sample)  # of ν̇ by y
    h1, full = s["horizon_dyn"], casadi.DM(law.joints.full)
    null = _null_space(dynamics, q, unit)
    E = _scaled(1.0 / unit, effort_gain(dynamics, q, casadi.tril2symm(M)) @ change)
    E = casadi.sparsify(casadi.horzcat(E, null))
    rows = dynamics.at(sample.q).S[law.joints.indices, :]
    K = _scaled(1.0 / law.joints.full, h1 * (rows @ change))
    K = casadi.horzcat(K, casadi.SX(K.shape[0], null.shape[1]))
    limited = np.flatnonzero(np.isfinite(limits)).tolist()
    G = casadi.sparsify(casadi.vertcat(K, E[limited, :]))
    ratios = [tau[k] / float(limits[k]) for k in limited]
    slack = slacks(law)
    H = casadi.tril(G @ G.T + casadi.diag(casadi.DM(np.square(slack))))
    return {
        "G": G,
        "H": casadi.sparsify(H),
        "lower": casadi.vertcat(h1 * (lower - now) / full, *(-1.0 - ratio for ratio in ratios)),
        "upper": casadi.vertcat(h1 * (upper - now) / full, *(1.0 - ratio for ratio in ratios)),
        "E": E,
    }


def _scaled(factors: Array, matrix: Any) -> Any:
    """Return a matrix whose rows are multiplied by factors (n,)."""
    return casadi.diag(casadi.DM(factors)) @ matrix


def limited_efforts(law: BoundedLaw, tau: Any, change: Any, binds: Any) -> Any:
    """Return the efforts (n_act, 1) within their limits.

    Args:
        law: The law on the robot.
        tau: Efforts of ν̇* (n_act, 1).
        change: What limits add to them, over their limits (n_act, 1).
        binds: Whether a limit binds.
    """
    found = []
    for k, limit in enumerate(law.effort_limits.tolist()):
        unit = limit if math.isfinite(limit) else 1.0
        bound = clipped(tau[k] + unit * change[k], -limit, limit)
        found.append(casadi.if_else(binds, bound, tau[k]))
    return casadi.vertcat(*found)


def limit_codes(law: BoundedLaw, active: Any, parts: Mapping[str, Any], binds: Any) -> Any:
    """Return which limits bind, as :class:`LimitNames` reads them.

    Args:
        law: The law on the robot.
        active: Which rows are active at which bound (n_rows, 1), those of joints first.
        parts: Entries of :class:`BoundedSample` by name.
        binds: Whether a limit binds.
    """
    joints, row = len(law.joints.names), len(law.joints.names)
    codes = []
    for limit in law.effort_limits.tolist():
        codes.append(active[row] != 0.0 if math.isfinite(limit) else casadi.SX(0))
        row += math.isfinite(limit)
    for j in range(joints):
        upper = casadi.if_else(parts["by_upper"][j], LIMIT_KINDS.index("upper"), 1.0)
        lower = casadi.if_else(parts["by_lower"][j], LIMIT_KINDS.index("lower"), 1.0)
        below = casadi.if_else(active[j] < 0.0, lower, 0.0)
        codes.append(casadi.if_else(active[j] > 0.0, upper, below))
    return casadi.vertcat(*(casadi.if_else(binds, code, 0.0) for code in codes))


def slacks(law: BoundedLaw) -> tuple[float, ...]:
    """Return √COMPLIANCE of the rows of joints, which are soft, and 0 of those of efforts.

    Args:
        law: The law on a robot.
    """
    hard = np.count_nonzero(np.isfinite(law.effort_limits))
    return (math.sqrt(COMPLIANCE),) * len(law.joints.names) + (0.0,) * int(hard)


def _cost_factor(law: BoundedLaw, dynamics: SymbolicDynamics, q: Any, sample: LawSample) -> Any:
    """Return T (dof, dof) with p = T y and J = ½ |y|²: W′ = T⁻ᵀ T⁻¹.

    Args:
        law: The law on the robot.
        dynamics: The robot's dynamics.
        q: Configuration in the middle of the period (nq, 1).
        sample: The sample.
    """
    robot, s = dynamics.robot, sample.s
    B, count = dynamics.at(q).B, len(robot.drive.base_speeds)
    full = casadi.vertcat(*(_full_speed(B[i, :], law) for i in range(robot.dof)))
    T = casadi.diag(full / by_name(s, "root_weight", robot.quasi_velocities))
    if not count:
        return T
    ahead = (sample.nu_d + s["horizon_dyn"] * sample.nu_d_dot)[:count] / full[:count]
    d = ahead / casadi.sqrt(casadi.dot(ahead, ahead) + REST_SPEED_FRACTION**2)
    c = 1.0 - casadi.sqrt(s["along"])
    squeeze = casadi.SX.eye(count) + c / (1.0 - c * casadi.dot(d, d)) * (d @ d.T)
    return casadi.diagcat(T[:count, :count] @ squeeze, T[count:, count:])


def _full_speed(row: Any, law: BoundedLaw) -> Any:
    """Return the speed at which the first actuator reaches its velocity limit.

    Args:
        row: Of B (1, n_act).
        law: The law on the robot.
    """
    ratios = [casadi.fabs(row[0, k]) / limit for k, limit in enumerate(law.fastest.tolist())]
    most = casadi.SX(0)
    for ratio in ratios:
        most = casadi.fmax(most, ratio)
    return 1.0 / most


def _null_space(dynamics: SymbolicDynamics, q: Any, unit: Array) -> Any:
    """Return columns (n_act, n) of the efforts over ``unit`` that move nothing, by their weight.

    An orthonormal basis of that space would do as well as the projection onto it, which has more
    columns: x of least length does not depend on it.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq, 1).
        unit: Units of the efforts (n_act,).
    """
    at = dynamics.at(q)
    dof, count = at.B.shape
    if dof >= count:
        return casadi.SX(count, 0)
    moving = _scaled(1.0 / unit, at.allocation @ at.B @ casadi.diag(casadi.DM(unit)))
    projection = casadi.SX.eye(count) - moving
    kept = [k for k in range(count) if not _is_nothing(projection[:, k])]
    return casadi.sparsify(projection[:, kept]) / math.sqrt(NULLSPACE_EFFORT_WEIGHT)


def _is_nothing(column: Any) -> bool:
    return bool(column.is_constant()) and bool(np.abs(casadi.DM(column).full()).max() < NO_EFFORT)
