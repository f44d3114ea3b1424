"""Least squares within hard and soft bounds, step by step, in CasADi's symbols.

It is the problem of :func:`rpctl.control.bounded.shortest`: the x of least
½|x|² + ½|s|²/COMPLIANCE with l ≤ G x ≤ u, where s is by how much soft rows may be beyond their
bounds. With z = s/√COMPLIANCE the minimum is at (x, z) = −G₊ᵀ λ, G₊ = [G, √COMPLIANCE 1] for soft
rows, and λ > 0 of an active upper bound, λ < 0 of a lower one. Any λ is dual feasible, which takes
whatever was found before for a start. One step solves for λ on the active rows,

    H λ = −b,    H = G₊ G₊ᵀ,

positive definite on any of them that can bind together. Where a sign comes out wrong, the step ends
where the first λ vanishes, and its row leaves; else the row that is broken most, by its distance,
joins. The dual function grows with every step, so none returns to a set of rows ([GI83]).

H has the square of G's condition. So x is corrected by what G x misses ([B87], the corrected
seminormal equations), which makes it as accurate as an orthogonal factorisation would.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import (
    COMPLIANCE,
    NULLSPACE_EFFORT_WEIGHT,
    PRIMAL_TOLERANCE,
    REST_SPEED_FRACTION,
    BoundedLaw,
)
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.linear import reciprocal
from rpctl.kernels.scalars import clipped
from rpctl.simulation.compiled.laws.dynamic import LawSample, effort_gain, middle
from rpctl.simulation.compiled.laws.fragment import LIMIT_KINDS
from rpctl.simulation.compiled.laws.tracking import by_name

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

    ``tau`` (n_act, 1) are the efforts of ν̇*, ``parts`` the entries of :class:`BoundedSample` by
    name.
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


CORRECTIONS = 2  # of x; with H of condition 1e14 it is then right to 1e-10


@dataclass(frozen=True, eq=False)
class BoundedRows:
    """Rows and their bounds; the soft ones first.

    Attributes:
        G: Rows (n_rows, n), sparse where they are constantly 0.
        H: G₊ G₊ᵀ (n_rows, n_rows), its lower half.
        lower: (n_rows, 1).
        upper: (n_rows, 1).
        slack: √COMPLIANCE of soft rows, 0 of hard ones.
    """

    G: Any
    H: Any
    lower: Any
    upper: Any
    slack: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class DualState:
    """Where the search has come to.

    Attributes:
        active: −1, 0 or 1 of each row (n_rows, 1): which bound holds it.
        multipliers: λ (n_rows, 1).
        x: (n, 1) of the active rows.
        going: Whether there is a step left (1, 1).
    """

    active: Any
    multipliers: Any
    x: Any
    going: Any


def dual_step(rows: BoundedRows, state: DualState) -> DualState:
    """Return the state after one step; one that is not going stays as it is.

    Args:
        rows: The rows.
        state: The state before; its x is not used.
    """
    count = len(rows.slack)
    signs = [state.active[i] for i in range(count)]
    counts = [sign * sign for sign in signs]
    b = [
        _if(sign > 0.0, rows.upper[i]) + _if(sign < 0.0, rows.lower[i])
        for i, sign in enumerate(signs)
    ]
    found, x, values = _solved(rows, counts, b)
    before = [state.multipliers[i] for i in range(count)]
    wrong = [sign * new < 0.0 for sign, new in zip(signs, found, strict=True)]
    shortened, left = _shorten(before, found, wrong)
    joins, any_broken = _most_broken(rows, values, counts)
    partial = _any(wrong)
    multipliers = [
        casadi.if_else(partial, short, new) for short, new in zip(shortened, found, strict=True)
    ]
    active = [
        casadi.if_else(partial, _if(casadi.logic_not(out), sign), sign + side)
        for sign, out, side in zip(signs, left, joins, strict=True)
    ]
    going = state.going

    def frozen(new: Any, old: Any) -> Any:
        return casadi.if_else(going, new, old)

    return DualState(
        frozen(casadi.vertcat(*active), state.active),
        frozen(casadi.vertcat(*multipliers), state.multipliers),
        frozen(x, state.x),
        casadi.logic_and(going, casadi.logic_or(partial, any_broken)),
    )


def _solved(
    rows: BoundedRows, counts: Sequence[Any], b: Sequence[Any]
) -> tuple[list[Any], Any, Any]:
    """Return the multipliers, x (n, 1) and G x (n_rows, 1) where the rows that count are b."""
    solve, count = _Factors(rows.H, counts), len(rows.slack)
    found = [casadi.SX(0)] * count
    x, z = casadi.SX.zeros(rows.G.shape[1], 1), [casadi.SX(0)] * count
    missed = [-each for each in b]
    for _ in range(1 + CORRECTIONS):
        correction = solve(missed)
        found = [a + c for a, c in zip(found, correction, strict=True)]
        x -= rows.G.T @ casadi.vertcat(*correction)
        z = [a - w**2 * c for a, w, c in zip(z, rows.slack, correction, strict=True)]
        values = rows.G @ x
        missed = [counts[i] * (values[i] + z[i] - b[i]) for i in range(count)]
    return found, x, values


def _shorten(
    before: Sequence[Any], found: Sequence[Any], wrong: Sequence[Any]
) -> tuple[list[Any], list[Any]]:
    """Return the multipliers where the first of them vanishes, and which ones do there.

    Args:
        before: Multipliers before the step.
        found: Those after a whole step.
        wrong: Which of these have the wrong sign.
    """
    ways = [
        casadi.if_else(bad, old / casadi.if_else(bad, old - new, 1.0), 1.0)
        for old, new, bad in zip(before, found, wrong, strict=True)
    ]
    fraction = casadi.SX(1.0)
    for way in ways:
        fraction = casadi.fmin(fraction, way)
    left = [casadi.logic_and(bad, way <= fraction) for bad, way in zip(wrong, ways, strict=True)]
    shortened = [
        _if(casadi.logic_not(out), old + fraction * (new - old))
        for old, new, out in zip(before, found, left, strict=True)
    ]
    return shortened, left


def _most_broken(rows: BoundedRows, values: Any, counts: Sequence[Any]) -> tuple[list[Any], Any]:
    """Return which bound (−1 or 1) of the row that is broken most joins, 0 of all others.

    Args:
        rows: The rows.
        values: G x (n_rows, 1).
        counts: 1 of each active row, 0 of others.
    """
    sides, squares = [], []
    for i, active in enumerate(counts):
        above, below = values[i] - rows.upper[i], rows.lower[i] - values[i]
        excess = casadi.fmax(above, below)
        broken = casadi.logic_and(casadi.logic_not(active), excess > PRIMAL_TOLERANCE)
        sides.append(casadi.if_else(above > below, 1.0, -1.0))
        squares.append(_if(broken, excess**2 / rows.H[i, i]))
    largest = casadi.SX(0)
    for square in squares:
        largest = casadi.fmax(largest, square)
    taken, joins = largest == 0.0, []
    for side, square in zip(sides, squares, strict=True):
        joining = casadi.logic_and(casadi.logic_not(taken), square == largest)
        joins.append(_if(joining, side))
        taken = casadi.logic_or(taken, joining)
    return joins, largest > 0.0


def _if(condition: Any, value: Any) -> Any:
    """Return a value where a condition holds, else 0."""
    return casadi.if_else(condition, value, 0.0)


def _any(conditions: Sequence[Any]) -> Any:
    found = casadi.SX(0)
    for condition in conditions:
        found = casadi.logic_or(found, condition)
    return found


class _Factors:
    """L D Lᵀ of the rows and columns of H that count; the others are those of 1.

    The rows are taken in their order, so that what is diagonal of the first ones stays so.

    Args:
        H: Symmetric (n, n), its lower half.
        counts: 1 of each row that counts, 0 of others.
    """

    def __init__(self, H: Any, counts: Sequence[Any]) -> None:
        n, zero = len(counts), casadi.SX(0)
        rows: list[dict[int, Any]] = []
        # Factors rather than choices: CasADi would take these apart again in every product.
        for i, own in enumerate(counts):
            filled = (j for j in range(i) if H.sparsity().has_nz(i, j))
            rows.append({j: own * counts[j] * H[i, j] for j in filled})
            rows[i][i] = own * H[i, i] + (1.0 - own)
        self.over: list[Any] = []
        self.L: list[dict[int, Any]] = [{} for _ in range(n)]
        for k in range(n):
            self.over.append(reciprocal(rows[k][k]))
            below = {i: rows[i][k] for i in range(k + 1, n) if k in rows[i]}
            for i, entry in below.items():
                factor = self.L[i][k] = entry * self.over[k]
                for j, other in below.items():
                    if j <= i:
                        rows[i][j] = rows[i].get(j, zero) - factor * other

    def __call__(self, right: Sequence[Any]) -> list[Any]:
        """Return the solution (n,)."""
        found = list(right)
        for i, row in enumerate(self.L):
            for k, factor in row.items():
                found[i] = found[i] - factor * found[k]
        found = [each * over for each, over in zip(found, self.over, strict=True)]
        for i in reversed(range(len(found))):
            for k, factor in self.L[i].items():
                found[k] = found[k] - factor * found[i]
        return found
