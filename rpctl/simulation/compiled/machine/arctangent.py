"""Angles of lanes from tangents, sines and cosines, by a polynomial; errors below two ulps."""

from __future__ import annotations

from rpctl.simulation.compiled.machine.lanes import Lanes, Value

PI = (3.141592653589793, 1.2246467991473532e-16)  # and what it lacks, as below
HALF_PI = (1.5707963267948966, 6.123233995736766e-17)
QUARTER_PI = (0.7853981633974483, 3.061616997868383e-17)
THREE_QUARTERS_PI = (2.356194490192345, 9.184850993605148e-17)
LARGE = 2.0**1020  # above, sums overflow
ARCTANGENT = (  # of (atan t − t) / t³ in t², for |t| to ½; relative error 2⁻⁵⁸
    -0.3333333333333298,
    0.19999999999903129,
    -0.1428571427638711,
    0.1111111065966927,
    -0.0909089624511477,
    0.07692073912559357,
    -0.06663810566301993,
    0.05858298284619217,
    -0.051220018994520444,
    0.04186490797495365,
    -0.027434696659516054,
    0.010116648725585804,
)


def arctangent_2(b: Lanes, y: Value, x: Value) -> Value:
    """Return the angle of the point (x, y), also of infinite ones and zeros, as IEEE 754 has it.

    Args:
        b: Where lines go.
        y: Second coordinate.
        x: First coordinate.
    """
    width, height = _finite(b, b.magnitude(x), b.magnitude(y))
    steep = b.compare("ogt", height, b.add(width, width))
    middle = b.compare("ogt", b.add(height, height), width)
    # The angle less π/2, π/4 or 0 has a tangent to ½; sides within twice each other have an exact
    # difference.
    over = b.select(middle, b.sub(height, width), height)
    under = b.select(middle, b.add(height, width), width)
    over, under = b.select(steep, b.neg(width), over), b.select(steep, height, under)
    zero = b.constant(0.0)
    t = b.div(over, b.select(b.compare("oeq", under, zero), b.constant(1.0), under))
    square = b.mul(t, t)
    angle = b.add(t, b.mul(b.mul(t, square), b.horner(square, ARCTANGENT)))
    sign = b.sign_bit(x)
    behind = b.emit(f"icmp ne {b.whole} {sign}, {b.integer(0)}")
    high, low = (
        b.select(
            steep,
            b.constant(HALF_PI[k]),
            b.select(
                middle,
                b.select(behind, b.constant(THREE_QUARTERS_PI[k]), b.constant(QUARTER_PI[k])),
                b.select(behind, b.constant(PI[k]), zero),
            ),
        )
        for k in (0, 1)
    )
    whole = b.add(high, b.add(b.flip_sign(angle, sign), low))
    return b.flip_sign(b.magnitude(whole), b.sign_bit(y))


def arctangent(b: Lanes, x: Value) -> Value:
    """Return the angle in [−π/2, π/2] of a tangent."""
    return arctangent_2(b, x, b.constant(1.0))


def arcsine(b: Lanes, x: Value) -> Value:
    """Return the angle in [−π/2, π/2] of a sine; NaN beyond ±1."""
    return arctangent_2(b, x, _leg(b, x))


def arccosine(b: Lanes, x: Value) -> Value:
    """Return the angle in [0, π] of a cosine; NaN beyond ±1."""
    return arctangent_2(b, _leg(b, x), x)


def _leg(b: Lanes, x: Value) -> Value:
    """Return √(1 − x²)."""
    one = b.constant(1.0)
    return b.sqrt(b.mul(b.sub(one, x), b.add(one, x)))


def _finite(b: Lanes, width: Value, height: Value) -> tuple[Value, Value]:
    """Return sides of the same angle whose sum is finite, where one at least is."""
    large = b.constant(LARGE)
    huge = b.logic("or", b.compare("ogt", width, large), b.compare("ogt", height, large))
    scale = b.select(huge, b.constant(2.0**-4), b.constant(1.0))
    width, height = b.mul(width, scale), b.mul(height, scale)
    infinity, one = b.constant(float("inf")), b.constant(1.0)
    flags = (b.compare("oeq", side, infinity) for side in (width, height))
    both = b.logic("and", *flags)
    return b.select(both, one, width), b.select(both, one, height)
