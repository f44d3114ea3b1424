"""A law as a sheet of definitions, each in terms of those before it, with rates by chain rule."""

from __future__ import annotations

from dataclasses import dataclass, field

import sympy as sp


@dataclass(frozen=True)
class Setting:
    """A named constant of a law: its symbol, value and unit, and what it is."""

    symbol: sp.Symbol
    value: float
    unit: str
    of: str


@dataclass(frozen=True)
class Given:
    """An input: its symbol, where code finds it, its unit and what it is.

    ``path`` is empty where the dynamics' own steps compute it.
    """

    symbol: sp.Symbol
    path: str
    unit: str
    of: str


@dataclass
class Sheet:
    """Definitions under construction.

    Attributes:
        settings: The law's constants.
        inputs: What is measured, and the reference.
        definitions: Symbols and what they are, in order.
        rates: Derivative of symbols along the robot's motion; a symbol without one has rate 0.
    """

    settings: list[Setting] = field(default_factory=list)
    inputs: list[Given] = field(default_factory=list)
    definitions: list[tuple[sp.Symbol, sp.Expr]] = field(default_factory=list)
    rates: dict[sp.Symbol, sp.Expr] = field(default_factory=dict)

    def setting(self, name: str, value: float, unit: str, of: str) -> sp.Symbol:
        """Name a constant.

        Args:
            name: Its name.
            value: Its value.
            unit: Its unit; empty for a number.
            of: What it is.
        """
        symbol = sp.Symbol(name, real=True)
        self.settings.append(Setting(symbol, float(value), unit, of))
        return symbol

    def given(self, name: str, path: str, unit: str, of: str) -> sp.Symbol:
        """Name an input.

        Args:
            name: Its name.
            path: Where code finds it.
            unit: Its unit.
            of: What it is.
        """
        symbol = sp.Symbol(name, real=True)
        self.inputs.append(Given(symbol, path, unit, of))
        return symbol

    def define(self, name: str, value: sp.Expr) -> sp.Expr:
        """Name an expression; a number, or what has a name, needs none."""
        value = sp.sympify(value)
        if value.is_number or value.is_Symbol:
            return value
        symbol = sp.Symbol(name, real=True)
        self.definitions.append((symbol, value))
        return symbol

    def follow(self, name: str, value: sp.Expr) -> sp.Expr:
        """Name an expression and, with ``_dot``, its derivative along the motion."""
        symbol, rate = self.define(name, value), self.rate(value)
        if symbol.is_Symbol and symbol != value:
            self.rates[symbol] = self.define(f"{name}_dot", rate)
        return symbol

    def moving(self, name: str, value: sp.Expr, rate: sp.Expr) -> sp.Expr:
        """Name an expression and, with ``_dot``, a derivative that is known otherwise.

        Args:
            name: Its name.
            value: The expression.
            rate: Its derivative along the motion.
        """
        symbol = self.define(name, value)
        self.rates[symbol] = self.define(f"{name}_dot", rate)
        return symbol

    def rate(self, value: sp.Expr) -> sp.Expr:
        """Return an expression's derivative along the motion, by the chain rule."""
        value = sp.sympify(value)
        moving = sorted((s for s in value.free_symbols if s in self.rates), key=str)
        return sp.Add(*(value.diff(symbol) * self.rates[symbol] for symbol in moving))


class Choice(sp.Function):  # type: ignore[misc]
    """``yes`` where left < right, else ``no``; SymPy's ``Piecewise`` rewrites its conditions."""

    nargs = 4

    def _eval_derivative(self, symbol: sp.Symbol) -> sp.Expr:
        left, right, yes, no = self.args
        slopes = yes.diff(symbol), no.diff(symbol)
        return Choice(left, right, *slopes) if any(slopes) else sp.Integer(0)

    def _eval_is_extended_real(self) -> bool:
        return True


def choice(left: sp.Expr, right: sp.Expr, yes: sp.Expr, no: sp.Expr) -> sp.Expr:
    """Return ``yes`` where left < right, else ``no``.

    Args:
        left: What is compared,
        right: and with what.
        yes: The first value.
        no: The second value.
    """
    return Choice(*map(sp.sympify, (left, right, yes, no)))


def as_piecewise(value: sp.Expr) -> sp.Expr:
    """Return an expression with choices as SymPy writes them."""

    def written(left: sp.Expr, right: sp.Expr, yes: sp.Expr, no: sp.Expr) -> sp.Expr:
        return sp.Piecewise((yes, sp.StrictLessThan(left, right)), (no, True))

    return sp.sympify(value).replace(Choice, written)
