"""A program compiled: it does what its interpreter does, thousands of times faster."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.compiled.machine.cache import cached
from rpctl.simulation.compiled.machine.identity import code_key
from rpctl.simulation.compiled.machine.lowering import ALIGNMENT, Functions, offsets
from rpctl.simulation.compiled.machine.program import (
    Buffer,
    Program,
    Rows,
    RowStream,
    Write,
)
from rpctl.simulation.compiled.machine.stepping import STREAM_FIELDS, StepLines
from rpctl.simulation.compiled.machine.target import Loaded, object_code, this_processor

ATTRIBUTES = (  # the stack is aligned so that no spilled vector lies in two cache lines
    'attributes #0 = {{ nounwind "stackrealign"'
    ' "prefer-vector-width"="{0}" "min-legal-vector-width"="{0}" }}'
)


def compile_program(program: Program, lanes: int) -> MachineCode:
    """Return a kernel of machine code for this processor; it is kept on disk.

    Args:
        program: The program.
        lanes: How many runs go side by side, a power of two. A run among :func:`native_lanes` is
            done soonest; with more, numbers no longer fit the registers, and it is slower to build
            and to run.

    Raises:
        RpctlError: There is no machine code for an operation of one of its functions.
    """
    processor = this_processor()
    key = code_key(program, lanes, processor)
    code = cached(key, lambda: object_code(module_text(program, lanes), processor))
    return MachineCode(program, lanes, code)


def native_lanes() -> int:
    """Return how many runs one register of this processor holds: 8, 4 or 2."""
    return this_processor().lanes


def module_text(program: Program, lanes: int) -> str:
    """Return a program in LLVM's language; ``run`` is the function that takes steps.

    Args:
        program: The program.
        lanes: How many runs go side by side, a power of two.
    """
    if lanes < 1 or lanes & (lanes - 1):
        raise ValueError(f"{lanes} lanes: give a power of two")
    functions = Functions(program, lanes)
    attributes = ATTRIBUTES.format(max(128, 64 * lanes))
    return "\n".join((functions.text(), StepLines(program, functions).text(), attributes, ""))


class MachineCode:
    """A kernel of machine code; it may run in several threads, each with its own workspace.

    Args:
        program: The program.
        lanes: How many runs go side by side.
        code: Object code of the program's module.
    """

    def __init__(self, program: Program, lanes: int, code: bytes) -> None:
        self.program, self.lanes, self.code = program, lanes, code
        self._offsets = offsets(program, lanes)
        self._written = {x.stream for x in program.statements() if isinstance(x, Write)}
        self._loaded = Loaded(code)
        words = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 2
        self._run = ctypes.CFUNCTYPE(ctypes.c_int64, *words)(self._loaded.address)

    def workspace(self) -> Mapping[Buffer, Array]:
        """Return buffers (size, lanes) of zeros; views of one block of memory."""
        size = sum(-(-8 * x.size * self.lanes // ALIGNMENT) * ALIGNMENT for x in self._offsets)
        block = np.zeros(size + ALIGNMENT, np.uint8)
        start = -block.ctypes.data % ALIGNMENT
        return {
            x: block[start + at : start + at + 8 * x.size * self.lanes]
            .view(np.float64)
            .reshape(x.size, self.lanes)
            for x, at in self._offsets.items()
        }

    def run(
        self,
        first: int,
        steps: int,
        workspace: Mapping[Buffer, Array],
        streams: Mapping[RowStream, Rows],
    ) -> int:
        """Do steps and return how many were done; see :class:`Kernel`.

        Args:
            first: Number of the first step.
            steps: How many.
            workspace: What :meth:`workspace` returned, with the values to start from; changed.
            streams: The rows of each stream.
        """
        table = np.zeros((len(self.program.streams), len(STREAM_FIELDS)), np.int64)
        for k, stream in enumerate(self.program.streams):
            rows = streams[stream]
            self._check(stream, rows, first, steps)
            table[k] = rows.values.ctypes.data, len(rows.values), rows.every, rows.ring
        start = self._block(workspace)
        return int(self._run(first, steps, start, table.ctypes.data))

    def _block(self, workspace: Mapping[Buffer, Array]) -> int:
        """Return where the block of a workspace begins."""
        if not self._offsets:
            return 0
        start = next(workspace[x].ctypes.data for x in self._offsets if x.size)
        for x, at in self._offsets.items():
            found = workspace[x]
            if found.shape != (x.size, self.lanes) or (x.size and found.ctypes.data != start + at):
                raise ValueError(
                    f"buffer {x.name}: not of this kernel's workspace; fill it in place"
                )
        return start

    def _check(self, stream: RowStream, rows: Rows, first: int, steps: int) -> None:
        """Refuse rows that do not fit their stream; the memory is addressed unchecked."""
        values = rows.values
        row = (stream.width, self.lanes) if stream.laned else (stream.width,)
        if values.shape[1:] != row or values.dtype != np.float64 or not values.flags.c_contiguous:
            raise ValueError(f"rows {stream.name}: not contiguous doubles (rows, {row})")
        if rows.every < 1 or first % rows.every:
            raise ValueError(f"rows {stream.name}: {first} is no multiple of {rows.every} steps")
        needed = 1 if rows.ring else -(-steps // rows.every)
        if len(values) < needed:
            raise ValueError(f"rows {stream.name}: {len(values)} rows, {needed} needed")
        if stream in self._written and not values.flags.writeable:
            raise ValueError(f"rows {stream.name}: they are written, but read-only")
