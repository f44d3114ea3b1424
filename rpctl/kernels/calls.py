"""Functions that are called sample by sample: in CasADi's virtual machine, or as machine code."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

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


class Layout(NamedTuple):
    """A program, and where it reads and writes."""

    program: Program
    inputs: Sequence[Buffer]
    outputs: Sequence[Buffer]


def compiled(
    parts: object,
    lay: Callable[[Mapping[str, Any]], Layout],
    make: Callable[[], Mapping[str, Any]],
) -> SampleFunction:
    """Return a program as machine code, from disk if it was ever compiled.

    Args:
        parts: All that it depends on besides the sources of rpctl; see :func:`code_key`.
        lay: Makes the program of functions by name; of code from disk they are None.
        make: Makes the functions, ``casadi.Function`` of dense columns.
    """
    code = cached(code_key("sample", parts), lambda: compile_program(lay(make()).program, 1).code)
    program, inputs, outputs = lay(defaultdict(lambda: None))
    return SampleFunction(MachineCode(program, 1, code), inputs, outputs)
