"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # `typing` is not imported here: it would delay the answer to Ctrl-C
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.2.0"
_STUB = __loader__.get_data(f"{__file__}i").decode()  # __init__.pyi: the one list of the names
_WORDS = [line.split() for line in _STUB.splitlines() if line.startswith("from rpctl.")]
_MODULES = {name: module for _, module, _, name, *_ in _WORDS}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__
