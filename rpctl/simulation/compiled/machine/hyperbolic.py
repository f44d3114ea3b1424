"""Hyperbolic functions of lanes and their inverses; errors of about two ulps."""

from __future__ import annotations

from rpctl.simulation.compiled.machine.exponential import (
    exponential,
    exponential_less_1,
    logarithm,
    logarithm_1_plus,
)
from rpctl.simulation.compiled.machine.lanes import Lanes, Value

ALL_ONE = 22.0  # beyond, the hyperbolic tangent is 1
LARGE = 40.0  # beyond, e⁻ˣ does not count beside eˣ
FLAT = 2.0**28  # beyond, 1 does not count beside x²
LOG_2 = 0.6931471805599453


def hyperbolic_tangent(b: Lanes, x: Value) -> Value:
    """Return tanh x."""
    size, bound = b.magnitude(x), b.constant(ALL_ONE)
    size = b.select(b.compare("ogt", size, bound), bound, size)
    e = exponential_less_1(b, b.add(size, size))
    return b.flip_sign(b.div(e, b.add(e, b.constant(2.0))), b.sign_bit(x))


def hyperbolic_sine(b: Lanes, x: Value) -> Value:
    """Return sinh x."""
    size, one, half = b.magnitude(x), b.constant(1.0), b.constant(0.5)
    e = exponential_less_1(b, _at_most(b, size, LARGE))
    near = b.mul(half, b.add(e, b.div(e, b.add(e, one))))
    return b.flip_sign(_far(b, size, near), b.sign_bit(x))


def hyperbolic_cosine(b: Lanes, x: Value) -> Value:
    """Return cosh x."""
    size = b.magnitude(x)
    e = exponential(b, _at_most(b, size, LARGE))
    near = b.mul(b.constant(0.5), b.add(e, b.div(b.constant(1.0), e)))
    return _far(b, size, near)


def inverse_hyperbolic_sine(b: Lanes, x: Value) -> Value:
    """Return arsinh x."""
    size, one = b.magnitude(x), b.constant(1.0)
    square = b.mul(size, size)
    root = b.sqrt(b.add(square, one))
    near = logarithm_1_plus(b, b.add(size, b.div(square, b.add(one, root))))
    return b.flip_sign(_flat(b, size, near), b.sign_bit(x))


def inverse_hyperbolic_cosine(b: Lanes, x: Value) -> Value:
    """Return arcosh x; NaN below 1."""
    above = b.sub(x, b.constant(1.0))
    root = b.sqrt(b.add(b.add(above, above), b.mul(above, above)))
    found = _flat(b, x, logarithm_1_plus(b, b.add(above, root)))
    below = b.compare("olt", x, b.constant(1.0))
    return b.select(below, b.constant(float("nan")), found)


def inverse_hyperbolic_tangent(b: Lanes, x: Value) -> Value:
    """Return artanh x; NaN beyond ±1."""
    size = b.magnitude(x)
    ratio = b.div(b.add(size, size), b.sub(b.constant(1.0), size))
    return b.flip_sign(b.mul(b.constant(0.5), logarithm_1_plus(b, ratio)), b.sign_bit(x))


def _at_most(b: Lanes, x: Value, bound: float) -> Value:
    return b.select(b.compare("ogt", x, b.constant(bound)), b.constant(bound), x)


def _far(b: Lanes, size: Value, near: Value) -> Value:
    """Return ½ eˣ beyond where it is all there is; its root is squared: eˣ may be infinite."""
    root = exponential(b, b.mul(size, b.constant(0.5)))
    far = b.mul(b.mul(b.constant(0.5), root), root)
    return b.select(b.compare("ogt", size, b.constant(LARGE)), far, near)


def _flat(b: Lanes, size: Value, near: Value) -> Value:
    """Return ln 2x beyond where it is all there is."""
    far = b.add(logarithm(b, size), b.constant(LOG_2))
    return b.select(b.compare("ogt", size, b.constant(FLAT)), far, near)
