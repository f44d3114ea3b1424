"""The quadratic program of the bounded law: the shortest vector within hard and soft bounds."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from rpctl.arrays import Array
from rpctl.errors import SolverError

COMPLIANCE = 1e-4  # of x: the square that breaking a soft bound by one is worth; well conditioned
PRIMAL_TOLERANCE = 1e-9  # of a bound; the solver's own 1e-6 would show in a log
DAQP_OPTIMAL = 1


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

    Raises:
        SolverError: The solver failed; the hard bounds may contradict each other.
    """
    n, m, k = hard.shape[1], len(hard), len(soft)
    rows = np.zeros((m + k, n + k))
    rows[:m, :n], rows[m:, :n] = hard, soft
    rows[m:, n:] = np.sqrt(COMPLIANCE) * np.eye(k)
    lower, upper = (np.concatenate(pair) for pair in zip(hard_bounds, soft_bounds, strict=True))
    x, _, flag, info = daqp.solve(
        np.eye(n + k),
        np.zeros(n + k),
        rows,
        upper,
        lower,
        np.zeros(m + k, dtype=np.int32),
        primal_tol=PRIMAL_TOLERANCE,
    )
    if flag != DAQP_OPTIMAL:
        raise SolverError(
            f"DAQP ended with status {flag} on a quadratic program of {n} unknowns, {m} hard and "
            f"{k} soft bounds"
        )
    return Solution(np.asarray(x)[:n], info["lam"][:m], info["lam"][m:])
