"""Functions that are called sample by sample: in CasADi's virtual machine, or as machine code."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from rpctl.arrays import Array
from rpctl.kernels.cache import cached
from rpctl.kernels.machine_code import MachineCode, code_key, compile_program
from rpctl.kernels.program import Buffer, Call, Program
from rpctl.kernels.virtual_machine import VirtualMachine


class SampleFunction(threading.local):
    """Calls a function of columns; threads may share it, for each has its own workspace.

    Args:
        kernel: Calls it.
        inputs: Where the kernel reads.
        outputs: Where it writes.
    """

    def __init__(
        self,
        kernel: MachineCode | VirtualMachine,
        inputs: Sequence[Buffer],
        outputs: Sequence[Buffer],
    ) -> None:
        at = kernel.workspace()  # in every thread anew
        self._run = kernel.stepper(at)
        self._inputs, self._outputs = ([at[x][:, 0] for x in group] for group in (inputs, outputs))

    def __call__(self, *columns: Any) -> list[Array]:
        """Return the outputs' columns, which the thread's next call overwrites."""
        for place, values in zip(self._inputs, columns, strict=True):
            place[:] = values
        self._run()
        return self._outputs


def interpreted(function: Any) -> SampleFunction:
    """Return a ``casadi.Function`` as one of columns; matrices come column by column."""
    ins = [Buffer(f"i{k}", function.numel_in(k)) for k in range(function.n_in())]
    outs = [Buffer(f"o{k}", function.numel_out(k)) for k in range(function.n_out())]
    program = Program((Call(function, tuple(ins), tuple(outs)),))
    return SampleFunction(VirtualMachine(program), ins, outs)


def compiled(
    sizes: tuple[Sequence[int], Sequence[int]], parts: object, make: Callable[[], Any]
) -> SampleFunction:
    """Return a function as machine code, from disk if it was ever compiled.

    Args:
        sizes: Of its input columns, and of its output columns.
        parts: All that it depends on besides the sources of rpctl; see :func:`code_key`.
        make: Makes the ``casadi.Function`` of dense columns.
    """
    ins, outs = (
        tuple(Buffer(f"{name}{k}", size) for k, size in enumerate(group))
        for name, group in zip("io", sizes, strict=True)
    )

    def program(function: Any) -> Program:
        return Program((Call(function, ins, outs),))

    key = code_key("sample", sizes, parts)
    code = cached(key, lambda: compile_program(program(make()), 1).code)
    return SampleFunction(MachineCode(program(None), 1, code), ins, outs)
