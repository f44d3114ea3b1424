"""What machine code is made of, as a hash: programs with one hash do the same."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.resources import files

from rpctl.simulation.compiled.machine.program import (
    Buffer,
    Call,
    Leave,
    Program,
    Read,
    ReadBack,
    Repeat,
    RowStream,
    Statement,
    Until,
    When,
    Write,
)
from rpctl.simulation.compiled.machine.target import Processor, compiler_version

MAKERS = (  # modules that decide what machine code is made
    "arctangent",
    "code",
    "exponential",
    "hyperbolic",
    "identity",
    "instructions",
    "lanes",
    "lowering",
    "operations",
    "program",
    "remainders",
    "stepping",
    "target",
    "trigonometric",
)


def code_key(program: Program, lanes: int, processor: Processor) -> bytes:
    """Return a hash of all that a program's machine code depends on.

    Args:
        program: The program: its statements, sizes, and functions with constants to the bit.
        lanes: How many runs go side by side.
        processor: What the code is for.
    """
    import casadi

    buffers = {buffer: k for k, buffer in enumerate(program.buffers)}
    streams = {stream: k for k, stream in enumerate(program.streams)}
    functions: dict[int, int] = {}
    contents: list[bytes] = []  # of each function once
    for statement in program.statements():
        if isinstance(statement, Call) and id(statement.function) not in functions:
            functions[id(statement.function)] = len(functions)
            serialized = statement.function.serialize().encode()
            contents.append(hashlib.sha256(serialized).digest())
    parts = (
        (_makers(), casadi.CasadiMeta.version(), compiler_version()),
        (processor.name, processor.features, lanes),
        [x.size for x in buffers],
        [(x.width, x.laned) for x in streams],
        contents,
        tuple(_outline(program.body, buffers, streams, functions)),
    )
    return hashlib.sha256(repr(parts).encode()).digest()


def _outline(
    body: Iterable[Statement],
    buffers: dict[Buffer, int],
    streams: dict[RowStream, int],
    functions: dict[int, int],
) -> Iterator[object]:
    """Yield statements with numbers for buffers, streams and functions."""
    for statement in body:
        inner: tuple[object, ...] = ()
        if isinstance(statement, Repeat | Until | When):
            inner = tuple(_outline(statement.body, buffers, streams, functions))
        match statement:
            case Call(function, inputs, outputs):
                columns = [buffers[x] for x in inputs], [buffers[x] for x in outputs]
                yield "call", functions[id(function)], columns
            case Read(stream, into):
                yield "read", streams[stream], buffers[into]
            case Write(source, stream):
                yield "write", buffers[source], streams[stream]
            case ReadBack(stream, back, into):
                yield "read back", streams[stream], buffers[back], buffers[into]
            case Repeat(times, _):
                yield "repeat", times, inner
            case Until(going, most, _):
                yield "until", buffers[going], most, inner
            case When(flag, _):
                yield "when", buffers[flag], inner
            case Leave(flag):
                yield "leave", buffers[flag]


@cache
def _makers() -> bytes:
    """Return a hash of the modules that make machine code."""
    found = hashlib.sha256()
    for name in MAKERS:
        found.update(files(__package__).joinpath(f"{name}.py").read_bytes())
    return found.digest()
