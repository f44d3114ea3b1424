"""LLVM's language, a line at a time: values of several lanes, each lane computed as if alone.

Every line is one IEEE operation in double precision, rounded to nearest. None carries a flag that
lets LLVM contract, reorder or approximate, and none calls a library: a lane's bits are the same for
any number of lanes and on any processor (but for the sign and payload of NaN, which IEEE leaves
open).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

ROUNDER = 2.0**52  # numbers this large are integers; added and subtracted, it rounds to one
Value = str  # a name such as %v7, or a constant


class Lanes:
    """The lines of one function, and what they may hold.

    Args:
        lanes: How many numbers a value has; 1 makes scalars.
    """

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        self.lines: list[str] = []
        self.real, self.whole, self.flag = (self._type(x) for x in ("double", "i64", "i1"))
        self._count = 0
        self._constants: dict[bytes, Value] = {}

    def _type(self, of: str) -> str:
        return of if self.lanes == 1 else f"<{self.lanes} x {of}>"

    def _each(self, of: str, value: str) -> str:
        return value if self.lanes == 1 else f"<{', '.join([f'{of} {value}'] * self.lanes)}>"

    def emit(self, line: str) -> Value:
        """Append a line that defines a value; return its name."""
        self._count += 1
        name = f"%v{self._count}"
        self.lines.append(f"{name} = {line}")
        return name

    def constant(self, value: float) -> Value:
        """Return a number that all lanes have."""
        key = struct.pack(">d", value)
        if key not in self._constants:
            self._constants[key] = self._each("double", f"0x{key.hex().upper()}")
        return self._constants[key]

    def integer(self, value: int) -> Value:
        """Return an integer of 64 bits that all lanes have."""
        return self._each("i64", str(value))

    def add(self, x: Value, y: Value) -> Value:
        """Return x + y."""
        return self.emit(f"fadd {self.real} {x}, {y}")

    def sub(self, x: Value, y: Value) -> Value:
        """Return x − y."""
        return self.emit(f"fsub {self.real} {x}, {y}")

    def mul(self, x: Value, y: Value) -> Value:
        """Return x y."""
        return self.emit(f"fmul {self.real} {x}, {y}")

    def div(self, x: Value, y: Value) -> Value:
        """Return x / y."""
        return self.emit(f"fdiv {self.real} {x}, {y}")

    def neg(self, x: Value) -> Value:
        """Return −x, also of zero."""
        return self.emit(f"fneg {self.real} {x}")

    def sqrt(self, x: Value) -> Value:
        """Return the square root, correctly rounded; NaN below zero."""
        name = "llvm.sqrt.f64" if self.lanes == 1 else f"llvm.sqrt.v{self.lanes}f64"
        return self.emit(f"call {self.real} @{name}({self.real} {x})")

    def compare(self, how: str, x: Value, y: Value) -> Value:
        """Return a flag.

        Args:
            how: ``"olt"``, ``"ole"``, ``"ogt"``, ``"oeq"``, false where one is NaN; ``"une"`` (not
                equal), true there; ``"uno"``, true there only.
            x: What is compared.
            y: With what.
        """
        return self.emit(f"fcmp {how} {self.real} {x}, {y}")

    def select(self, flag: Value, x: Value, y: Value) -> Value:
        """Return x where a flag is set, y elsewhere, whatever the other one is.

        Args:
            flag: A flag.
            x: A number.
            y: A number.
        """
        return self.emit(f"select {self.flag} {flag}, {self.real} {x}, {self.real} {y}")

    def logic(self, how: str, x: Value, y: Value) -> Value:
        """Return two flags as one.

        Args:
            how: ``"and"``, ``"or"`` or ``"xor"``.
            x: A flag.
            y: A flag.
        """
        return self.emit(f"{how} {self.flag} {x}, {y}")

    def bits(self, x: Value) -> Value:
        """Return a number's bits as an integer."""
        return self.emit(f"bitcast {self.real} {x} to {self.whole}")

    def from_bits(self, x: Value) -> Value:
        """Return the number whose bits an integer has."""
        return self.emit(f"bitcast {self.whole} {x} to {self.real}")

    def combine(self, how: str, x: Value, y: Value) -> Value:
        """Return an operation on integers.

        Args:
            how: LLVM's name of it, such as ``"and"``, ``"add"`` or ``"shl"``.
            x: An integer.
            y: An integer.
        """
        return self.emit(f"{how} {self.whole} {x}, {y}")

    def equal(self, x: Value, y: Value) -> Value:
        """Return a flag: whether two integers are the same."""
        return self.emit(f"icmp eq {self.whole} {x}, {y}")

    @property
    def true(self) -> Value:
        """A flag that all lanes have set."""
        return self._each("i1", "true")

    def nearest(self, x: Value) -> Value:
        """Return the nearest integer, of two as near the even one; with the sign of x."""
        size, large = self.magnitude(x), self.constant(ROUNDER)
        rounded = self.sub(self.add(size, large), large)
        whole = self.select(self.compare("olt", size, large), rounded, size)
        return self.flip_sign(whole, self.sign_bit(x))

    def floor(self, x: Value) -> Value:
        """Return the largest integer that is not above x."""
        nearest = self.nearest(x)
        less = self.sub(nearest, self.constant(1.0))
        return self.select(self.compare("ogt", nearest, x), less, nearest)

    def horner(self, x: Value, coefficients: Sequence[float]) -> Value:
        """Return a polynomial, its coefficients from that of the constant on."""
        *rest, last = coefficients
        value = self.constant(last)
        for each in reversed(rest):
            value = self.add(self.mul(value, x), self.constant(each))
        return value

    def magnitude(self, x: Value) -> Value:
        """Return |x|, also of NaN and −0."""
        return self.from_bits(self.combine("and", self.bits(x), self.integer(2**63 - 1)))

    def sign_bit(self, x: Value) -> Value:
        """Return the sign as an integer whose other bits are zero."""
        return self.combine("and", self.bits(x), self.integer(-(2**63)))

    def flip_sign(self, x: Value, sign: Value) -> Value:
        """Return x, negated where a sign bit is set."""
        return self.from_bits(self.combine("xor", self.bits(x), sign))
