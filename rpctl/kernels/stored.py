"""Programs as machine code on disk, with what stands beside them: built once.

Building a graph takes as long as a thousand seconds of simulation. What was built before for the
same sources is read with its code in a few milliseconds. A file holds plain JSON, which makes
nothing but records of rpctl's kernels and laws, and the machine code.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from importlib import import_module
from typing import Any, TypeVar

from rpctl.kernels.cache import cached
from rpctl.kernels.machine_code import (
    MachineCode,
    compile_program,
)
from rpctl.kernels.program import Program

# Of what stands beside the programs.
MODULES = (
    "rpctl.simulation.compiled.",
    "rpctl.kernels.",
    "rpctl.control.fragment",
    "rpctl.control.law",
)
LENGTH = 8  # bytes of a number that tells how many bytes follow
DAMAGED = ValueError, LookupError, TypeError, AttributeError, ImportError, RecursionError
Beside = TypeVar("Beside")


def stored(
    key: bytes, make: Callable[[], tuple[Beside, Sequence[Program]]], lanes: int = 1
) -> tuple[Beside, list[MachineCode]]:
    """Return programs as machine code and what stands beside them, from disk if they are there.

    Args:
        key: What :func:`code_key` returned.
        make: Makes both. They may share buffers.
        lanes: How many runs go side by side.
    """

    def build() -> bytes:
        beside, programs = make()
        codes = [compile_program(each, lanes).code for each in programs]
        return _joined([as_json((beside, tuple(programs))).encode(), *codes])

    try:
        told, *codes = _parted(cached(key, build))
        beside, programs = from_json(told.decode())
    except DAMAGED:
        told, *codes = _parted(cached(key, build, anew=True))
        beside, programs = from_json(told.decode())
    pairs = zip(programs, codes, strict=True)
    return beside, [MachineCode(program, lanes, code) for program, code in pairs]


def _joined(parts: Sequence[bytes]) -> bytes:
    return b"".join(len(part).to_bytes(LENGTH, "big") + part for part in parts)


def _parted(content: bytes) -> list[bytes]:
    parts, at = [], 0
    while at < len(content):
        begin = at + LENGTH
        at = begin + int.from_bytes(content[at:begin], "big")
        if at > len(content):
            raise ValueError("a part is cut off")
        parts.append(content[begin:at])
    return parts


def as_json(thing: object) -> str:
    """Return dataclasses, tuples (named ones, too), lists, dictionaries and plain values as JSON.

    What several places share is one object again when it is read. CasADi's functions are left out:
    the machine code does what they say.
    """
    known: dict[int, int] = {}
    records: list[Any] = []

    def plain(value: Any) -> Any:
        if value is None or isinstance(value, str | bool | int | float):
            return value
        if isinstance(value, list):
            return [plain(each) for each in value]
        if type(value) is tuple:
            return {"tuple": [plain(each) for each in value]}
        if isinstance(value, dict):
            return {"items": [[plain(k), plain(v)] for k, v in value.items()]}
        if type(value).__module__.startswith("casadi"):
            return None
        if id(value) not in known:
            told = {name: plain(getattr(value, name)) for name in _names(type(value))}
            known[id(value)] = len(records)
            records.append([type(value).__module__, type(value).__name__, told])
        return {"record": known[id(value)]}

    root = plain(thing)
    return json.dumps([root, records])


def from_json(text: str) -> Any:
    """Return what :func:`as_json` wrote.

    Raises:
        ValueError: It names what does not stand beside programs, or is no JSON of that kind; so do
            the other errors of ``DAMAGED``.
    """
    root, told = json.loads(text)
    records: list[Any] = []

    def thing(value: Any) -> Any:
        if isinstance(value, list):
            return [thing(each) for each in value]
        if not isinstance(value, dict):
            return value
        ((kind, inside),) = value.items()
        if kind == "tuple":
            return tuple(thing(each) for each in inside)
        if kind == "items":
            return {thing(k): thing(v) for k, v in inside}
        return records[inside]

    for module, name, entries in told:
        made_of = {key: thing(each) for key, each in entries.items()}
        records.append(_record(module, name)(**made_of))
    return thing(root)


def _record(module: str, name: str) -> Any:
    if not module.startswith(MODULES):
        raise ValueError(f"no machine code comes with {module}.{name}")
    import_module(module)
    found = vars(sys.modules[module])[name]
    if found.__module__ != module or not _names(found):
        raise ValueError(f"{module}.{name} is no record")
    return found


def _names(kind: Any) -> tuple[str, ...]:
    """Return the fields of a dataclass or a named tuple.

    Raises:
        TypeError: It is another type.
    """
    named: tuple[str, ...] | None = getattr(kind, "_fields", None)
    return named or tuple(each.name for each in fields(kind))
