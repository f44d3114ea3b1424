"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

import sys
from importlib import import_module

TYPE_CHECKING = False  # `typing` is not imported here: it would delay the answer to Ctrl-C
if TYPE_CHECKING:
    from typing import Any

    from rpctl import Run

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


def load_ipython_extension(shell: Any) -> None:
    """Let a notebook show a `Run` as a scene to be played (``%load_ext rpctl``).

    Where IPython runs already, ``import rpctl`` has done this.

    Args:
        shell: The notebook's ``InteractiveShell``.
    """

    def scene(run: Run) -> str:
        from rpctl.view.film import show

        return show(run)

    html = shell.display_formatter.formatters["text/html"]
    html.for_type_by_name("rpctl.simulation.run.run", "Run", scene)


if "IPython" in sys.modules and (shell := sys.modules["IPython"].get_ipython()):
    load_ipython_extension(shell)
