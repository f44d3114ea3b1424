"""The numbers of a URDF as exact rationals, or as named symbols with a legend."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import sympy as sp

from rpctl.robot.model import Robot

DIRECTION_TOLERANCE = 1e-9  # an entry of a direction so near to a simple value is that value
FLOAT_DIGITS = 15  # of a float that survive its printing; the rest is rounding
LETTERS = {"mass": "m", "length": "l", "inertia": "I", "gravity": "g"}
UNITS = {"mass": "kg", "length": "m", "inertia": "kg m^2", "gravity": "m/s^2"}
ROOT2, ROOT3 = sp.Symbol("root2"), sp.Symbol("root3")
SIMPLE = {
    0.0: sp.Integer(0),
    0.5: sp.Rational(1, 2),
    math.sqrt(2.0) / 2.0: ROOT2 / 2,
    math.sqrt(3.0) / 2.0: ROOT3 / 2,
    1.0: sp.Integer(1),
}
COMPONENTS = {"centre of mass": "xyz", "origin": "xyz", "axle midpoint P": "xyz"}
INERTIAS = ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")


@dataclass(frozen=True)
class Parameter:
    """A symbol for a number of the URDF.

    Attributes:
        symbol: The symbol.
        value: Its value in the URDF.
        unit: SI unit.
        of: What it is of, in words.
    """

    symbol: sp.Symbol
    value: float
    unit: str
    of: str


class Numbers:
    """Turns numbers into exact values; with ``named``, all but directions into symbols.

    Every mass, length and inertia gets its own symbol, but equal numbers share one within one
    link's inertia, and between the wheels, which are meant to be alike.

    Args:
        robot: The robot.
        named: Whether numbers become symbols.
    """

    def __init__(self, robot: Robot, named: bool) -> None:
        self.parameters: dict[tuple[Any, ...], Parameter] = {}
        self.exact = True  # until a direction is asked for that only decimals can give
        self._named = named
        self._asked: Counter[str] = Counter()
        wheels = {wheel.joint for wheel in robot.drive.wheels}
        self._wheels = wheels | {robot.description.joint[name].child for name in wheels}

    def __call__(self, value: float, kind: str, label: str) -> sp.Expr:
        """Return a number of a kind (that of ``Scalars.number``) as an expression."""
        if kind == "direction":
            entry = direction(value)
            self.exact &= (
                abs(value) < DIRECTION_TOLERANCE
                or not isinstance(entry, sp.Rational)
                or entry.q < 3
            )
            return entry
        quantity, owner, part = self._place(label)
        if not self._named or kind not in LETTERS or not label:
            return rational(value)
        if rational(value) == 0:
            return sp.Integer(0)
        shared = "wheels" if owner in self._wheels else owner
        key = (kind, quantity, shared, "" if kind == "inertia" else part, rational(abs(value)))
        if key not in self.parameters:
            self._add(key, float(value), label, part)
        elif owner not in self.parameters[key].of:
            self._extend(key, owner, value)
        known = self.parameters[key]
        return known.symbol if value * known.value > 0.0 else -known.symbol

    def _place(self, label: str) -> tuple[str, str, str]:
        """Return the quantity, whose it is, and which of its components is asked for now."""
        quantity, _, owner = label.partition(" of ")
        if quantity == "centre":
            quantity, _, owner = label.removeprefix("centre of ").partition(" of ")
            quantity = f"centre of {quantity}"
        asked = self._asked[label]
        self._asked[label] += 1
        parts = INERTIAS if quantity == "inertia" else tuple(COMPONENTS.get(quantity, ""))
        return quantity, owner, parts[asked % len(parts)] if parts else ""

    def _add(self, key: tuple[Any, ...], value: float, label: str, part: str) -> None:
        kind, quantity = key[0], key[1]
        letter = "r" if quantity == "radius" else LETTERS[kind]
        symbol = sp.Symbol(f"{letter}_{len(self.parameters)}", real=True)
        of = f"{part} of {label}" if kind == "length" and part else f"{part} {label}".strip()
        self.parameters[key] = Parameter(symbol, value, UNITS[kind], of)

    def _extend(self, key: tuple[Any, ...], owner: str, value: float) -> None:
        known = self.parameters[key]
        sign = "" if value * known.value > 0.0 else "minus "
        of = f"{known.of}, {sign}{owner}"
        self.parameters[key] = Parameter(known.symbol, known.value, known.unit, of)


def rational(value: float) -> sp.Rational:
    """Return the exact value of a float's shortest decimal of 15 digits: 0.1 is 1/10."""
    return sp.Rational(f"{value:.{FLOAT_DIGITS}g}")


def direction(value: float) -> sp.Expr:
    """Return an entry of a rotation or unit vector; one within 1e-9 of a simple value is it.

    Simple are 0, ±1/2, ±√2/2, ±√3/2 and ±1: a URDF writes them with as many digits as it likes.
    """
    for simple, exact in SIMPLE.items():
        if abs(abs(value) - simple) < DIRECTION_TOLERANCE:
            return exact if value >= 0.0 else -exact
    return rational(value)
