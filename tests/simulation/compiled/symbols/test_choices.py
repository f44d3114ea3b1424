"""Rounding, wrapping and choosing in symbols, where the right answer hangs by a hair."""

from __future__ import annotations

import math

import casadi
import numpy as np

from rpctl.control.error import wrap
from rpctl.simulation.compiled.laws.tracking import Moving, wrapped
from rpctl.simulation.compiled.symbols.choices import any_nonzero, clipped, rounded

X, Y = casadi.SX.sym("x"), casadi.SX.sym("y")


def test_halves_are_rounded_to_the_even_integer() -> None:
    function = casadi.Function("f", [X], [rounded(X)])
    for value in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 0.49999999999999994, -0.7, 3.2, 7.0, -7.0):
        assert float(function(value)) == round(value), value


def test_angles_are_wrapped_as_in_python() -> None:
    function = casadi.Function("f", [X], [wrapped(X)])
    turns = [k * math.pi for k in range(-5, 6)]
    for angle in (*turns, *np.nextafter(turns, 9.0), *np.nextafter(turns, -9.0), 0.3, -2.9, 40.0):
        assert abs(float(function(angle)) - wrap(float(angle))) < 1e-14, angle


def test_infinite_bounds_are_left_out() -> None:
    function = casadi.Function("f", [X], [clipped(X, -1.0, 2.0), clipped(X, -math.inf, math.inf)])
    assert [float(each) for each in function(3.0)] == [2.0, 3.0]
    assert [float(each) for each in function(-3.0)] == [-1.0, -3.0]
    assert str(clipped(X, -math.inf, math.inf)) == "x"


def test_any_entry_that_is_not_zero_counts() -> None:
    function = casadi.Function("f", [X, Y], [any_nonzero(casadi.vertcat(X, Y))])
    assert [float(function(*at)) for at in ((0.0, 0.0), (0.0, -1.0), (2.0, 0.0))] == [0.0, 1.0, 1.0]


def test_a_quantity_has_the_rate_of_what_it_depends_on() -> None:
    """d(x y)/dt = ẋ y + x ẏ, with ẏ = x."""
    moving = Moving()
    x = moving.add(X, Y)
    y = casadi.SX.sym("symbol")
    moving.follow(y, 2.0 * X, x)
    value, rate = moving.with_rate(x * y)
    function = casadi.Function("f", [X, Y], [value, rate])
    assert [float(each) for each in function(3.0, 5.0)] == [18.0, 5.0 * 6.0 + 3.0 * 3.0]
