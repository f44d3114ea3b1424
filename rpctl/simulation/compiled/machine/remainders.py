"""Integers next to numbers, remainders of divisions and lengths, of lanes."""

from __future__ import annotations

from rpctl.simulation.compiled.machine.exponential import two_product
from rpctl.simulation.compiled.machine.lanes import Lanes, Value

MOST = 2.0**52  # a quotient beyond has no remainder (NaN)


def remainder(b: Lanes, x: Value, y: Value) -> Value:
    """Return x less the nearest multiple of y, exactly; of two as near, the even one.

    Args:
        b: Where lines go.
        x: Dividend; NaN where it is 2⁵² times y or more.
        y: Divisor.
    """
    width = b.magnitude(y)
    rest = _less_multiples(b, x, y, b.nearest(b.div(x, y)))
    # The quotient was rounded, and so may lie on the wrong side of a half.
    size = b.magnitude(rest)
    too_far = b.compare("ogt", b.add(size, size), width)
    nearer = b.flip_sign(b.sub(size, width), b.sign_bit(rest))
    return _with_sign(b, x, b.select(too_far, nearer, rest))


def modulus(b: Lanes, x: Value, y: Value) -> Value:
    """Return x less as many y as it holds, exactly, with the sign of x: C's ``fmod``.

    Args:
        b: Where lines go.
        x: Dividend; NaN where it is 2⁵² times y or more.
        y: Divisor.
    """
    size, width = b.magnitude(x), b.magnitude(y)
    rest = _less_multiples(b, size, width, b.floor(b.div(size, width)))
    negative = b.compare("olt", rest, b.constant(0.0))  # the quotient was rounded up
    rest = b.select(negative, b.add(rest, width), rest)
    return b.flip_sign(rest, b.sign_bit(x))


def length(b: Lanes, x: Value, y: Value) -> Value:
    """Return √(x² + y²), also where squares would overflow or vanish; infinite beats NaN.

    Args:
        b: Where lines go.
        x: One side.
        y: The other.
    """
    x, y = b.magnitude(x), b.magnitude(y)
    larger = b.select(b.compare("ogt", x, y), x, y)
    up, down, one = b.constant(2.0**600), b.constant(2.0**-600), b.constant(1.0)
    huge = b.compare("ogt", larger, b.constant(2.0**500))
    tiny = b.compare("olt", larger, b.constant(2.0**-450))
    scale = b.select(huge, down, b.select(tiny, up, one))
    back = b.select(huge, up, b.select(tiny, down, one))
    x, y = b.mul(x, scale), b.mul(y, scale)
    found = b.mul(b.sqrt(b.add(b.mul(x, x), b.mul(y, y))), back)
    infinity = b.constant(float("inf"))
    flags = (b.compare("oeq", side, infinity) for side in (x, y))
    return b.select(b.logic("or", *flags), infinity, found)


def _less_multiples(b: Lanes, x: Value, y: Value, count: Value) -> Value:
    product, lost = two_product(b, count, y)
    rest = b.sub(b.sub(x, product), lost)
    few = b.compare("olt", b.magnitude(count), b.constant(MOST))
    rest = b.select(few, rest, b.constant(float("nan")))
    infinity = b.constant(float("inf"))
    endless = b.compare("oeq", b.magnitude(y), infinity)
    finite = b.compare("olt", b.magnitude(x), infinity)
    return b.select(b.logic("and", endless, finite), x, rest)


def _with_sign(b: Lanes, x: Value, rest: Value) -> Value:
    """Return a remainder; one of 0 has the sign of the dividend."""
    zero = b.flip_sign(b.constant(0.0), b.sign_bit(x))
    return b.select(b.compare("oeq", rest, b.constant(0.0)), zero, rest)
