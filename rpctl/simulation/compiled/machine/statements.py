"""Statements written as expressions: what goes into a buffer, in symbols of what is in others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi

from rpctl.simulation.compiled.machine.program import Buffer, Call

Place = tuple[Buffer, Any]  # a buffer, and the symbols or the expression that belong to it


def symbolic(buffer: Buffer) -> Place:
    """Return a buffer with symbols that stand for what is in it."""
    return buffer, casadi.SX.sym(buffer.name, buffer.size)


def statement(name: str, inputs: Sequence[Place], outputs: Sequence[Place]) -> Call:
    """Return the call of a new function.

    Args:
        name: The function's.
        inputs: Buffers, and the symbols that stand for what is in them.
        outputs: Buffers, and what goes into them, ``casadi.SX`` columns.
    """
    function = dense_function(name, [x for _, x in inputs], [x for _, x in outputs])
    return Call(function, tuple(b for b, _ in inputs), tuple(b for b, _ in outputs))


def dense_function(name: str, inputs: Sequence[Any], outputs: Sequence[Any]) -> Any:
    """Return a ``casadi.Function`` with dense columns, which computes nothing twice.

    Args:
        name: Its name.
        inputs: Symbols.
        outputs: Columns of ``casadi.SX``.
    """
    found = casadi.cse([casadi.densify(casadi.SX(x)) for x in outputs])
    return casadi.Function(name, list(inputs), found)
