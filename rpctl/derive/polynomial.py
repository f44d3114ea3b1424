"""Polynomials with exact rational coefficients as plain scalars for the recursion.

Cosines, sines, lengths, speeds and parameters are the generators. A square that is known
(sin² = 1 − cos²) is replaced at once, so that equal terms are always equal to look at.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
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
        self._rules = [  # a product, and what it is replaced by
            *((self.generator(s) ** 2, self.ring.from_expr(x)) for s, x in self.squares.items()),
            *(
                (self.generator(a) * self.generator(b), self.ring.one)
                for a, b in self.inverses.items()
            ),
        ]

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
        divide = self.ring.monomial_div
        for product, value in self._rules:
            while any(divide(powers, product.LM) for powers in poly):
                kept, divided = self.ring.zero, self.ring.zero
                for powers, coefficient in poly.items():
                    quotient = divide(powers, product.LM)
                    (divided if quotient else kept)[quotient or powers] = coefficient
                poly = kept + divided * value
        return poly

    def divided(self, poly: Poly, by: Poly) -> Poly:
        """Return a polynomial over one term; what does not divide it must have an inverse.

        Raises:
            TooLargeError: The divisor is a sum, so the quotient is no polynomial.
        """
        if len(by) != 1:
            raise TooLargeError
        ((powers, coefficient),) = by.items()
        inverse = {self.index[a]: self.generator(b) for a, b in self.inverses.items()}
        roots = {s: square for s, square in self.squares.items() if square.is_number}
        inverse |= {self.index[s]: self.generator(s) / n for s, n in roots.items()}  # 1/√n = √n/n
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

    @staticmethod
    def _binary(operate: Callable[[Space, Poly, Poly], Poly]) -> Callable[..., Any]:
        def method(self: PolynomialScalar, other: Any) -> Any:
            if isinstance(other, np.ndarray):
                return NotImplemented  # NumPy then takes this element for each of the array's
            return self._new(operate(self.space, self.poly, self._other(other)))

        return method

    def _other(self, other: Any) -> Poly:
        if isinstance(other, PolynomialScalar):
            return other.poly
        return self.space.ring.ground_new(sp.QQ(int(other)))

    def _new(self, poly: Poly) -> PolynomialScalar:
        return PolynomialScalar(self.space, poly)

    def __pow__(self, exponent: int) -> PolynomialScalar:
        return self._new(self.space.reduced(self.poly**exponent))

    def __neg__(self) -> PolynomialScalar:
        return self._new(-self.poly)

    def __eq__(self, other: object) -> bool:
        return bool(self.poly == self._other(other))

    __hash__ = None  # type: ignore[assignment]
    __add__ = __radd__ = _binary(lambda _, a, b: a + b)
    __sub__ = _binary(lambda _, a, b: a - b)
    __rsub__ = _binary(lambda _, a, b: b - a)
    __mul__ = __rmul__ = _binary(lambda space, a, b: space.reduced(a * b))
    __truediv__ = _binary(lambda space, a, b: space.divided(a, b))


def rounded(polys: Iterable[Poly], digits: int) -> list[Poly]:
    """Return polynomials whose coefficients have so many significant digits.

    Terms that are rounding beside the largest coefficient of them all are left out.
    """
    listed = list(polys)
    largest = max((abs(float(c)) for poly in listed for c in poly.values()), default=0.0)
    least = 10.0**-digits * largest
    return [
        poly.ring.from_dict(
            {
                powers: sp.QQ.from_sympy(sp.Rational(f"{float(coefficient):.{digits}g}"))
                for powers, coefficient in poly.items()
                if abs(float(coefficient)) > least
            }
        )
        for poly in listed
    ]


def primitive(poly: Poly) -> tuple[Any, Poly]:
    """Return a polynomial's content and the rest, whose leading coefficient is positive."""
    content, rest = poly.primitive()
    return (-content, -rest) if rest.LC < 0 else (content, rest)


def without_common_term(poly: Poly) -> tuple[tuple[int, ...], Poly]:
    """Return the powers that divide every term of a polynomial, and what is left."""
    common, divide = tuple(map(min, zip(*poly, strict=True))), poly.ring.monomial_div
    return common, poly.ring.from_dict({divide(m, common): c for m, c in poly.items()})
