"""Sines, angles and hyperbolic tangents of lanes, by polynomials; errors below two ulps.

The polynomials are minimax ones for the relative error, 2⁻⁵⁷ and smaller.
"""

from __future__ import annotations

from rpctl.kernels.lanes import Lanes, Value

# An angle beyond this has no sine (NaN). Below, its number of quarter turns has 20 bits, and times
# a part of π/2 of 33 bits it is exact.
LARGEST_ANGLE = 2.0**20
QUARTERS = float.fromhex("0x1.45f306dc9c883p-1")  # 2/π
PARTS = tuple(  # of π/2, the first three of 33 bits
    float.fromhex(x)
    for x in (
        "0x1.921fb54400000p+0",
        "0x1.0b4611a600000p-34",
        "0x1.3198a2e000000p-69",
        "0x1.b839a252049c1p-104",
    )
)
SHIFT = 1.5 * 2.0**52  # added, it rounds to an integer, which its lowest bits then are
SINE = (  # of (sin r − r) / r³ in r²
    -0.1666666666666663,
    0.008333333333322106,
    -0.00019841269829579832,
    2.7557313617914327e-06,
    -2.505074720317812e-08,
    1.5896196808709073e-10,
)
COSINE = (  # of (cos r − 1 + r²/2) / r⁴ in r²
    0.041666666666666595,
    -0.001388888888887304,
    2.4801587288841218e-05,
    -2.7557314176191607e-07,
    2.0875700409915962e-09,
    -1.135851364860184e-11,
)


def sine_cosine(b: Lanes, x: Value) -> tuple[Value, Value]:
    """Return sin x and cos x of angles to ±2²⁰ rad, NaN beyond.

    |x| is reduced to r + tail in [−π/4, π/4] by whole quarter turns [Cody and Waite]: the first
    product and difference are exact, the second's error is kept.

    Args:
        b: Where lines go.
        x: The angle, rad.
    """
    size, sign = b.magnitude(x), b.sign_bit(x)
    small = b.compare("ole", size, b.constant(LARGEST_ANGLE))
    size = b.select(small, size, b.constant(float("nan")))
    shifted = b.add(b.mul(size, b.constant(QUARTERS)), b.constant(SHIFT))
    quarter, turns = b.bits(shifted), b.sub(shifted, b.constant(SHIFT))
    r, tail = _reduce(b, size, turns)
    square = b.mul(r, r)
    cubic = b.mul(b.mul(r, square), b.horner(square, SINE))
    sine = b.add(r, b.add(tail, cubic))
    cosine = _cosine(b, r, tail, square)
    swapped = b.equal(b.combine("and", quarter, b.integer(1)), b.integer(1))
    half = b.combine("shl", quarter, b.integer(62))  # bit 1 becomes the sign
    next_half = b.combine("shl", b.combine("add", quarter, b.integer(1)), b.integer(62))
    highest = b.integer(-(2**63))
    sine_sign = b.combine("xor", sign, b.combine("and", half, highest))
    return (
        b.flip_sign(b.select(swapped, cosine, sine), sine_sign),
        b.flip_sign(b.select(swapped, sine, cosine), b.combine("and", next_half, highest)),
    )


def _reduce(b: Lanes, x: Value, turns: Value) -> tuple[Value, Value]:
    """Return x less so many quarter turns: a number, and what it lacks."""
    products = [b.mul(turns, b.constant(part)) for part in PARTS]
    first = b.sub(x, products[0])
    r = b.sub(first, products[1])
    back = b.sub(r, first)
    lost = b.sub(b.sub(first, b.sub(r, back)), b.add(products[1], back))
    rest = b.sub(lost, products[2])
    total = b.add(r, rest)
    return total, b.sub(b.add(b.sub(r, total), rest), products[3])


def _cosine(b: Lanes, r: Value, tail: Value, square: Value) -> Value:
    """Return cos(r + tail); what 1 − r²/2 loses is kept."""
    one, half = b.constant(1.0), b.mul(square, b.constant(0.5))
    main = b.sub(one, half)
    quartic = b.mul(b.mul(square, square), b.horner(square, COSINE))
    lost = b.sub(b.sub(one, main), half)
    return b.add(main, b.add(lost, b.sub(quartic, b.mul(r, tail))))


PI = (3.141592653589793, 1.2246467991473532e-16)  # and what it lacks, as below
HALF_PI = (1.5707963267948966, 6.123233995736766e-17)
QUARTER_PI = (0.7853981633974483, 3.061616997868383e-17)
THREE_QUARTERS_PI = (2.356194490192345, 9.184850993605148e-17)
LARGEST_SIDE = 2.0**1020  # above, sums overflow
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


def arcsine(b: Lanes, x: Value) -> Value:
    """Return the angle in [−π/2, π/2] of a sine; NaN beyond ±1."""
    one = b.constant(1.0)
    return arctangent_2(b, x, b.sqrt(b.mul(b.sub(one, x), b.add(one, x))))


def _finite(b: Lanes, width: Value, height: Value) -> tuple[Value, Value]:
    """Return sides of the same angle whose sum is finite, where one at least is."""
    large = b.constant(LARGEST_SIDE)
    huge = b.logic("or", b.compare("ogt", width, large), b.compare("ogt", height, large))
    scale = b.select(huge, b.constant(2.0**-4), b.constant(1.0))
    width, height = b.mul(width, scale), b.mul(height, scale)
    infinity, one = b.constant(float("inf")), b.constant(1.0)
    flags = (b.compare("oeq", side, infinity) for side in (width, height))
    both = b.logic("and", *flags)
    return b.select(both, one, width), b.select(both, one, height)


ALL_ONE = 20.0  # beyond, the hyperbolic tangent is 1
PER_LOG_2 = 1.4426950408889634  # 1 / ln 2
LOG_2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))
SHIFT_BITS = 0x4338000000000000
ONE_BITS, FRACTION_BITS = 0x3FF0000000000000, 52
EXPONENTIAL = (  # of (eʳ − 1 − r) / r² in r, for |r| to ½ ln 2; error 2⁻⁶¹ of eʳ − 1
    0.5,
    0.16666666666666677,
    0.041666666666666505,
    0.008333333333321608,
    0.0013888888888962923,
    0.00019841269886207785,
    2.4801587171800865e-05,
    2.7557244104402924e-06,
    2.7557402975204437e-07,
    2.5109081318189564e-08,
    2.0875317985455843e-09,
)


def hyperbolic_tangent(b: Lanes, x: Value) -> Value:
    """Return tanh x."""
    size, bound = b.magnitude(x), b.constant(ALL_ONE)
    size = b.select(b.compare("ogt", size, bound), bound, size)
    e = _exponential_less_1(b, b.add(size, size))
    return b.flip_sign(b.div(e, b.add(e, b.constant(2.0))), b.sign_bit(x))


def _exponential_less_1(b: Lanes, x: Value) -> Value:
    """Return eˣ − 1 of x from 0 to 40, of small x to the last digits."""
    shifted = b.add(b.mul(x, b.constant(PER_LOG_2)), b.constant(SHIFT))
    number = b.sub(shifted, b.constant(SHIFT))
    high = b.sub(x, b.mul(number, b.constant(LOG_2[0])))
    low = b.mul(number, b.constant(LOG_2[1]))
    r = b.sub(high, low)  # x less a number of ln 2
    tail = b.sub(b.sub(high, r), low)
    bent = b.mul(b.mul(r, r), b.horner(r, EXPONENTIAL))
    part = b.add(r, b.add(tail, bent))
    exponent = b.combine("sub", b.bits(shifted), b.integer(SHIFT_BITS))
    exponent = b.combine("shl", exponent, b.integer(FRACTION_BITS))
    scale = b.from_bits(b.combine("add", exponent, b.integer(ONE_BITS)))  # 2 to that number
    return b.add(b.mul(scale, part), b.sub(scale, b.constant(1.0)))
