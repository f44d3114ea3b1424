"""Exponentials, logarithms and powers of lanes, by polynomials; errors of about one ulp."""

from __future__ import annotations

from rpctl.simulation.compiled.machine.lanes import Lanes, Value

PER_LOG_2 = 1.4426950408889634  # 1 / ln 2
LOG_2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))
SHIFT = 1.5 * 2.0**52  # added, it rounds to an integer, which its lowest bits then are
SHIFT_BITS = 0x4338000000000000
ONE_BITS, FRACTION_BITS = 0x3FF0000000000000, 52
ROOT_HALF_BITS = 0x3FE6A09E667F3BCD  # of √½: mantissas lie from √½ to √2
INFINITY = float("inf")
SMALLEST = 2.0**-1022  # normal number
OVERFLOW, UNDERFLOW = 710.0, -746.0  # beyond, exp is infinite or 0
LARGE = 40.0  # beyond, 1 does not count beside exp
SPLITTER = 2.0**27 + 1.0  # halves the digits of a number [Dekker]
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
LOGARITHM = (  # of (2 artanh s − 2 s) / s³ in s², for |s| to (√2 − 1) / (√2 + 1); error 2⁻⁶⁷
    0.6666666666666666,
    0.40000000000006253,
    0.2857142856908449,
    0.22222222647006337,
    0.18181775648766638,
    0.15387091489292593,
    0.1325010162379832,
    0.1325147943496138,
)


def exponential(b: Lanes, x: Value) -> Value:
    """Return eˣ, also where it is subnormal."""
    return _exponential(b, x, b.constant(0.0))


def exponential_less_1(b: Lanes, x: Value) -> Value:
    """Return eˣ − 1, of small x to the last digits."""
    near = _clamp(b, x, -LARGE, LARGE)
    part, _, power = _reduced(b, near, b.constant(0.0))
    scale = _power_of_2(b, power)
    sum_ = b.add(b.mul(scale, part), b.sub(scale, b.constant(1.0)))
    found = b.select(b.compare("ogt", x, b.constant(LARGE)), exponential(b, x), sum_)
    return b.select(b.compare("oeq", x, b.constant(0.0)), x, found)


def logarithm(b: Lanes, x: Value) -> Value:
    """Return ln x: −∞ at 0, NaN below."""
    power, f = _split(b, x)
    s = b.div(f, b.add(f, b.constant(2.0)))
    square = b.mul(s, s)
    half = b.mul(b.constant(0.5), b.mul(f, f))
    rest = b.mul(s, b.add(half, b.mul(square, b.horner(square, LOGARITHM))))
    low = b.add(rest, b.mul(power, b.constant(LOG_2[1])))
    found = b.sub(b.mul(power, b.constant(LOG_2[0])), b.sub(b.sub(half, low), f))
    return _at_the_ends(b, x, found)


def logarithm_1_plus(b: Lanes, x: Value) -> Value:
    """Return ln(1 + x), of small x to the last digits."""
    one = b.constant(1.0)
    whole, lost = two_sum(b, one, x)
    correction = b.div(lost, whole)
    no_number = b.compare("uno", correction, correction)
    correction = b.select(no_number, b.constant(0.0), correction)
    found = b.add(logarithm(b, whole), correction)
    return b.select(b.compare("oeq", x, b.constant(0.0)), x, found)


def power(b: Lanes, x: Value, y: Value) -> Value:
    """Return xʸ, its special cases as in C; NaN of x < 0 where y is no integer.

    The logarithm has twice the digits in its largest part: the error is one ulp while |y ln x| is
    below 50, and grows to 8 at the ends.

    Args:
        b: Where lines go.
        x: The base.
        y: The exponent.
    """
    zero, one, size = b.constant(0.0), b.constant(1.0), b.magnitude(x)
    high, low = _long_logarithm(b, size)
    high = _at_the_ends(b, size, high)
    product, lost = two_product(b, y, high)
    lost = b.add(lost, b.mul(y, low))
    moderate = b.compare("olt", b.magnitude(product), b.constant(-UNDERFLOW))
    lost = b.select(moderate, lost, zero)
    found = b.select(b.compare("oeq", size, one), one, _exponential(b, product, lost))
    whole, odd = _parity(b, y)
    below = b.logic("and", b.compare("olt", x, zero), b.compare("ogt", x, b.constant(-INFINITY)))
    rootless = b.logic("and", below, b.logic("xor", whole, b.true))
    found = b.select(rootless, b.constant(float("nan")), found)
    sign = b.select(odd, x, zero)
    found = b.flip_sign(found, b.sign_bit(sign))
    certain = b.logic("or", b.compare("oeq", y, zero), b.compare("oeq", x, one))
    unknown = b.logic("or", b.compare("uno", x, x), b.compare("uno", y, y))
    found = b.select(unknown, b.constant(float("nan")), found)
    return b.select(certain, one, found)


def two_sum(b: Lanes, x: Value, y: Value) -> tuple[Value, Value]:
    """Return x + y and what it lacks [Knuth].

    Args:
        b: Where lines go.
        x: One number.
        y: The other.
    """
    whole = b.add(x, y)
    back = b.sub(whole, x)
    return whole, b.add(b.sub(x, b.sub(whole, back)), b.sub(y, back))


def two_product(b: Lanes, x: Value, y: Value) -> tuple[Value, Value]:
    """Return x y and what it lacks [Dekker], which is NaN where a factor exceeds 2⁹⁹⁶.

    Args:
        b: Where lines go.
        x: One factor.
        y: The other.
    """
    whole = b.mul(x, y)
    x_high, x_low = _halves(b, x)
    y_high, y_low = _halves(b, y)
    lost = b.sub(b.mul(x_high, y_high), whole)
    lost = b.add(lost, b.mul(x_high, y_low))
    lost = b.add(lost, b.mul(x_low, y_high))
    return whole, b.add(lost, b.mul(x_low, y_low))


def _halves(b: Lanes, x: Value) -> tuple[Value, Value]:
    wide = b.mul(x, b.constant(SPLITTER))
    high = b.sub(wide, b.sub(wide, x))
    return high, b.sub(x, high)


def _clamp(b: Lanes, x: Value, low: float, high: float) -> Value:
    """Return x within bounds; NaN stays."""
    x = b.select(b.compare("ogt", x, b.constant(high)), b.constant(high), x)
    return b.select(b.compare("olt", x, b.constant(low)), b.constant(low), x)


def _reduced(b: Lanes, x: Value, more: Value) -> tuple[Value, Value, Value]:
    """Return eʳ − 1, the number k and the integer k, where x + more = r + k ln 2."""
    shifted = b.add(b.mul(x, b.constant(PER_LOG_2)), b.constant(SHIFT))
    number = b.sub(shifted, b.constant(SHIFT))
    high = b.sub(x, b.mul(number, b.constant(LOG_2[0])))
    low = b.sub(b.mul(number, b.constant(LOG_2[1])), more)
    r = b.sub(high, low)
    tail = b.sub(b.sub(high, r), low)
    bent = b.mul(b.mul(r, r), b.horner(r, EXPONENTIAL))
    integer = b.combine("sub", b.bits(shifted), b.integer(SHIFT_BITS))
    return b.add(r, b.add(tail, bent)), number, integer


def _exponential(b: Lanes, x: Value, more: Value) -> Value:
    """Return e to the power x + more; it is scaled in two steps, the first of them exact."""
    part, _, power_ = _reduced(b, _clamp(b, x, UNDERFLOW, OVERFLOW), more)
    # Shifted as a positive number: AVX2 has no arithmetic shift of 64 bits.
    raised = b.combine("lshr", b.combine("add", power_, b.integer(4096)), b.integer(1))
    half = b.combine("sub", raised, b.integer(2048))
    scaled = b.mul(b.add(part, b.constant(1.0)), _power_of_2(b, half))
    return b.mul(scaled, _power_of_2(b, b.combine("sub", power_, half)))


def _power_of_2(b: Lanes, k: Value) -> Value:
    """Return 2ᵏ of integers from −1022 to 1023."""
    exponent = b.combine("shl", k, b.integer(FRACTION_BITS))
    return b.from_bits(b.combine("add", exponent, b.integer(ONE_BITS)))


def _split(b: Lanes, x: Value) -> tuple[Value, Value]:
    """Return k and f with x = 2ᵏ (1 + f), 1 + f from √½ to √2."""
    tiny = b.compare("olt", x, b.constant(SMALLEST))
    x = b.mul(x, b.select(tiny, b.constant(2.0**54), b.constant(1.0)))
    bits = b.bits(x)
    above = b.combine("sub", bits, b.integer(ROOT_HALF_BITS - (1024 << FRACTION_BITS)))
    k = b.combine("sub", b.combine("lshr", above, b.integer(FRACTION_BITS)), b.integer(1024))
    mantissa = b.combine("sub", bits, b.combine("shl", k, b.integer(FRACTION_BITS)))
    number = b.from_bits(b.combine("add", k, b.integer(SHIFT_BITS)))
    shift = b.select(tiny, b.constant(SHIFT + 54.0), b.constant(SHIFT))
    return b.sub(number, shift), b.sub(b.from_bits(mantissa), b.constant(1.0))


def _at_the_ends(b: Lanes, x: Value, logarithm_: Value) -> Value:
    """Return a logarithm that is right at 0, ∞, NaN and below 0, too."""
    infinity, zero = b.constant(float("inf")), b.constant(0.0)
    found = b.select(b.compare("olt", x, infinity), logarithm_, x)
    found = b.select(b.compare("oeq", x, zero), b.constant(float("-inf")), found)
    return b.select(b.compare("olt", x, zero), b.constant(float("nan")), found)


def _long_logarithm(b: Lanes, x: Value) -> tuple[Value, Value]:
    """Return ln x and what it lacks."""
    k, f = _split(b, x)
    under, under_low = two_sum(b, f, b.constant(2.0))
    s = b.div(f, under)
    product, lost = two_product(b, s, under)
    rest = b.sub(b.sub(b.sub(f, product), lost), b.mul(s, under_low))
    s_low = b.div(rest, under)
    square = b.mul(s, s)
    cubic = b.mul(b.mul(s, square), b.horner(square, LOGARITHM))
    high, low = two_sum(b, b.mul(k, b.constant(LOG_2[0])), b.add(s, s))
    low = b.add(low, b.add(b.add(s_low, s_low), b.mul(k, b.constant(LOG_2[1]))))
    whole, more = two_sum(b, high, cubic)
    return two_sum(b, whole, b.add(more, low))


def _parity(b: Lanes, y: Value) -> tuple[Value, Value]:
    """Return flags: whether a number is an integer, and whether an odd one."""
    half = b.mul(y, b.constant(0.5))
    whole = b.compare("oeq", b.floor(y), y)
    return whole, b.logic("and", whole, b.compare("une", b.floor(half), half))
