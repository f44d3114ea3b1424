"""M, h and B of a robot as exact polynomials, by the recursion or by differentiating G."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import sympy as sp

from rpctl.derive.folding import cyclic_joints
from rpctl.derive.parameters import ROOT2, ROOT3, Numbers, Parameter, rational
from rpctl.derive.polynomial import Poly, PolynomialScalar, Space, rounded
from rpctl.equivalence.gibbs_appell import GibbsAppell, JointRates, LinkKinematics
from rpctl.equivalence.tree import Scalars, Tree
from rpctl.robot.model import Robot

COEFFICIENT_DIGITS = 13  # of a coefficient that directions of 15 decimals have gone into
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
        self.rates = _rate_symbols(robot, self.symbols)
        self.accelerations = tuple(sp.Symbol(f"{rate}_dot") for rate in self.rates)
        self.positions: dict[str, Any] = self._positions()
        angles = {a.cos: a for a in self.positions.values() if isinstance(a, Angle)}
        self.angles = tuple(angles.values())
        slid = {
            s for x in self.positions.values() if isinstance(x, sp.Expr) for s in x.free_symbols
        }
        self.lengths = tuple(symbol for symbol in self.symbols.values() if symbol in slid)
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
                followed = self.symbols.get(joint.mimic.joint)
                if followed is None:
                    followed = rational(self.robot.locked.get(joint.mimic.joint, 0.0))
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
        generators = [*self.accelerations, *self.rates]
        generators += [symbol for angle in self.angles for symbol in (angle.cos, angle.sin)]
        generators += [*self.lengths, ROOT2, ROOT3]
        generators += [*(p.symbol for p in self.parameters), *inverses.values()]
        roots = {ROOT2: sp.Integer(2), ROOT3: sp.Integer(3)}
        constants = {root: sp.sqrt(square) for root, square in roots.items()}
        constants |= {inverse: 1 / radius for radius, inverse in inverses.items()}
        deadline = time.monotonic() + MAX_TIME_S
        return Space(tuple(generators), squares | roots, inverses, constants, MAX_TERMS, deadline)

    def element(self, value: Any) -> PolynomialScalar:
        """Return an expression in the generators as a scalar of the recursion."""
        return PolynomialScalar(self.space, self.space.ring.from_expr(sp.sympify(value)))

    def _scalars(self, numbers: Numbers) -> Scalars:
        def cos(angle: Any) -> PolynomialScalar:
            if isinstance(angle, Angle):
                return self.element(angle.cos)
            return self.element(numbers(float(sp.cos(angle)), "direction", ""))

        def sin(angle: Any) -> PolynomialScalar:
            if isinstance(angle, Angle):
                return self.element(angle.sin)
            return self.element(numbers(float(sp.sin(angle)), "direction", ""))

        return Scalars(lambda *asked: self.element(numbers(*asked)), cos, sin)

    def start(self) -> tuple[dict[str, Any], Any, LinkKinematics, JointRates]:
        """Return the positions, u and the root's motion that the recursion starts from."""
        positions = {
            name: value if isinstance(value, Angle) or value.is_number else self.element(value)
            for name, value in self.positions.items()
        }
        kinds = {joint.name: joint.kind for joint in self.robot.description.joints}
        for name, value in positions.items():
            if kinds[name] == "prismatic" and not isinstance(value, PolynomialScalar):
                positions[name] = self.element(value)
        u = np.array([self.element(rate) for rate in self.rates], dtype=object)
        root, rates = self.oracle.rolling_root(self.oracle.scalars.identity(3), positions, u)
        return positions, u, root, rates

    def result(self, M: Any, h: Any, B: Any, angular_velocities: Any) -> Equations:
        """Return the equations, without terms that are rounding."""
        n = len(self.rates)

        def clean(elements: Any) -> list[Poly]:
            polys = [element.poly for element in elements]
            return polys if self.numbers.exact else rounded(polys, COEFFICIENT_DIGITS)

        entries, columns = clean(np.ravel(M)), B.shape[1]
        actuation = clean(B.ravel())
        return Equations(
            self.space, self.symbols, self.angles, self.lengths, self.rates, self.parameters,
            M=tuple(tuple(entries[n * i : n * i + n]) for i in range(n)),
            h=tuple(clean(h)),
            B=tuple(tuple(actuation[columns * i : columns * (i + 1)]) for i in range(n)),
            angular_velocities=tuple(angular_velocities),
        )  # fmt: skip


def by_recursion(robot: Robot, named: bool = False) -> Equations:
    """Return the equations from the accelerations' coefficients; [MS21, Eq. 1-5].

    Args:
        robot: The robot.
        named: Whether the numbers of the URDF become symbols.

    Raises:
        TooLargeError: A polynomial got too many terms, or the derivation took too long.
    """
    derivation = _Derivation(robot, named)
    positions, u, root, rates = derivation.start()
    terms = derivation.oracle.terms(positions, u, root, rates)
    angular_velocities = {}
    for _, motion in derivation.oracle.links(positions, u, root, rates):
        angular_velocities.update(dict.fromkeys(x.poly for x in motion.omega))
    losses = tuple(
        (
            tuple(rate.poly for rate in terms.rates[name]),
            (loss.damping.poly, loss.friction.poly, loss.rate.poly),
        )
        for name, loss in derivation.oracle.tree.losses.items()
    )
    found = derivation.result(terms.M, terms.h, terms.B, angular_velocities)
    return replace(found, losses=losses)


def by_differentiation(robot: Robot, named: bool = False) -> Equations:
    """Return the equations from the Gibbs function's derivatives: M = ∂²G/∂ν̇², h = ∂G/∂ν̇ at 0.

    Args, errors: as :func:`by_recursion`. [MS21, Eq. 1-3].
    """
    derivation = _Derivation(robot, named)
    space = derivation.space
    positions, u, root, rates = derivation.start()
    u_dot = np.array([derivation.element(x) for x in derivation.accelerations], dtype=object)
    G = derivation.oracle.function(positions, u, u_dot, root, rates).poly
    turned = [space.generator(x) for x in derivation.accelerations]
    gradient = [G.diff(x) for x in turned]
    M = np.array(
        [[PolynomialScalar(space, row.diff(x)) for x in turned] for row in gradient], dtype=object
    )
    at_rest = [(x, 0) for x in turned]
    h = [PolynomialScalar(space, row.evaluate(at_rest).set_ring(space.ring)) for row in gradient]
    B = np.array([rates.rows[name] for name in robot.actuators]).T.reshape(len(u), -1)
    return derivation.result(M, h, B, ())


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


def _rate_symbols(robot: Robot, positions: Mapping[str, sp.Symbol]) -> tuple[sp.Symbol, ...]:
    base = tuple(sp.Symbol(name, real=True) for name in robot.drive.base_speeds)
    return base + tuple(
        sp.Symbol(f"{positions[joint.name]}_dot", real=True) for joint in robot.joints
    )
