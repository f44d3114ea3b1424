"""Equations solved without looking for pivots: what NumPy says, and nothing divided by zero."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.kernels.scalars import BlockSolver, column, least, solve_positive


def symbols(matrix: Array) -> tuple[Any, list[list[Any]]]:
    """Return symbols for the entries that are not 0, and the matrix of them."""
    p = casadi.SX.sym("p", int(np.count_nonzero(matrix)))
    order = iter(range(p.numel()))
    return p, [[p[next(order)] if entry else 0.0 for entry in row] for row in matrix.tolist()]


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_positive(size: int, rng: np.random.Generator) -> None:
    half = rng.normal(size=(size, size))
    M, b = half @ half.T + np.eye(size), rng.normal(size=size)
    M[0, size // 2 + 1 :] = M[size // 2 + 1 :, 0] = 0.0
    p, rows = symbols(M)
    solve = casadi.Function("solve", [p], [column(solve_positive(rows, b.tolist()))])
    found = solve(M[M != 0.0]).full().ravel()
    np.testing.assert_allclose(found, np.linalg.solve(M, b), rtol=1e-11)


def test_only_pivots_divide(rng: np.random.Generator) -> None:
    """CasADi makes a division of each product with an inverse; it must not get to see one."""
    p, rows = symbols(np.ones((6, 6)))
    function = casadi.Function("solve", [p], [column(solve_positive(rows, [1.0] * 6))])
    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    assert kinds.count(casadi.OP_INV) == 6 and casadi.OP_DIV not in kinds


PATTERNS = {
    "three": np.ones((3, 3)),
    "zero pivots": np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]]),
    "blocks": np.array([[0, 0, 1, 1], [0, 0, 1, 1], [1, 0, 1, 1], [1, 1, 1, 1]]),
    "four": np.ones((4, 4)),
    "one": np.ones((1, 1)),
    "order": np.array([[0, 1, 1, 0, 0], [1, 0, 0, 0, 0], [0, 0, 1, 0, 0], [1, 1, 1, 1, 0],
                       [0, 1, 0, 1, 1]]),
}  # fmt: skip


@pytest.mark.parametrize("name", PATTERNS)
def test_blocks(name: str, rng: np.random.Generator) -> None:
    M = PATTERNS[name] * rng.uniform(0.5, 2.0, PATTERNS[name].shape)
    b = rng.normal(size=len(M))
    p, rows = symbols(M)
    solver = BlockSolver(rows, 2.0 * PATTERNS[name])
    outputs = [column(solver.solve(b.tolist())), casadi.SX(solver.margin)]
    found, margin = casadi.Function("solve", [p], outputs)(M[M != 0.0])
    np.testing.assert_allclose(found.full().ravel(), np.linalg.solve(M, b), rtol=1e-10)
    assert 0.0 < float(margin) <= 1.0


def test_the_margin_bounds_how_singular_a_block_is() -> None:
    """|det| is at most the product of the rows' sizes, and 0 where rows depend on each other."""
    t = casadi.SX.sym("t")
    rows: list[list[Any]] = [[casadi.cos(t), casadi.sin(t)], [1.0, 1.0]]
    margin = casadi.Function("margin", [t], [BlockSolver(rows, np.ones((2, 2))).margin])
    assert float(margin(-0.25 * np.pi)) == pytest.approx(np.sqrt(2.0) / 4.0)
    assert float(margin(0.25 * np.pi)) < 1e-15
    assert float(margin(0.25 * np.pi + 1e-7)) == pytest.approx(np.sqrt(2.0) * 1e-7 / 4.0)


def test_the_least_of_constants_and_symbols() -> None:
    x = casadi.SX.sym("x")
    assert least([3.0, 2.0]) == 2.0
    function = casadi.Function("least", [x], [least([3.0, x, 2.0, 5.0 * x])])
    assert [float(function(value)) for value in (-1.0, 1.0, 9.0)] == [-5.0, 1.0, 2.0]
