"""What watches a simulation is kept apart from what computes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, ParamSpec

Shown = ParamSpec("Shown")


class Watching(Generic[Shown]):
    """Calls a watcher; its first fault ends the watching, never the simulation.

    What asks for the simulation's end by KeyboardInterrupt is obeyed.

    Args:
        what: What watches, in words that begin a note.
        watcher: Is called; None: nothing is.

    Attributes:
        notes: One sentence on its fault, or none.
    """

    def __init__(self, what: str, watcher: Callable[Shown, object] | None) -> None:
        self._what, self._watcher = what, watcher
        self.notes: tuple[str, ...] = ()

    def __call__(self, *values: Shown.args, **named: Shown.kwargs) -> None:
        """Call the watcher, unless it has failed before."""
        if self._watcher is None:
            return
        try:
            self._watcher(*values, **named)
        except Exception as error:
            self._watcher = None
            reason = f"{type(error).__name__}: {error}".removesuffix(": ")
            self.notes = (f"{self._what} failed and was left out from then on ({reason})",)
