"""Each operation that a CasADi expression may hold, as lines over lanes.

A condition is a number, true unless it is 0 (so NaN is true). ``casadi.if_else(c, x, y)`` is the
sum of two ``IF_ELSE_ZERO``; both x and y are computed, but each is taken by a select, so that an
infinity or NaN in the one that does not count does no harm.
"""

from __future__ import annotations

from collections.abc import Callable

from rpctl.errors import RpctlError
from rpctl.simulation.compiled.arctangent import arccosine, arcsine, arctangent, arctangent_2
from rpctl.simulation.compiled.exponential import (
    exponential,
    exponential_less_1,
    logarithm,
    logarithm_1_plus,
    power,
)
from rpctl.simulation.compiled.hyperbolic import (
    hyperbolic_cosine,
    hyperbolic_sine,
    hyperbolic_tangent,
    inverse_hyperbolic_cosine,
    inverse_hyperbolic_sine,
    inverse_hyperbolic_tangent,
)
from rpctl.simulation.compiled.lanes import Lanes, Value
from rpctl.simulation.compiled.remainders import length, modulus, remainder
from rpctl.simulation.compiled.trigonometric import sine_cosine


class LaneOperations:
    """Appends operations to the lines of one function; a sine and cosine of one angle go together.

    Args:
        b: Where lines go.
    """

    def __init__(self, b: Lanes) -> None:
        self.b = b
        self._angles: dict[Value, tuple[Value, Value]] = {}

    def apply(self, op: str, x: Value, y: Value) -> Value:
        """Append an operation and return its value.

        Args:
            op: Its name, as in :class:`Instruction`.
            x: First operand.
            y: Second operand; of an operation with one, anything.

        Raises:
            RpctlError: There is no machine code for the operation.
        """
        if op in ("SIN", "COS", "TAN"):
            if x not in self._angles:
                self._angles[x] = sine_cosine(self.b, x)
            sine, cosine = self._angles[x]
            return {"SIN": sine, "COS": cosine}.get(op) or self.b.div(sine, cosine)
        if op in UNARY:
            return UNARY[op](self.b, x)
        if op in BINARY:
            return BINARY[op](self.b, x, y)
        raise RpctlError(
            f"no machine code for the operation {op}; take the Python loop (backend pinocchio)"
        )


def _true(b: Lanes, x: Value) -> Value:
    return b.compare("une", x, b.constant(0.0))


def _false(b: Lanes, x: Value) -> Value:
    return b.compare("oeq", x, b.constant(0.0))


def _comparison(how: str) -> Callable[[Lanes, Value, Value], Value]:
    return lambda b, x, y: b.number(b.compare(how, x, y))


def _sign(b: Lanes, x: Value) -> Value:
    zero = b.constant(0.0)
    positive = b.select(b.compare("ogt", x, zero), b.constant(1.0), x)
    return b.select(b.compare("olt", x, zero), b.constant(-1.0), positive)


def _extreme(how: str) -> Callable[[Lanes, Value, Value], Value]:
    """Return the smaller or larger one; of a number and NaN, the number."""

    def chosen(b: Lanes, x: Value, y: Value) -> Value:
        no_number = b.compare("uno", y, y)
        return b.select(b.logic("or", b.compare(how, x, y), no_number), x, y)

    return chosen


UNARY: dict[str, Callable[[Lanes, Value], Value]] = {
    "ASSIGN": lambda b, x: x,
    "NEG": lambda b, x: b.neg(x),
    "SQRT": lambda b, x: b.sqrt(x),
    "SQ": lambda b, x: b.mul(x, x),
    "TWICE": lambda b, x: b.add(x, x),
    "INV": lambda b, x: b.div(b.constant(1.0), x),
    "NOT": lambda b, x: b.number(_false(b, x)),
    "FABS": lambda b, x: b.magnitude(x),
    "SIGN": _sign,
    "FLOOR": lambda b, x: b.floor(x),
    "CEIL": lambda b, x: b.neg(b.floor(b.neg(x))),
    "ASIN": arcsine,
    "ACOS": arccosine,
    "ATAN": arctangent,
    "EXP": exponential,
    "EXPM1": exponential_less_1,
    "LOG": logarithm,
    "LOG1P": logarithm_1_plus,
    "SINH": hyperbolic_sine,
    "COSH": hyperbolic_cosine,
    "TANH": hyperbolic_tangent,
    "ASINH": inverse_hyperbolic_sine,
    "ACOSH": inverse_hyperbolic_cosine,
    "ATANH": inverse_hyperbolic_tangent,
}
BINARY: dict[str, Callable[[Lanes, Value, Value], Value]] = {
    "ADD": lambda b, x, y: b.add(x, y),
    "SUB": lambda b, x, y: b.sub(x, y),
    "MUL": lambda b, x, y: b.mul(x, y),
    "DIV": lambda b, x, y: b.div(x, y),
    "LT": _comparison("olt"),
    "LE": _comparison("ole"),
    "EQ": _comparison("oeq"),
    "NE": _comparison("une"),
    "AND": lambda b, x, y: b.number(b.logic("and", _true(b, x), _true(b, y))),
    "OR": lambda b, x, y: b.number(b.logic("or", _true(b, x), _true(b, y))),
    "IF_ELSE_ZERO": lambda b, x, y: b.select(_false(b, x), b.constant(0.0), y),
    "COPYSIGN": lambda b, x, y: b.flip_sign(b.magnitude(x), b.sign_bit(y)),
    "FMIN": _extreme("olt"),
    "FMAX": _extreme("ogt"),
    "ATAN2": arctangent_2,
    "POW": power,
    "CONSTPOW": power,
    "FMOD": modulus,
    "REMAINDER": remainder,
    "HYPOT": length,
    "LIFT": lambda b, x, y: x,
}
