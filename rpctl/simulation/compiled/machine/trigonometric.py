"""Sine, cosine and tangent of lanes, by polynomials; errors below one unit in the last place.

The polynomials are minimax ones for the relative error, 2⁻⁵⁷ and smaller.
"""

from __future__ import annotations

from rpctl.simulation.compiled.machine.lanes import Lanes, Value

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
