"""LLVM: from a module's text to object code for a processor, and object code into memory."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache
from itertools import count
from typing import Any

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
