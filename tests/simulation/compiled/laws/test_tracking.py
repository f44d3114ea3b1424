"""Angles that wrap, and the rate of whatever depends on moving quantities."""

from __future__ import annotations

import math

import casadi
import numpy as np

from rpctl.control.error import wrap
from rpctl.simulation.compiled.laws.tracking import Moving, wrapped

X, Y = casadi.SX.sym("x"), casadi.SX.sym("y")


def test_angles_are_wrapped_as_in_python() -> None:
    function = casadi.Function("f", [X], [wrapped(X)])
    turns = [k * math.pi for k in range(-5, 6)]
    for angle in (*turns, *np.nextafter(turns, 9.0), *np.nextafter(turns, -9.0), 0.3, -2.9, 40.0):
        assert abs(float(function(angle)) - wrap(float(angle))) < 1e-14, angle


def test_a_quantity_has_the_rate_of_what_it_depends_on() -> None:
    """d(x y)/dt = ẋ y + x ẏ, with ẏ = x."""
    moving = Moving()
    x = moving.add(X, Y)
    y = casadi.SX.sym("symbol")
    moving.follow(y, 2.0 * X, x)
    value, rate = moving.with_rate(x * y)
    function = casadi.Function("f", [X, Y], [value, rate])
    assert [float(each) for each in function(3.0, 5.0)] == [18.0, 5.0 * 6.0 + 3.0 * 3.0]
