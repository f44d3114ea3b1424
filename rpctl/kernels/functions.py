"""CasADi's functions as functions of a module of LLVM: a straight line of instructions each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from rpctl.errors import RpctlError
from rpctl.kernels.lanes import Lanes, Value
from rpctl.kernels.operations import (
    BINARY,
    COMPARISONS,
    CONDITIONS,
    TURNS,
    UNARY,
    LaneOperations,
)
from rpctl.kernels.program import Buffer, Call, Program

ALIGNMENT = 64  # bytes; of the workspace and of each buffer in it
# Of a block. Inputs are loaded again in each: kept for longer, they would only crowd the registers.
# Blocks of 300 to 3000 lines build a fourth sooner than one, and run some per cent faster.
BLOCK_LINES = 1000


def offsets(program: Program, lanes: int) -> dict[Buffer, int]:
    """Return where each buffer begins in the workspace, bytes.

    Args:
        program: The program.
        lanes: Numbers in each entry.
    """
    found, end = {}, 0
    for buffer in program.buffers:
        found[buffer] = end
        end += -(-8 * buffer.size * lanes // ALIGNMENT) * ALIGNMENT
    return found


class Functions:
    """The functions that a program calls, each lowered once.

    A buffer that is the same in all calls of a function has a place in the workspace that is known;
    the others are parameters.

    Args:
        program: The program.
        lanes: Numbers in each entry.
    """

    def __init__(self, program: Program, lanes: int) -> None:
        self.lanes, self.offsets = lanes, offsets(program, lanes)
        self._calls: dict[int, list[Call]] = defaultdict(list)
        for each in program.statements():
            if isinstance(each, Call):
                _check(each)
                self._calls[id(each.function)].append(each)
        self._names = {key: f"function_{k}" for k, key in enumerate(self._calls)}

    def text(self) -> str:
        """Return the definitions of all functions."""
        return "\n".join(
            self._define(self._names[key], calls) for key, calls in self._calls.items()
        )

    def call(self, call: Call) -> str:
        """Return the line that calls a function."""
        columns = (*call.inputs, *call.outputs)
        varied = _varied(self._calls[id(call.function)])
        given = [f", i64 {self.offsets[columns[k]]}" for k in varied]
        return f"call void @{self._names[id(call.function)]}(ptr %workspace{''.join(given)})"

    def _define(self, name: str, calls: list[Call]) -> str:
        straight, varied = read_function(calls[0].function), _varied(calls)
        b = Lanes(self.lanes)
        columns = (*calls[0].inputs, *calls[0].outputs)
        bases: dict[int, int | str] = {}
        for k, buffer in enumerate(columns):
            if k in varied:
                bases[k] = f"%column_{k}"
                b.lines.append(f"%column_{k} = getelementptr i8, ptr %workspace, i64 %offset_{k}")
            else:
                bases[k] = self.offsets[buffer]
        late = {
            k
            for k in range(len(straight.outputs))
            if any(call.outputs[k] in call.inputs for call in calls)
        }
        _Body(b, straight, bases, late).write()
        given = "".join(f", i64 %offset_{k}" for k in varied)
        head = f"define internal void @{name}(ptr %workspace{given}) #0 {{"
        return "\n".join((head, *b.lines, "ret void", "}"))


class _Body:
    """Writes the lines of a straight line.

    Args:
        b: Where lines go.
        straight: What is computed.
        bases: Where each column begins, inputs before outputs: bytes in the workspace, or the name
            of a pointer.
        late: Outputs that are inputs, too, and so are stored when all inputs were read.
    """

    def __init__(
        self,
        b: Lanes,
        straight: StraightLine,
        bases: Mapping[int, int | str],
        late: set[int],
    ) -> None:
        self.b, self.straight, self.bases, self.late = b, straight, bases, late
        self._first: dict[int, Value] = {}
        self._loaded: dict[int, Value] = {}  # in this block
        self._block_end = BLOCK_LINES

    def write(self) -> None:
        """Append all lines."""
        values: list[Value] = []
        kept: list[tuple[int, int, Value]] = []
        operations = LaneOperations(self.b)
        n_in = len(self.straight.inputs)
        for x in self.straight.instructions:
            if len(self.b.lines) >= self._block_end:
                self._begin_block()
            value = ""
            if x.op == "CONST":
                value = self.b.constant(x.constant)
            elif x.op == "OUTPUT":
                stored = n_in + x.first, x.second, self._operand(values, x.stored)
                if x.first in self.late:
                    kept.append(stored)
                else:
                    self._store(*stored)
            elif x.op != "INPUT":
                again = x.op not in TURNS
                operands = (self._operand(values, k, again) for k in (x.first, x.second))
                value = operations.apply(x.op, *operands)
            values.append(value)
        for stored in kept:
            self._store(*stored)

    def _operand(self, values: list[Value], number: int, again: bool = True) -> Value:
        """Return a value; an input is loaded again in each block, but for what is kept by name."""
        if number < 0:
            return ""
        x = self.straight.instructions[number]
        if x.op != "INPUT":
            return values[number]
        if not again and number in self._first:
            return self._first[number]
        if number not in self._loaded:
            self._loaded[number] = self._load(x.first, x.second)
            self._first.setdefault(number, self._loaded[number])
        return self._loaded[number]

    def _begin_block(self) -> None:
        name = f"block_{len(self.b.lines)}"
        self.b.lines += [f"br label %{name}", f"{name}:"]
        self._loaded.clear()
        self._block_end = len(self.b.lines) + BLOCK_LINES

    def _place(self, column: int, entry: int) -> Value:
        base, step = self.bases[column], 8 * self.b.lanes * entry
        start, add = ("%workspace", base + step) if isinstance(base, int) else (base, step)
        return self.b.emit(f"getelementptr i8, ptr {start}, i64 {add}")

    def _load(self, column: int, entry: int) -> Value:
        place = self._place(column, entry)
        return self.b.emit(f"load {self.b.real}, ptr {place}, align {self._alignment}")

    def _store(self, column: int, entry: int, value: Value) -> None:
        place = self._place(column, entry)
        self.b.lines.append(f"store {self.b.real} {value}, ptr {place}, align {self._alignment}")

    @property
    def _alignment(self) -> int:
        return min(ALIGNMENT, 8 * self.b.lanes)


def _varied(calls: list[Call]) -> list[int]:
    """Return the columns for which not all calls have the same buffer."""
    columns = zip(*((*call.inputs, *call.outputs) for call in calls), strict=True)
    return [k for k, buffers in enumerate(columns) if len(set(buffers)) > 1]


def _check(call: Call) -> None:
    """Refuse a call whose buffers do not fit its function; the memory is addressed unchecked."""
    function = call.function
    wanted = [function.numel_in(k) for k in range(function.n_in())]
    wanted += [function.numel_out(k) for k in range(function.n_out())]
    if [x.size for x in (*call.inputs, *call.outputs)] != wanted:
        raise ValueError(f"{function.name()}: its buffers are not of its columns' sizes {wanted}")
    if len(set(call.outputs)) < len(call.outputs):
        raise ValueError(f"{function.name()}: two outputs have one buffer")


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


def missing_operation(function: Any) -> str | None:
    """Return an operation of a function without machine code; None if all have one."""
    used = {x.op for x in read_function(function).instructions}
    missing = used - {
        *UNARY,
        *BINARY,
        *COMPARISONS,
        *TURNS,
        *CONDITIONS,
        "INPUT",
        "OUTPUT",
        "CONST",
    }
    return min(missing, default=None)


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
