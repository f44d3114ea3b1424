"""Each operation that a CasADi expression may hold, as lines over lanes.

A condition is a number, true unless it is 0 (so NaN is true). ``casadi.if_else(c, x, y)`` is the
sum of two ``IF_ELSE_ZERO``; both x and y are computed, but each is taken by a select, so that an
infinity or NaN in the one that does not count does no harm.
"""

from __future__ import annotations

from collections.abc import Callable

from rpctl.errors import RpctlError
from rpctl.kernels.elementary import arcsine, arctangent_2, hyperbolic_tangent, sine_cosine
from rpctl.kernels.lanes import Lanes, Value

CONDITIONS = ("AND", "OR", "NOT", "IF_ELSE_ZERO")
TURNS = ("SIN", "COS")  # of one angle, by name, made together


class LaneOperations:
    """Appends operations to the lines of one function.

    A sine and cosine of one angle go together. A comparison's flag is kept, so that a condition
    need not be made of a number again, and the two sides of an ``if_else`` become one select.

    Args:
        b: Where lines go.
    """

    def __init__(self, b: Lanes) -> None:
        self.b = b
        self._angles: dict[Value, tuple[Value, Value]] = {}
        self._flags: dict[Value, Value] = {}  # of numbers that are 1 or 0
        self._opposite: dict[Value, Value] = {}  # of flags
        self._sides: dict[Value, tuple[Value, Value]] = {}  # flag and number, where else 0

    def apply(self, op: str, x: Value, y: Value) -> Value:
        """Append an operation and return its value.

        Args:
            op: Its name, as in :class:`Instruction`.
            x: First operand.
            y: Second operand; of an operation with one, anything.

        Raises:
            RpctlError: There is no machine code for the operation.
        """
        if op in TURNS:
            if x not in self._angles:
                self._angles[x] = sine_cosine(self.b, x)
            return self._angles[x][TURNS.index(op)]
        if op in COMPARISONS:
            return self._number(self.b.compare(COMPARISONS[op], x, y))
        if op in ("AND", "OR"):
            return self._number(self.b.logic(op.lower(), self._flag(x), self._flag(y)))
        if op == "NOT":
            return self._not(self._flag(x))
        if op == "IF_ELSE_ZERO":
            return self._side(self._flag(x), y)
        if op == "ADD" and x in self._sides and y in self._sides:
            return self._sum(x, y)
        if op in UNARY:
            return UNARY[op](self.b, x)
        if op in BINARY:
            return BINARY[op](self.b, x, y)
        raise RpctlError(
            f"no machine code for the operation {op}; take the Python loop (backend pinocchio)"
        )

    def _flag(self, x: Value) -> Value:
        """Return whether a number is true: not 0."""
        if x not in self._flags:
            self._flags[x] = self.b.compare("une", x, self.b.constant(0.0))
        return self._flags[x]

    def _number(self, flag: Value) -> Value:
        number = self.b.select(flag, self.b.constant(1.0), self.b.constant(0.0))
        self._flags[number] = flag
        return number

    def _not(self, flag: Value) -> Value:
        if flag not in self._opposite:
            other = self.b.logic("xor", flag, self.b.true)
            self._opposite |= {flag: other, other: flag}
        return self._number(self._opposite[flag])

    def _side(self, flag: Value, x: Value) -> Value:
        side = self.b.select(flag, x, self.b.constant(0.0))
        self._sides[side] = flag, x
        return side

    def _sum(self, x: Value, y: Value) -> Value:
        """Return a sum of two sides; of opposite ones, that which counts, plus 0 as of a sum."""
        (flag, taken), (other, else_) = self._sides[x], self._sides[y]
        if self._opposite.get(flag) != other:
            return self.b.add(x, y)
        return self.b.add(self.b.select(flag, taken, else_), self.b.constant(0.0))


def _sign(b: Lanes, x: Value) -> Value:
    zero = b.constant(0.0)
    positive = b.select(b.compare("ogt", x, zero), b.constant(1.0), x)
    return b.select(b.compare("olt", x, zero), b.constant(-1.0), positive)


def _extreme(how: str) -> Callable[[Lanes, Value, Value], Value]:
    """Return the smaller or larger one; of a number and NaN, the number."""

    def chosen(b: Lanes, x: Value, y: Value) -> Value:
        found = b.select(b.compare(how, x, y), x, y)  # y if x is NaN
        return b.select(b.compare("uno", y, y), x, found)

    return chosen


COMPARISONS = {"LT": "olt", "LE": "ole", "EQ": "oeq", "NE": "une"}
UNARY: dict[str, Callable[[Lanes, Value], Value]] = {
    "ASSIGN": lambda b, x: x,
    "NEG": lambda b, x: b.neg(x),
    "SQRT": lambda b, x: b.sqrt(x),
    "SQ": lambda b, x: b.mul(x, x),
    "TWICE": lambda b, x: b.add(x, x),
    "INV": lambda b, x: b.div(b.constant(1.0), x),
    "FABS": lambda b, x: b.magnitude(x),
    "SIGN": _sign,
    "FLOOR": lambda b, x: b.floor(x),
    "ASIN": arcsine,
    "ATAN": lambda b, x: arctangent_2(b, x, b.constant(1.0)),
    "TAN": lambda b, x: b.div(*sine_cosine(b, x)),
    "TANH": hyperbolic_tangent,
}
BINARY: dict[str, Callable[[Lanes, Value, Value], Value]] = {
    "ADD": lambda b, x, y: b.add(x, y),
    "SUB": lambda b, x, y: b.sub(x, y),
    "MUL": lambda b, x, y: b.mul(x, y),
    "DIV": lambda b, x, y: b.div(x, y),
    "COPYSIGN": lambda b, x, y: b.flip_sign(b.magnitude(x), b.sign_bit(y)),
    "FMIN": _extreme("olt"),
    "FMAX": _extreme("ogt"),
    "ATAN2": arctangent_2,
}
