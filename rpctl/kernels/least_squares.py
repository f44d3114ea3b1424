"""Least squares within hard and soft bounds, step by step, over CasADi's scalars.

It finds the x of least ½|x|² + ½|s|²/COMPLIANCE with l ≤ G x ≤ u, where s is by how much soft rows
may be beyond their bounds. With z = s/√COMPLIANCE the minimum is at (x, z) = −G₊ᵀ λ,
G₊ = [G, √COMPLIANCE 1] for soft rows, and λ > 0 of an active upper bound, λ < 0 of a lower one. Any
λ is dual feasible, which takes whatever was found before for a start. One step solves for λ on the
active rows,

    H λ = −b,    H = G₊ G₊ᵀ,

positive definite on any of them that can bind together. Where a sign comes out wrong, the step ends
where the first λ vanishes, and its row leaves; else the row that is broken most, by its distance,
joins. The dual function grows with every step, so none returns to a set of rows ([GI83]).

H has the square of G's condition. So x is corrected by what G x misses ([B87], the corrected
seminormal equations), which makes it as accurate as an orthogonal factorisation would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rpctl import math
from rpctl.kernels.scalars import reciprocal

COMPLIANCE = 1e-4  # of x: the square that breaking a soft bound by one is worth; well conditioned
PRIMAL_TOLERANCE = 1e-9  # of a bound
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
        math.if_else(partial, short, new) for short, new in zip(shortened, found, strict=True)
    ]
    active = [
        math.if_else(partial, _if(math.logic_not(out), sign), sign + side)
        for sign, out, side in zip(signs, left, joins, strict=True)
    ]
    going = state.going

    def frozen(new: Any, old: Any) -> Any:
        return math.if_else(going, new, old)

    return DualState(
        frozen(math.vertcat(*active), state.active),
        frozen(math.vertcat(*multipliers), state.multipliers),
        frozen(x, state.x),
        math.logic_and(going, math.logic_or(partial, any_broken)),
    )


def _solved(
    rows: BoundedRows, counts: Sequence[Any], b: Sequence[Any]
) -> tuple[list[Any], Any, Any]:
    """Return the multipliers, x (n, 1) and G x (n_rows, 1) where the rows that count are b."""
    solve, count = _Factors(rows.H, counts), len(rows.slack)
    found = [math.SX(0)] * count
    x, z = math.SX.zeros(rows.G.shape[1], 1), [math.SX(0)] * count
    missed = [-each for each in b]
    for _ in range(1 + CORRECTIONS):
        correction = solve(missed)
        found = [a + c for a, c in zip(found, correction, strict=True)]
        x -= rows.G.T @ math.vertcat(*correction)
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
        math.if_else(bad, old / math.if_else(bad, old - new, 1.0), 1.0)
        for old, new, bad in zip(before, found, wrong, strict=True)
    ]
    fraction = math.SX(1.0)
    for way in ways:
        fraction = math.fmin(fraction, way)
    left = [math.logic_and(bad, way <= fraction) for bad, way in zip(wrong, ways, strict=True)]
    shortened = [
        _if(math.logic_not(out), old + fraction * (new - old))
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
        excess = math.fmax(above, below)
        broken = math.logic_and(math.logic_not(active), excess > PRIMAL_TOLERANCE)
        sides.append(math.if_else(above > below, 1.0, -1.0))
        squares.append(_if(broken, excess**2 / rows.H[i, i]))
    largest = math.SX(0)
    for square in squares:
        largest = math.fmax(largest, square)
    taken, joins = largest == 0.0, []
    for side, square in zip(sides, squares, strict=True):
        joining = math.logic_and(math.logic_not(taken), square == largest)
        joins.append(_if(joining, side))
        taken = math.logic_or(taken, joining)
    return joins, largest > 0.0


def _if(condition: Any, value: Any) -> Any:
    """Return a value where a condition holds, else 0."""
    return math.if_else(condition, value, 0.0)


def _any(conditions: Sequence[Any]) -> Any:
    found = math.SX(0)
    for condition in conditions:
        found = math.logic_or(found, condition)
    return found


class _Factors:
    """L D Lᵀ of the rows and columns of H that count; the others are those of 1.

    The rows are taken in their order, so that what is diagonal of the first ones stays so.

    Args:
        H: Symmetric (n, n), its lower half.
        counts: 1 of each row that counts, 0 of others.
    """

    def __init__(self, H: Any, counts: Sequence[Any]) -> None:
        n, zero = len(counts), math.SX(0)
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
