"""Whole loops on disk: what a loop is, without the graphs that its machine code was made of.

Building a graph takes as long as a thousand seconds of simulation. A loop that was built before for
the same robot, laws and sources is read with its code in a few milliseconds.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import rpctl
from rpctl.robot.identity import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.loop import LoopProgram, LoopShape
from rpctl.simulation.compiled.machine.cache import cached
from rpctl.simulation.compiled.machine.code import MachineCode
from rpctl.simulation.compiled.machine.target import compiler_version, this_processor

OWN_MODULES = "rpctl.simulation.compiled.", "rpctl.control.law"  # of what a loop consists of


class LoopCode(NamedTuple):
    """A loop with its machine code.

    Attributes:
        program: Its program.
        start: Code of what is done before the first sample.
        sample: Code of a sample.
    """

    program: LoopProgram
    start: MachineCode
    sample: MachineCode


def stored_loop(key: bytes, lanes: int, build: Callable[[], LoopCode]) -> LoopCode:
    """Return the loop that is stored under a key; if there is none, build and store it.

    Args:
        key: See :func:`loop_key`.
        lanes: How many runs go side by side.
        build: Builds it.
    """
    built: list[LoopCode] = []

    def make() -> bytes:
        built.append(build())
        program, start, sample = built[0]
        return _dumped((program, start.code, sample.code))

    data = cached(key, make)
    if built:
        return built[0]
    program, start, sample = _Unpickler(io.BytesIO(data)).load()
    return LoopCode(
        program,
        MachineCode(program.start, lanes, start),
        MachineCode(program.sample, lanes, sample),
    )


def loop_key(known: Robot, simulated: Robot, laws: tuple[Any, ...], shape: LoopShape) -> bytes:
    """Return a hash of all that a loop of one lane depends on.

    Args:
        known: The robot that the controller computes with.
        simulated: The simulated robot.
        laws: The laws, whose text says all of their settings.
        shape: What else is compiled in.
    """
    import casadi

    parts = (
        "a loop",
        (_sources(), casadi.CasadiMeta.version(), compiler_version(), this_processor()),
        [robot_identity(robot) for robot in (known, simulated)],
        (laws, shape),
    )
    return hashlib.sha256(repr(parts).encode()).digest()


@cache
def _sources() -> str:
    """Return what tells the sources of this rpctl from others: sizes and times of its files."""
    folder = Path(rpctl.__file__).parent
    stats = ((file, file.stat()) for file in sorted(folder.rglob("*.py")))
    told = [(str(f.relative_to(folder)), s.st_size, s.st_mtime_ns) for f, s in stats]
    return repr((str(folder), told))


class _Pickler(pickle.Pickler):
    """Leaves out CasADi's functions: the machine code does what they say."""

    def persistent_id(self, thing: Any) -> str | None:
        """Return a mark for a function."""
        return "function" if type(thing).__module__.startswith("casadi") else None


class _Unpickler(pickle.Unpickler):
    """Makes nothing but what a loop consists of."""

    def persistent_load(self, mark: Any) -> None:
        """Return nothing in the place of a function."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that a loop has."""
        if not module.startswith(OWN_MODULES):
            raise pickle.UnpicklingError(f"a loop has no {module}.{name}")
        return super().find_class(module, name)


def _dumped(value: Any) -> bytes:
    file = io.BytesIO()
    _Pickler(file, protocol=pickle.HIGHEST_PROTOCOL).dump(value)
    return file.getvalue()
