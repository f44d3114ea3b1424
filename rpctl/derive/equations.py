"""M, h and B of a robot as exact polynomials, and the numbers of its URDF as exact rationals."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import pinocchio as pin
import sympy as sp

from rpctl.derive.polynomial import Poly, PolynomialScalar, Space, rounded
from rpctl.equivalence.gibbs_appell import GibbsAppell, JointRates, LinkKinematics
from rpctl.equivalence.tree import Scalars, Tree
from rpctl.robot.model import Robot

COEFFICIENT_DIGITS = 13  # of a coefficient that directions of 15 decimals have gone into
SYMMETRY_TOLERANCE = 1e-13  # relative; the inertia of a round wheel turns with it by no more
MAX_TERMS = 2500  # of one polynomial
MAX_TIME_S = 20.0  # s, for the whole derivation


@dataclass(frozen=True)
class Angle:
    """An angle whose cosine and sine are generators."""

    cos: sp.Symbol
    sin: sp.Symbol
    value: sp.Expr


@dataclass(frozen=True)
class Equations:
    """M ν̇ + h = B τ in polynomials.

    Attributes:
        space: Where the polynomials live.
        positions: Symbol of every joint that is neither locked nor a mimic.
        angles: The angles, outermost joint last.
        lengths: Symbols of positions that occur outside of angles: those of sliding joints.
        rates: Symbols of ν.
        parameters: Symbols that stand for numbers.
        M: Entries (n, n).
        h: Entries (n,).
        B: Entries (n, n_act).
        angular_velocities: Angular velocities of the links, component by component, as polynomials.
        losses: Of each joint that loses something: its rate as a row of ν (n,), and its damping,
            friction and the rate below which that is smooth.
    """

    space: Space
    positions: Mapping[str, sp.Symbol]
    angles: tuple[Angle, ...]
    lengths: tuple[sp.Symbol, ...]
    rates: tuple[sp.Symbol, ...]
    parameters: tuple[Parameter, ...]
    M: tuple[tuple[Poly, ...], ...]
    h: tuple[Poly, ...]
    B: tuple[tuple[Poly, ...], ...]
    angular_velocities: tuple[Poly, ...]
    losses: tuple[tuple[tuple[Poly, ...], tuple[Poly, Poly, Poly]], ...] = ()


class _Derivation:
    """A robot's recursion over polynomials, set up."""

    def __init__(self, robot: Robot, named: bool) -> None:
        self.robot = robot
        self.numbers = numbers = Numbers(robot, named)
        Tree(robot, Scalars(numbers, sp.cos, sp.sin))  # asks for every number once
        numbers(9.81, "gravity", "gravity")
        self.parameters = tuple(numbers.parameters.values())
        self.symbols = position_symbols(robot)
        rates = (f"{self.symbols[joint.name]}_dot" for joint in robot.joints)
        self.rates = tuple(sp.Symbol(x, real=True) for x in (*robot.drive.base_speeds, *rates))
        self.positions: dict[str, Any] = self._positions()
        angles = {a.cos: a for a in self.positions.values() if isinstance(a, Angle)}
        self.angles = tuple(angles.values())
        slid = sp.Tuple(*(x for x in self.positions.values() if isinstance(x, sp.Expr)))
        self.lengths = tuple(x for x in self.symbols.values() if x in slid.free_symbols)
        self.space = self._space()
        self.oracle = GibbsAppell(robot, self._scalars(numbers))

    def _positions(self) -> dict[str, Any]:
        positions: dict[str, Any] = {}
        cyclic, marks = cyclic_joints(self.robot), count(1)
        for joint in self.robot.description.joints:
            if not joint.moving:
                continue
            value: Any = self.symbols.get(joint.name)
            if joint.name in self.robot.locked:
                value = rational(self.robot.locked[joint.name])
            elif joint.name in cyclic:
                value = sp.Integer(0)
            elif joint.mimic is not None:
                still = rational(self.robot.locked.get(joint.mimic.joint, 0.0))
                followed = self.symbols.get(joint.mimic.joint, still)
                value = rational(joint.mimic.multiplier) * followed + rational(joint.mimic.offset)
            if joint.kind != "prismatic" and not value.is_number:
                mark = str(value).removeprefix("theta").replace("phi", "w")
                mark = mark if value.is_Symbol else f"e{next(marks)}"  # a mimic's
                value = Angle(sp.Symbol(f"C{mark}"), sp.Symbol(f"S{mark}"), value)
            positions[joint.name] = value
        return positions

    def _space(self) -> Space:
        squares = {angle.sin: 1 - angle.cos**2 for angle in self.angles}
        radii = [p.symbol for p in self.parameters if str(p.symbol).startswith("r")]
        inverses = {radius: sp.Symbol(f"{radius}_inverse") for radius in radii}
        waves = (symbol for angle in self.angles for symbol in (angle.cos, angle.sin))
        numbers = (*(p.symbol for p in self.parameters), *inverses.values())
        generators = (*self.rates, *waves, *self.lengths, ROOT2, ROOT3, *numbers)
        roots = {ROOT2: sp.Integer(2), ROOT3: sp.Integer(3)}
        constants = {root: sp.sqrt(square) for root, square in roots.items()}
        constants |= {inverse: 1 / radius for radius, inverse in inverses.items()}
        deadline = time.monotonic() + MAX_TIME_S
        return Space(generators, squares | roots, inverses, constants, MAX_TERMS, deadline)

    def element(self, value: Any) -> PolynomialScalar:
        """Return an expression in the generators as a scalar of the recursion."""
        return PolynomialScalar(self.space, self.space.ring.from_expr(sp.sympify(value)))

    def _scalars(self, numbers: Numbers) -> Scalars:
        def wave(part: str, function: Any) -> Callable[[Any], PolynomialScalar]:
            return lambda angle: self.element(
                getattr(angle, part)
                if isinstance(angle, Angle)
                else numbers(float(function(angle)), "direction", "")
            )

        return Scalars(
            lambda *asked: self.element(numbers(*asked)), wave("cos", sp.cos), wave("sin", sp.sin)
        )

    def start(self) -> tuple[dict[str, Any], Any, LinkKinematics, JointRates]:
        """Return the positions, u and the root's motion that the recursion starts from."""
        sliding = {x.name for x in self.robot.description.joints if x.kind == "prismatic"}
        positions = {
            name: value
            if isinstance(value, Angle) or (value.is_number and name not in sliding)
            else self.element(value)
            for name, value in self.positions.items()
        }
        u = np.array([self.element(rate) for rate in self.rates], dtype=object)
        root, rates = self.oracle.rolling_root(self.oracle.scalars.identity(3), positions, u)
        return positions, u, root, rates

    def clean(self, elements: Any) -> list[tuple[Poly, ...]]:
        """Return the rows of a matrix of scalars, without terms that are rounding."""
        polys, width = [element.poly for element in np.ravel(elements)], elements.shape[1]
        polys = polys if self.numbers.exact else rounded(polys, COEFFICIENT_DIGITS)
        return [tuple(polys[width * i : width * (i + 1)]) for i in range(len(elements))]


def by_recursion(robot: Robot, named: bool = False) -> Equations:
    """Return the equations from the accelerations' coefficients; [MS21, Eq. 1-5].

    Args:
        robot: The robot.
        named: Whether the numbers of the URDF become symbols.

    Raises:
        TooLargeError: A polynomial got too many terms, or the derivation took too long.
    """
    robot.require_level()
    made = _Derivation(robot, named)
    start = made.start()
    terms = made.oracle.terms(*start)
    turns = [x.poly for _, motion in made.oracle.links(*start) for x in motion.omega]
    return Equations(
        made.space, made.symbols, made.angles, made.lengths, made.rates, made.parameters,
        M=tuple(made.clean(terms.M)),
        h=made.clean(terms.h[None])[0],
        B=tuple(made.clean(terms.B)),
        angular_velocities=tuple(dict.fromkeys(turns)),
        losses=tuple(
            (
                tuple(rate.poly for rate in terms.rates[name]),
                (loss.damping.poly, loss.friction.poly, loss.rate.poly),
            )
            for name, loss in made.oracle.tree.losses.items()
        ),
    )  # fmt: skip


def cyclic_joints(robot: Robot) -> frozenset[str]:
    """Return the joints whose angle the dynamics do not depend on: each turns one round body.

    Round means: its centre of mass is on the joint's axis, and its inertia is the same about all
    directions across it. The wheels of most robots are.
    """
    model, found = robot.model, set()
    for name in robot.entries:
        number = model.getJointId(name)
        motion = np.ravel(model.joints[number].createData().S)
        if number in list(model.parents) or not motion[3:].any():
            continue
        body, turn = model.inertias[number], pin.AngleAxis(1.0, motion[3:]).matrix()
        across = np.abs(np.cross(motion[3:], body.lever)).max()
        change = np.abs(turn @ body.inertia @ turn.T - body.inertia).max()
        if (
            across <= SYMMETRY_TOLERANCE * max(1.0, np.abs(body.lever).max())
            and change <= SYMMETRY_TOLERANCE * np.abs(body.inertia).max()
        ):
            found.add(name)
    return frozenset(found)


def position_symbols(robot: Robot) -> dict[str, sp.Symbol]:
    """Return θ1, θ2, … for turning and η1, η2, … for sliding joints; φ1, φ2, … for wheels."""
    counters = {letter: count(1) for letter in ("theta", "eta", "phi")}
    symbols = {}
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    mimics = {joint.name for joint in robot.mimics}
    for joint in robot.description.joints:
        if not joint.moving or joint.name in robot.locked or joint.name in mimics:
            continue
        letter = "eta" if joint.kind == "prismatic" else "theta"
        letter = "phi" if joint.name in wheels else letter
        symbols[joint.name] = sp.Symbol(f"{letter}{next(counters[letter])}", real=True)
    return symbols


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
            letter = "r" if quantity == "radius" else LETTERS[kind]
            symbol = sp.Symbol(f"{letter}_{len(self.parameters)}", real=True)
            of = f"{part} of {label}" if kind == "length" and part else f"{part} {label}".strip()
            self.parameters[key] = Parameter(symbol, float(value), UNITS[kind], of)
        known = self.parameters[key]
        alike = value * known.value > 0.0
        if owner not in known.of:
            of = f"{known.of}, {'' if alike else 'minus '}{owner}"
            self.parameters[key] = replace(known, of=of)
        return known.symbol if alike else -known.symbol

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
