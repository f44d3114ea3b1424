"""A function of columns as machine code that takes many rows of them in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.kernels.cache import cached
from rpctl.kernels.machine_code import MachineCode, code_key, compile_program
from rpctl.kernels.program import Buffer, Call, Program, Read, Rows, RowStream, Write


class RowFunction:
    """Calls a function row by row, from disk if it was ever compiled.

    Args:
        sizes: Of its input columns, and of its output columns.
        kept: Sizes of further columns, inputs and outputs both, that go from each row to the next.
        parts: All that the function depends on besides the sources of rpctl; their ``repr`` tells
            one from another.
        make: Makes the ``casadi.Function`` of dense columns: inputs and kept, outputs and kept.
    """

    def __init__(
        self,
        sizes: tuple[Sequence[int], Sequence[int]],
        parts: object,
        make: Callable[[], Any],
        kept: Sequence[int] = (),
    ) -> None:
        number = count()
        inputs, outputs, passed = (
            tuple(Buffer(f"b{next(number)}", size) for size in group) for group in (*sizes, kept)
        )
        self._inputs, self._outputs = (
            [(RowStream(f"rows {b.name}", b.size, laned), b) for b in group]
            for group, laned in ((inputs, False), (outputs, True))
        )
        self._kept = passed

        def program(function: Any) -> Program:
            call = Call(function, (*inputs, *passed), (*outputs, *passed))
            reads = (Read(stream, buffer) for stream, buffer in self._inputs)
            writes = (Write(buffer, stream) for stream, buffer in self._outputs)
            return Program((*reads, call, *writes))

        key = code_key("rows", sizes, kept, parts)
        code = cached(key, lambda: compile_program(program(make()), 1).code)
        self._code = MachineCode(program(None), 1, code)

    def __call__(self, *rows: Array, kept: Sequence[Array] = ()) -> list[Array]:
        """Return the rows (K, size) of each output.

        Args:
            *rows: Rows (K, size) of each input.
            kept: The further columns before the first row; changed, they are those after the last.
        """
        workspace, found = self._code.workspace(), []
        streams = {
            stream: Rows(np.ascontiguousarray(values, dtype=float))
            for (stream, _), values in zip(self._inputs, rows, strict=True)
        }
        for stream, _ in self._outputs:
            found.append(np.empty((len(rows[0]), stream.width, 1)))
            streams[stream] = Rows(found[-1])
        for buffer, values in zip(self._kept, kept, strict=True):
            workspace[buffer][:, 0] = values
        self._code.run(0, len(rows[0]), workspace, streams)
        for buffer, values in zip(self._kept, kept, strict=True):
            values[:] = workspace[buffer][:, 0]
        return [values[:, :, 0] for values in found]
