"""A program compiled by LLVM: object code for a processor, and object code in memory."""

from __future__ import annotations

import ctypes
import hashlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.kernels.cache import cached, sources
from rpctl.kernels.functions import ALIGNMENT, Functions, offsets
from rpctl.kernels.program import Buffer, Call, Program, Read, Rows, RowStream, Write
from rpctl.kernels.stepping import STREAM_FIELDS, StepLines

ATTRIBUTES = (  # the stack is aligned so that no spilled vector lies in two cache lines
    'attributes #0 = {{ nounwind "stackrealign"'
    ' "prefer-vector-width"="{0}" "min-legal-vector-width"="{0}" }}'
)


def compile_program(program: Program, lanes: int) -> MachineCode:
    """Return a kernel of machine code for this processor.

    Args:
        program: The program.
        lanes: How many runs go side by side, a power of two. A run among :func:`native_lanes` is
            done soonest; with more, numbers no longer fit the registers, and it is slower to build
            and to run.

    Raises:
        RpctlError: There is no machine code for an operation of one of its functions.
    """
    return MachineCode(program, lanes, object_code(module_text(program, lanes), this_processor()))


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
        """Do steps and return how many were done: fewer where one of them was left.

        Args:
            first: Number of the first step; it is a multiple of every stream's ``every``.
            steps: How many.
            workspace: What :meth:`workspace` returned, with the values to start from; changed.
            streams: The rows of each stream.
        """
        table = self._table(first, steps, streams)
        return int(self._run(first, steps, self._block(workspace), table.ctypes.data))

    def stepper(
        self, workspace: Mapping[Buffer, Array], streams: Mapping[RowStream, Rows] | None = None
    ) -> Callable[..., bool]:
        """Return what does steps in a workspace, and returns whether they were done to their end.

        It does one step unless it is given the number of a first one, and how many. The streams are
        rings; they and the workspace have to live as long as it is used.
        """
        table = self._table(0, 1, streams or {})
        start, rows = self._block(workspace), table.ctypes.data_as(ctypes.c_void_p)
        # It keeps this object alive, and with it the code that runs.
        return lambda first=0, steps=1: self._run(first, steps, start, rows) == steps

    def _table(self, first: int, steps: int, streams: Mapping[RowStream, Rows]) -> Any:
        """Return what the code has to know of the streams."""
        table = np.zeros((len(self.program.streams), len(STREAM_FIELDS)), np.int64)
        for k, stream in enumerate(self.program.streams):
            rows = streams[stream]
            self._check(stream, rows, first, steps)
            table[k] = rows.values.ctypes.data, len(rows.values), rows.every, rows.ring
        return table

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


LEVEL = 1  # of LLVM's code generator; 2 and 3 take longer and make nothing faster
_SERIAL = count()
_LOCK = threading.Lock()  # LLVM's global context is for one thread at a time


@dataclass(frozen=True)
class Processor:
    """What machine code is for.

    Attributes:
        name: LLVM's name of the processor.
        features: Its features, such as ``"+avx2,-avx512f"``.
    """

    name: str
    features: str

    @property
    def lanes(self) -> int:
        """How many doubles a vector register holds."""
        features = self.features.split(",")
        return 8 if "+avx512f" in features else 4 if "+avx" in features else 2


@cache
def this_processor() -> Processor:
    """Return the processor that this process runs on."""
    binding = _binding()
    return Processor(binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())


def compiler_version() -> str:
    """Return what tells the code of one LLVM from that of another."""
    import llvmlite

    numbers = ".".join(str(x) for x in _binding().llvm_version_info)
    return f"llvmlite {llvmlite.__version__}, LLVM {numbers}, level {LEVEL}"


def code_key(*parts: object) -> bytes:
    """Return a hash of all that machine code depends on: compiler, sources of rpctl, and parts.

    Args:
        *parts: What else; their ``repr`` tells one from another.
    """
    import casadi

    tools = casadi.CasadiMeta.version(), compiler_version(), this_processor()
    return hashlib.sha256(repr((sources(), tools, parts)).encode()).digest()


def object_code(module: str, processor: Processor) -> bytes:
    """Return relocatable object code.

    Args:
        module: A module in LLVM's language.
        processor: What it is for.
    """
    binding = _binding()
    with _LOCK:
        parsed = binding.parse_assembly(module)
        parsed.verify()
        return bytes(_target_machine(processor).emit_object(parsed))


class Loaded:
    """Object code in memory that is executable while this lives.

    Args:
        code: What :func:`object_code` returned.

    Attributes:
        address: Where its function ``run`` begins.
    """

    def __init__(self, code: bytes) -> None:
        binding = _binding()
        builder = binding.JITLibraryBuilder().add_object_img(code).export_symbol("run")
        with _LOCK:
            self._library = builder.link(_linker(), f"rpctl_{next(_SERIAL)}")
        self.address: int = self._library["run"]


@cache
def _linker() -> Any:
    binding = _binding()
    return binding.create_lljit_compiler(_target_machine(this_processor()))


def _target_machine(processor: Processor) -> Any:
    binding = _binding()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(
        cpu=processor.name,
        features=processor.features,
        opt=LEVEL,
        reloc="pic",
        codemodel="small",
        jit=True,
    )


@cache
def _binding() -> Any:
    import llvmlite.binding

    llvmlite.binding.initialize_native_target()
    llvmlite.binding.initialize_native_asmprinter()
    return llvmlite.binding


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
