"""Constants are exact where they are simple, and what is constant never becomes a node."""

from __future__ import annotations

import math
from math import pi

import casadi
import numpy as np
import pytest

from rpctl.kernels.scalars import (
    any_true,
    cleaned,
    clipped,
    column,
    cross,
    entries,
    exact,
    rounded,
    times,
    total,
)

X, Y = casadi.SX.sym("x"), casadi.SX.sym("y")
EPS = float(np.finfo(float).eps)


def test_only_rounding_is_cleaned() -> None:
    values = np.array([1.0 + EPS, -1.0 - EPS, 1e-16, -1e-16, 3.0 + 2 * EPS, -3.0 - 2 * EPS, 1e-12])
    wanted = [1.0, -1.0, 0.0, 0.0, 3.0 + 2 * EPS, -3.0 - 2 * EPS, 1e-12]
    assert cleaned(values).tolist() == wanted
    assert cleaned(1e-3 * values[-1:]).tolist() == [1e-15]  # nothing larger stands beside it
    assert not np.signbit(cleaned(np.array([-0.0]))).any()


@pytest.mark.parametrize("quarters", range(-3, 4))
def test_right_angles_are_exact(quarters: int) -> None:
    cos, sin = exact(0.5 * pi * quarters)
    assert (cos, sin) == [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarters % 4]


def test_angles_that_are_nearly_right_stay() -> None:
    assert exact(0.5 * pi - 1e-12) == pytest.approx((1e-12, 1.0), rel=1e-3)
    assert exact(1e-12) == (1.0, 1e-12)


def test_constants_are_added_before_symbols() -> None:
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    assert casadi.is_equal(total([1.0, x, 2.0, y, -3.0]), x + y, 1)
    assert total([1.0, 2.0]) == 3.0 and total([]) == 0.0
    assert times(0.0, x) == 0.0 and isinstance(times(x, -0.0), float)
    assert cross([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]) == [0.0, 0.0, 1.0]


def test_columns_and_their_entries() -> None:
    x = casadi.SX.sym("x")
    there, back = column([x, 2.0]), entries(column([x, 2.0]))
    assert there.shape == (2, 1) and back[1] == 2.0 and isinstance(back[1], float)
    assert casadi.is_equal(back[0], x)
    assert column([]).shape == (0, 1)


def test_halves_are_rounded_towards_zero() -> None:
    function = casadi.Function("f", [X], [rounded(X)])
    for value in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 0.49999999999999994, -0.7, 3.2, 7.0, -7.0):
        assert float(function(value)) == math.copysign(math.ceil(abs(value) - 0.5), value), value


def test_infinite_bounds_are_left_out() -> None:
    function = casadi.Function("f", [X], [clipped(X, -1.0, 2.0), clipped(X, -math.inf, math.inf)])
    assert [float(each) for each in function(3.0)] == [2.0, 3.0]
    assert [float(each) for each in function(-3.0)] == [-1.0, -3.0]
    assert str(clipped(X, -math.inf, math.inf)) == "x"


def test_any_entry_that_is_not_zero_counts() -> None:
    function = casadi.Function("f", [X, Y], [any_true(casadi.vertcat(X, Y))])
    assert [float(function(*at)) for at in ((0.0, 0.0), (0.0, -1.0), (2.0, 0.0))] == [0.0, 1.0, 1.0]
