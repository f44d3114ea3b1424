"""A formula as a sheet of named scalars; their rates along a motion are taken, not typed."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rpctl import math
from rpctl.arrays import Array


class Sheet:
    """Scalars in the order in which a formula names them, and their rates along a motion.

    A scalar is a ``casadi.SX`` (1, 1). Where symbols move, so does what depends on them: its rate
    is the derivative along theirs.

    Attributes:
        definitions: Symbol and value of what was named, by name; each in terms of those before it.
    """

    def __init__(self) -> None:
        self.definitions: dict[str, tuple[Any, Any]] = {}
        self._rates: dict[str, Any] = {}

    def moves(self, symbol: Any, rate: Any) -> None:
        """Say at which rate a symbol changes; without that it is constant."""
        self._rates[symbol.name()] = math.SX(rate)

    def named(self, name: str, value: Any) -> Any:
        """Return a symbol that stands for a value; a constant or a symbol needs none."""
        value = math.SX(value)
        if value.is_constant() or value.is_symbolic():
            return value
        return self.symbol(name, value)

    def symbol(self, name: str, value: Any) -> Any:
        """Return a new symbol that stands for a value, so that it can have a rate of its own."""
        if name in self.definitions:
            raise ValueError(f"{name} is defined twice")
        symbol = math.SX.sym(name)
        self.definitions[name] = symbol, math.SX(value)
        return symbol

    def rate(self, value: Any) -> Any:
        """Return the rate of a value."""
        value = math.SX(value)
        rates = {s: self._rate_of(s) for s in math.symvar(value)}
        moving = [symbol for symbol, rate in rates.items() if not rate.is_zero()]
        if not moving:
            return math.SX(0)
        return math.jtimes(value, math.vertcat(*moving), math.vertcat(*(rates[s] for s in moving)))

    def _rate_of(self, symbol: Any) -> Any:
        name = symbol.name()
        if name not in self._rates:
            rate = math.SX(0)
            if name in self.definitions:
                stem = name.removesuffix("_dot")
                dots = "_dot" if stem == name else "_ddot"
                rate = self.named(stem + dots, self.rate(self.definitions[name][1]))
            self._rates[name] = rate
        return self._rates[name]

    def resolved(self, values: Sequence[Any]) -> list[Any]:
        """Return values (n, 1) in terms of the symbols that the sheet does not define."""
        pairs = list(self.definitions.values())
        symbols, known = ([pair[k] for pair in pairs] for k in range(2))
        wanted = [math.SX(each) for each in values]
        _, found = math.substitute_inplace(symbols, known, wanted, False)
        sizes = np.cumsum([0, *(each.numel() for each in found)]).tolist()
        whole = math.cse(math.densify(math.vertcat(*found)))
        return list(math.vertsplit(whole, sizes))


class Evaluator(threading.local):
    """Calls a ``casadi.Function`` of dense columns through its buffers, in each thread its own.

    Args:
        function: The function.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._run = function.buffer()
        self._inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self._outputs = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
        for k, column in enumerate(self._inputs):
            self._buffer.set_arg(k, column.data)
        for k, column in enumerate(self._outputs):
            self._buffer.set_res(k, column.data)

    def __call__(self, *columns: ArrayLike) -> list[Array]:
        """Return the outputs, a column each."""
        for place, column in zip(self._inputs, columns, strict=True):
            place[:] = column
        self._run()
        return [column.copy() for column in self._outputs]
