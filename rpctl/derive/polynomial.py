"""Polynomials with exact rational coefficients as plain scalars for the recursion.

Cosines, sines, lengths, speeds and parameters are the generators. A square that is known
(sin² = 1 − cos²) is replaced at once, so that equal terms are always equal to look at.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy as sp

from rpctl.errors import RpctlError

Poly = Any  # sympy's PolyElement, which has no types


@dataclass
class Space:
    """The ring of polynomials in named generators, and how long working in it may take.

    Attributes:
        symbols: The generators.
        squares: What the square of a generator is, in place of it.
        inverses: Pairs of generators whose product is 1.
        constants: Generators that stand for an expression, such as a root.
        max_terms: Terms that one polynomial may have.
        deadline: When to give up, by ``time.monotonic``, s.
    """

    symbols: tuple[sp.Symbol, ...]
    squares: Mapping[sp.Symbol, sp.Expr]
    inverses: Mapping[sp.Symbol, sp.Symbol]
    constants: Mapping[sp.Symbol, sp.Expr]
    max_terms: int
    deadline: float
    ring: Any = field(init=False)
    index: dict[sp.Symbol, int] = field(init=False)

    def __post_init__(self) -> None:
        self.ring = sp.polys.rings.PolyRing(self.symbols, sp.QQ, sp.polys.orderings.grlex)
        self.index = {symbol: i for i, symbol in enumerate(self.symbols)}
        self._squares = [
            (self.index[symbol], self.ring.from_expr(sp.sympify(value)))
            for symbol, value in self.squares.items()
        ]
        self._inverses = [(self.index[a], self.index[b]) for a, b in self.inverses.items()]

    def generator(self, symbol: sp.Symbol) -> Poly:
        """Return the polynomial that is one generator."""
        return self.ring.gens[self.index[symbol]]

    def reduced(self, poly: Poly) -> Poly:
        """Return a polynomial with the known squares and inverses replaced.

        Raises:
            TooLargeError: It has too many terms, or time is up.
        """
        if len(poly) > self.max_terms or time.monotonic() > self.deadline:
            raise TooLargeError
        for i, value in self._squares:
            while any(powers[i] > 1 for powers in poly):
                poly = self._without_square(poly, i, value)
        for a, b in self._inverses:
            if any(powers[a] and powers[b] for powers in poly):
                poly = self._cancelled(poly, a, b)
        return poly

    def _without_square(self, poly: Poly, i: int, value: Poly) -> Poly:
        kept, squared = self.ring.zero, self.ring.zero
        for powers, coefficient in poly.items():
            if powers[i] > 1:
                squared[_lowered(powers, {i: 2})] = coefficient
            else:
                kept[powers] = coefficient
        return kept + squared * value

    def _cancelled(self, poly: Poly, a: int, b: int) -> Poly:
        result = self.ring.zero
        for powers, coefficient in poly.items():
            common = min(powers[a], powers[b])
            rest = _lowered(powers, {a: common, b: common})
            result += self.ring.term_new(rest, coefficient)
        return result

    def divided(self, poly: Poly, by: Poly) -> Poly:
        """Return a polynomial over one term; what does not divide it must have an inverse.

        Raises:
            TooLargeError: The divisor is a sum, so the quotient is no polynomial.
        """
        if len(by) != 1:
            raise TooLargeError
        ((powers, coefficient),) = by.items()
        inverse = {self.index[a]: self.ring.gens[self.index[b]] for a, b in self.inverses.items()}
        for i, square in self._squares:
            if square.is_ground and square:  # 1/√n = √n/n
                inverse[i] = self.ring.gens[i].quo_ground(square.LC)
        for i, power in enumerate(powers):
            for _ in range(power):
                if all(monomial[i] for monomial in poly):
                    poly = poly.quo(self.ring.gens[i])
                else:
                    poly = self.reduced(poly * inverse[i])
        return poly.quo_ground(coefficient)

    def expression(self, poly: Poly, symbols: Mapping[sp.Symbol, Any]) -> sp.Expr:
        """Return a polynomial as a SymPy expression, some generators shown as other symbols."""
        meant = {**self.constants, **symbols}
        return poly.as_expr(*(meant.get(symbol, symbol) for symbol in self.symbols))


class TooLargeError(RpctlError):
    """A closed form that grew beyond what anyone would read, or took too long."""


class PolynomialScalar:
    """A polynomial that NumPy takes for a scalar."""

    __slots__ = ("poly", "space")

    def __init__(self, space: Space, poly: Poly) -> None:
        self.space = space
        self.poly = poly

    def _other(self, other: Any) -> Poly:
        if isinstance(other, PolynomialScalar):
            return other.poly
        return self.space.ring.ground_new(sp.QQ(int(other)))

    def _new(self, poly: Poly) -> PolynomialScalar:
        return PolynomialScalar(self.space, poly)

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy then takes this element for each of the array's
        return self._new(self.poly + self._other(other))

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self._new(self.poly - self._other(other))

    def __rsub__(self, other: Any) -> Any:
        return self._new(self._other(other) - self.poly)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self._new(self.space.reduced(self.poly * self._other(other)))

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self._new(self.space.divided(self.poly, self._other(other)))

    def __pow__(self, exponent: int) -> PolynomialScalar:
        return self._new(self.space.reduced(self.poly**exponent))

    def __neg__(self) -> PolynomialScalar:
        return self._new(-self.poly)

    def __eq__(self, other: object) -> bool:
        return bool(self.poly == self._other(other))

    __hash__ = None  # type: ignore[assignment]
    __radd__ = __add__
    __rmul__ = __mul__


def rounded(polys: Iterable[Poly], digits: int) -> list[Poly]:
    """Return polynomials whose coefficients have so many significant digits.

    Terms that are rounding beside the largest coefficient of them all are left out.
    """
    listed = list(polys)
    largest = max((abs(float(c)) for poly in listed for c in poly.values()), default=0.0)
    cleaned = []
    for poly in listed:
        kept = poly.ring.zero
        for powers, coefficient in poly.items():
            if abs(float(coefficient)) > 10.0**-digits * largest:
                exact = sp.Rational(f"{float(coefficient):.{digits}g}")
                kept[powers] = sp.QQ(exact.p, exact.q)
        cleaned.append(kept)
    return cleaned


def _lowered(powers: tuple[int, ...], by: Mapping[int, int]) -> tuple[int, ...]:
    return tuple(power - by.get(i, 0) for i, power in enumerate(powers))


def without_common_term(poly: Poly) -> tuple[tuple[int, ...], Poly]:
    """Return the powers that divide every term of a polynomial, and what is left."""
    common = tuple(map(min, zip(*poly, strict=True)))
    rest = poly.ring.zero
    for powers, coefficient in poly.items():
        rest[tuple(p - c for p, c in zip(powers, common, strict=True))] = coefficient
    return common, rest
