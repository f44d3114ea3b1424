"""Programs as machine code on disk, with what stands beside them: built once.

Building a graph takes as long as a thousand seconds of simulation. What was built before for the
same sources is read with its code in a few milliseconds.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Sequence
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
        file = io.BytesIO()
        _Pickler(file).dump((beside, tuple(programs), codes))
        return file.getvalue()

    beside, programs, codes = _Unpickler(io.BytesIO(cached(key, build))).load()
    pairs = zip(programs, codes, strict=True)
    return beside, [MachineCode(program, lanes, code) for program, code in pairs]


class _Pickler(pickle.Pickler):
    """Leaves out CasADi's functions: the machine code does what they say."""

    def persistent_id(self, thing: Any) -> str | None:
        """Return a mark for a function."""
        return "function" if type(thing).__module__.startswith("casadi") else None


class _Unpickler(pickle.Unpickler):
    """Makes nothing but what stands beside programs."""

    def persistent_load(self, mark: Any) -> None:
        """Return nothing in the place of a function."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that may stand there."""
        if not module.startswith(MODULES):
            raise pickle.UnpicklingError(f"no machine code comes with {module}.{name}")
        return super().find_class(module, name)
