"""What a CasADi function computes: a straight line of instructions that each define one value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from rpctl.errors import RpctlError


@dataclass(frozen=True)
class Instruction:
    """One value, from earlier values.

    Attributes:
        op: CasADi's name of the operation in capitals, such as ``"ADD"``; ``"INPUT"``, ``"CONST"``
            and ``"OUTPUT"``, which defines no value, among them.
        first: Number of the first operand; of an input or output, the number of the column.
        second: Number of the second operand; of an input or output, the entry of the column.
        stored: Number of the value that an output takes.
        constant: What a constant is.
    """

    op: str
    first: int = -1
    second: int = -1
    stored: int = -1
    constant: float = 0.0


@dataclass(frozen=True)
class StraightLine:
    """A function without branches: value k is what instruction k defines.

    Attributes:
        inputs: Entries of each input column.
        outputs: Entries of each output column.
        instructions: In an order in which each value comes before its users.
    """

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    instructions: tuple[Instruction, ...]


def read_function(function: Any) -> StraightLine:
    """Return the instructions of a ``casadi.Function`` of ``SX`` whose columns are dense.

    Raises:
        RpctlError: It is another kind of function, or a column has zeros that are not stored.
    """
    name = function.name()
    if not function.is_a("SXFunction"):
        raise RpctlError(f"{name}: only a casadi.Function of SX can be compiled")
    if function.get_free():
        raise RpctlError(f"{name}: it has free symbols {function.get_free()}; make them inputs")
    inputs = [function.sparsity_in(k) for k in range(function.n_in())]
    outputs = [function.sparsity_out(k) for k in range(function.n_out())]
    if not all(x.is_dense() and x.size2() <= 1 for x in (*inputs, *outputs)):
        raise RpctlError(f"{name}: all inputs and outputs must be dense columns")
    return StraightLine(
        tuple(x.numel() for x in inputs),
        tuple(x.numel() for x in outputs),
        tuple(_instructions(function)),
    )


def _instructions(function: Any) -> Iterator[Instruction]:
    """Yield them; CasADi's registers, which it uses again, become the numbers of values."""
    names = _names()
    held: dict[int, int] = {}  # by register
    for k in range(function.n_instructions()):
        op = names[function.instruction_id(k)]
        read, written = function.instruction_input(k), function.instruction_output(k)
        if op == "OUTPUT":
            column, entry = written
            yield Instruction(op, column, entry, held[read[0]])
            continue
        if op == "CONST":
            yield Instruction(op, constant=function.instruction_constant(k))
        elif op == "INPUT":
            yield Instruction(op, *read)
        else:
            yield Instruction(op, *(held[x] for x in read))
        held.update(dict.fromkeys(written, k))


@cache
def _names() -> dict[int, str]:
    import casadi

    return {getattr(casadi, x): x[3:] for x in dir(casadi) if x.startswith("OP_")}
