"""A loop as a list of statements over buffers: what is compiled, and what is interpreted.

Several runs go side by side, one a lane. A buffer holds numbers of every lane, (size, lanes). The
arithmetic is in CasADi functions, which know nothing of lanes: each lane is computed as if it were
alone, so that its numbers are the same, bit for bit, whatever runs beside it. To keep that, a body
that is repeated until all lanes are done must leave the lanes as they are that are done already.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rpctl import math
from rpctl.arrays import Array


@dataclass(frozen=True, eq=False)
class Buffer:
    """Numbers in the workspace, (size, lanes). They keep their values from step to step.

    Attributes:
        name: One buffer's only.
        size: How many a lane has.
    """

    name: str
    size: int


@dataclass(frozen=True, eq=False)
class RowStream:
    """Rows outside the workspace, by step.

    Attributes:
        name: One stream's only.
        width: Numbers in a row.
        laned: Whether each lane has its own rows, (rows, width, lanes), or all have the same,
            (rows, width).
    """

    name: str
    width: int
    laned: bool = True


@dataclass(frozen=True, eq=False)
class Call:
    """outputs = function(inputs). An output may be one of the inputs, too.

    Attributes:
        function: A ``casadi.Function`` of ``SX``; all its inputs and outputs are dense columns.
        inputs: One buffer for each input, of its size.
        outputs: One buffer for each output, of its size.
    """

    function: Any
    inputs: tuple[Buffer, ...]
    outputs: tuple[Buffer, ...]


@dataclass(frozen=True, eq=False)
class Read:
    """Take the row of this step from a stream."""

    stream: RowStream
    into: Buffer


@dataclass(frozen=True, eq=False)
class ReadBack:
    """Take, lane by lane, a row that was written some steps ago.

    Attributes:
        stream: A ring of rows, written at each step at step modulo rows; laned.
        back: How many steps ago (1,), a whole number from 0 to rows − 1.
        into: Gets the row.
    """

    stream: RowStream
    back: Buffer
    into: Buffer


@dataclass(frozen=True, eq=False)
class Write:
    """Put a buffer into the row of this step.

    A stream may have a row for every n-th step only: then the steps between write nothing. A ring,
    see :class:`ReadBack`, begins again once it is full.
    """

    source: Buffer
    stream: RowStream


@dataclass(frozen=True, eq=False)
class Repeat:
    """Do the body a fixed number of times."""

    times: int
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False)
class Until:
    """Repeat the body while ``going`` (1,) is not 0 in any lane, at most so many times."""

    going: Buffer
    most: int
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False)
class When:
    """Do the body if ``any_of`` (1,) is not 0 in any lane."""

    any_of: Buffer
    body: tuple[Statement, ...]


@dataclass(frozen=True, eq=False)
class Leave:
    """Leave the loop at once if ``flag`` (1,) is not 0 in any lane; the step is not counted."""

    flag: Buffer


Statement = Call | Read | ReadBack | Write | Repeat | Until | When | Leave


@dataclass(frozen=True, eq=False)
class Program:
    """What is done at each step.

    Attributes:
        body: The statements of one step.
    """

    body: tuple[Statement, ...]

    def statements(self) -> Iterator[Statement]:
        """Yield all statements, those of a body after what holds it."""
        yield from _walk(self.body)

    @cached_property
    def buffers(self) -> tuple[Buffer, ...]:
        """The buffers in the order in which they first appear."""
        return tuple(dict.fromkeys(x for s in self.statements() for x in _buffers(s)))

    @cached_property
    def streams(self) -> tuple[RowStream, ...]:
        """The streams in the order in which they first appear."""
        used = (s.stream for s in self.statements() if isinstance(s, Read | ReadBack | Write))
        return tuple(dict.fromkeys(used))


class Rows:
    """The rows of a stream that a run of a kernel is given.

    Args:
        values: (rows, width, lanes), or (rows, width) where all lanes have the same; C-contiguous
            doubles, written in place.
        every: The stream has a row for each so-many-th step. Row 0 is that of the first step of the
            run of the kernel; where it is a ring, that of the steps that its length divides.
        ring: Whether it begins again once it is full.
    """

    def __init__(self, values: Array, every: int = 1, ring: bool = False) -> None:
        self.values, self.every, self.ring = values, every, ring


def _walk(body: Iterable[Statement]) -> Iterator[Statement]:
    for statement in body:
        yield statement
        if isinstance(statement, Repeat | Until | When):
            yield from _walk(statement.body)


def _buffers(statement: Statement) -> Sequence[Buffer]:
    match statement:
        case Call(_, inputs, outputs):
            return *inputs, *outputs
        case Read(_, buffer) | Write(buffer, _) | Until(buffer, _, _):
            return (buffer,)
        case ReadBack(_, back, into):
            return back, into
        case When(flag, _) | Leave(flag):
            return (flag,)
    return ()


Place = tuple[Buffer, Any]  # a buffer, and the symbols or the expression that belong to it


def symbolic(buffer: Buffer) -> Place:
    """Return a buffer with symbols that stand for what is in it."""
    return buffer, math.SX.sym(buffer.name, buffer.size)


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
    found = math.cse([math.densify(math.SX(x)) for x in outputs])
    return math.Function(name, list(inputs), found)
