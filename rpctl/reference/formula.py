"""Formulas along one number: their derivatives are taken, not typed, and splines stand in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from itertools import count
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from rpctl import math
from rpctl.arrays import Array
from rpctl.kernels.sheet import Evaluator, Sheet

Numbers = Any  # a float or an array (K,)
NUMBERS = count()  # of symbols: each has a name of its own
FAR = 1e9  # beyond it no spline is asked for
CHUNK = 64  # numbers that are looked at in one call, at most


class Along(Sheet):
    """A sheet of what depends on one number x: a rate is the derivative by x.

    What a ``casadi.Function`` says that is no formula of scalars, a spline's value above all,
    stands in it as symbols.

    Args:
        *parameters: Symbols of numbers that are constant along x.

    Attributes:
        x: The number.
    """

    def __init__(self, *parameters: Any) -> None:
        super().__init__()
        self.x = math.SX.sym("x")
        self.moves(self.x, 1.0)
        self._inputs, self._calls = [self.x, *parameters], list[_Call]()

    def orders(self, values: Sequence[Any], count: int = 3) -> list[Any]:
        """Return values, then their first derivatives, and so on: ``count`` of each."""
        columns = [math.vertcat(math.SX(0, 1), *values)]
        for _ in range(count - 1):
            columns.append(math.SX.zeros(len(values)) + self.rate(columns[-1]))
        return [each for column in columns for each in _entries(column)]

    def spline(self, spline: BSpline, at: Any = None) -> list[Any]:
        """Return the values (n,) of a spline at a place; None takes x."""
        at, ends = self.x if at is None else at, spline.t[[spline.k, -spline.k - 1]]
        breaks = np.unique(spline.t[(spline.t >= ends[0]) & (spline.t < ends[1])])
        orders = range(spline.k, -1, -1)
        terms = [spline(breaks, k).reshape(len(breaks), -1) / factorial(k) for k in orders]
        rows, width = np.hstack([breaks[:, None], *terms]), terms[0].shape[1]
        start, *coefficients = self.call(partial(_row, breaks, rows), rows.shape[1], at)
        found = [0.0] * width
        for k in range(0, len(coefficients), width):
            row = coefficients[k : k + width]
            found = [value * (at - start) + c for value, c in zip(found, row, strict=True)]
        return found

    def call(self, function: Callable[..., Any], width: int, *arguments: Any) -> list[Any]:
        """Return values (n,) of a function that takes and returns ``casadi.MX``."""
        value = math.SX.sym(f"f{next(NUMBERS)}", width)
        self._calls.append(_Call(function, [math.SX(each) for each in arguments], value))
        return _entries(value)

    def values(self, columns: Columns, *arguments: Any) -> list[Any]:
        """Return the values (n,) of a formula whose inputs are others; they have no rates."""
        known, now = [*columns.inputs], [math.SX(each) for each in arguments]
        for function, given, value in columns.calls:
            given = math.substitute(given, known, now)
            known.append(value)
            now.append(math.vertcat(*self.call(function, value.numel(), *given)))
        return _entries(*math.substitute([columns.values], known, now))

    def columns(self, values: Sequence[Any]) -> Columns:
        """Return values (n,) as a function of x, and of the parameters."""
        return Columns(
            self._inputs, math.densify(math.vertcat(math.SX(0, 1), *values)), self._calls
        )


class _Call(NamedTuple):
    function: Callable[..., Any]
    arguments: list[Any]  # in terms of the inputs, and of the values of calls before
    value: Any  # the symbols that stand for it


def _entries(column: Any) -> list[Any]:
    return list(math.vertsplit(column)) if column.numel() else []


def _by_name(symbols: Any, values: Any) -> dict[str, Any]:
    names = (symbol.name() for symbol in _entries(symbols))
    return dict(zip(names, _entries(values), strict=True))


class Columns:
    """Numbers by others, called with floats or with arrays of them.

    Args:
        inputs: Symbols: the first is a number.
        values: In terms of the inputs and of the values of calls (n,).
        calls: In the order of their calling.
    """

    def __init__(self, inputs: list[Any], values: Any, calls: list[_Call]) -> None:
        self.inputs, self.values, self.calls = inputs, values, calls

    @cached_property
    def function(self) -> Any:
        """It as a ``casadi.Function`` of one column."""
        wanted, calls = math.cse(self.values), list[_Call]()
        used = _names(wanted)
        for call in reversed(self.calls):
            if used & _names(call.value):
                used |= _names(*call.arguments)
                calls.insert(0, call)
        known = [*self.inputs]
        if not calls:
            return math.Function("formula", known, [wanted])
        inputs = [math.MX.sym(each.name(), each.numel()) for each in known]
        given, places = [*inputs], dict[str, Any]()
        for each, place in zip(known, inputs, strict=True):
            places |= _by_name(each, place)
        for function, arguments, value in calls:
            told = [
                places[each.name()]
                if each.is_symbolic()
                else math.Function("argument", known, [each]).call(given)[0]
                for each in arguments
            ]
            known.append(value)
            given.append(function(*told))
            places |= _by_name(value, given[-1])
        return math.Function(
            "formula", inputs, math.Function("values", known, [wanted]).call(given)
        )

    @cached_property
    def _one(self) -> Evaluator:
        return Evaluator(self.function)

    @cached_property
    def _some(self) -> Evaluator:
        return Evaluator(self.function.map(CHUNK))

    def __call__(self, *numbers: Numbers) -> Array:
        """Return the column (n,) of floats, or a row (K, n) for each of K.

        Args:
            *numbers: One for each input, floats or arrays (K,), or a column, (m,) or (K, m).
        """
        if not isinstance(numbers[0], np.ndarray):
            return self._one(*numbers)[0]
        count = len(numbers[0])
        starts = range(0, count, CHUNK)
        found = np.empty((len(starts), CHUNK, self.values.numel()))
        for rows, start in zip(found, starts, strict=True):
            places = np.minimum(np.arange(start, start + CHUNK), count - 1)
            told = self._some(*(each[places].ravel() for each in numbers))
            rows[:] = told[0].reshape(rows.shape)
        return found.reshape(-1, found.shape[2])[:count]


class Reader:
    """Calls a ``casadi.Function`` of one number; it returns the same array (n,) each time."""

    def __init__(self, function: Any) -> None:
        self._buffer, self._run = function.buffer()
        self._number, self._column = np.zeros(1), np.zeros(function.numel_out(0))
        self._buffer.set_arg(0, self._number.data)
        self._buffer.set_res(0, self._column.data)

    def __call__(self, x: float) -> Array:
        self._number[0] = x
        self._run()
        return self._column


def _names(*values: Any) -> set[str]:
    return {symbol.name() for each in values for symbol in math.symvar(each)}


def _row(breaks: Array, rows: Array, at: Any) -> Any:
    """Return the row of the interval in which a place is; CasADi finds it as that of a spline.

    Args:
        breaks: Where intervals begin (m,).
        rows: (m, n).
        at: A place; before the first break it is taken for the first interval's.
    """
    knots = np.repeat([-FAR, *breaks[1:], FAR], 2).tolist()
    coefficients = math.DM(np.repeat(rows, 2, axis=0).ravel())
    return math.bspline(at, coefficients, [knots], [1], rows.shape[1], {})
