"""The search for the bounds that bind, against DAQP and against the conditions of a minimum."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.kernels.least_squares import (
    COMPLIANCE,
    PRIMAL_TOLERANCE,
    BoundedRows,
    DualState,
    dual_step,
)
from tests.control.referee import shortest

SOFT, HARD, N = 4, 3, 4
ROWS = SOFT + HARD
SLACK = (COMPLIANCE**0.5,) * SOFT + (0.0,) * HARD


def step_function() -> Any:
    """Return a step of the search as a function of G, bounds and state."""
    sym = casadi.SX.sym
    G, lower, upper = sym("G", ROWS, N), sym("lower", ROWS), sym("upper", ROWS)
    state = DualState(sym("active", ROWS), sym("multipliers", ROWS), sym("x", N), sym("going"))
    H = casadi.tril(G @ G.T + casadi.diag(casadi.DM(np.square(SLACK))))
    after = dual_step(BoundedRows(G, H, lower, upper, SLACK), state)
    parts = [state.active, state.multipliers, state.x, state.going]
    return casadi.Function(
        "step", [G, lower, upper, *parts],
        [after.active, after.multipliers, after.x, after.going],
    )  # fmt: skip


STEP = step_function()


def search(G: Array, bounds: tuple[Array, Array], start: Array) -> tuple[Array, Array, Array, int]:
    """Return active bounds, multipliers, x, and the number of steps."""
    active, multipliers, x, going = np.sign(start), start, np.zeros(N), np.ones(1)
    for steps in range(1, 60):
        found = STEP(G, *bounds, active, multipliers, x, going)
        active, multipliers, x, going = (part.full().ravel() for part in found)
        if not going[0]:
            return active, multipliers, x, steps
    raise AssertionError("the search does not end")


def random_problem(rng: np.random.Generator, kind: int) -> tuple[Array, tuple[Array, Array]]:
    """Return rows and bounds; on some rows they are equal, or infinite."""
    G = rng.normal(size=(ROWS, N)) * rng.choice([0.1, 1.0, 10.0], size=(ROWS, 1))
    middle, half = rng.normal(size=ROWS), np.abs(rng.normal(size=ROWS))
    lower, upper = middle - half, middle + half
    if kind % 3 == 1:
        lower[1] = upper[1]
    if kind % 3 == 2:
        upper[0], lower[SOFT] = np.inf, -np.inf
    return G, (lower, upper)


def test_it_finds_what_daqp_finds_from_any_start(rng: np.random.Generator) -> None:
    for kind in range(60):
        G, bounds = random_problem(rng, kind)
        wanted = shortest(
            G[SOFT:], (bounds[0][SOFT:], bounds[1][SOFT:]),
            G[:SOFT], (bounds[0][:SOFT], bounds[1][:SOFT]),
        )  # fmt: skip
        start = np.zeros(ROWS) if kind % 2 else rng.normal(size=ROWS) * np.isfinite(sum(bounds))
        active, multipliers, x, _ = search(G, bounds, start)
        pulls = np.concatenate([wanted.soft, wanted.hard])
        size = 1.0 + np.abs(wanted.x).max()
        np.testing.assert_allclose(x / size, wanted.x / size, rtol=0.0, atol=1e-10)
        np.testing.assert_array_equal(active, np.sign(pulls))
        np.testing.assert_allclose(multipliers, pulls, rtol=1e-6, atol=1e-6 * np.abs(pulls).max())


def test_the_conditions_of_a_minimum_hold(rng: np.random.Generator) -> None:
    """x + Gᵀλ = 0, bounds kept, or broken by COMPLIANCE times a multiplier of the right sign."""
    bound = 0
    for kind in range(40):
        G, (lower, upper) = random_problem(rng, kind)
        active, multipliers, x, _ = search(G, (lower, upper), np.zeros(ROWS))
        scale = 1.0 + np.abs(G).max() * np.abs(multipliers).max()
        np.testing.assert_allclose(x, -G.T @ multipliers, rtol=0.0, atol=1e-9 * scale)
        values = G @ x - np.square(SLACK) * multipliers
        nearest = np.where(active > 0.0, upper, lower)
        np.testing.assert_allclose(values[active != 0.0], nearest[active != 0.0], atol=1e-8)
        assert (values >= lower - 10.0 * PRIMAL_TOLERANCE).all()
        assert (values <= upper + 10.0 * PRIMAL_TOLERANCE).all()
        assert (active * multipliers >= 0.0).all()
        assert not multipliers[active == 0.0].any()
        bound += int(np.count_nonzero(active))
    assert bound > 40


def test_what_is_done_stays_as_it_is(rng: np.random.Generator) -> None:
    G, bounds = random_problem(rng, 0)
    state = [np.ones(ROWS), rng.normal(size=ROWS), rng.normal(size=N), np.zeros(1)]
    after = STEP(G, *bounds, *state)
    for before, part in zip(state, after, strict=True):
        assert part.full().ravel().tolist() == before.tolist()


def test_a_nearly_singular_problem_is_solved_to_rounding(rng: np.random.Generator) -> None:
    """H has a condition of 1e13 where two active rows are a millionth apart."""
    G, (lower, upper) = random_problem(rng, 0)
    G[SOFT + 1] = G[SOFT] + 1e-6 * rng.normal(size=N)
    lower[SOFT:], upper[SOFT:] = -np.inf, np.inf
    lower[:SOFT], upper[:SOFT] = -np.inf, np.inf
    wish = rng.normal(size=N)
    rows = [SOFT, SOFT + 1]
    lower[rows] = upper[rows] = G[rows] @ wish
    active, _, x, _ = search(G, (lower, upper), np.zeros(ROWS))
    assert np.flatnonzero(active).tolist() == rows
    best = np.linalg.lstsq(G[rows], upper[rows], rcond=None)[0]
    np.testing.assert_allclose(x, best, rtol=0.0, atol=1e-9)
