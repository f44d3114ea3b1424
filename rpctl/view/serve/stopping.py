"""Ctrl-C, SIGTERM and a page's button: how they end what is served, or a simulation."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, "FrameType | None"], object]


@contextmanager
def signals(handler: Handler) -> Iterator[None]:
    """Let SIGINT and SIGTERM call a handler inside the ``with`` block."""
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, each in before.items():
            signal.signal(number, each)


class StopRequest:
    """Whether a simulation is to end: it looks after each sample, so that samples stay whole.

    Attributes:
        running: Whether a simulation runs that looks.
    """

    def __init__(self) -> None:
        self.running = False
        self._asked = threading.Event()

    @property
    def asked(self) -> bool:
        """Whether the simulation is to end."""
        return self._asked.is_set()

    def begin(self) -> None:
        """A simulation begins."""
        self._asked.clear()
        self.running = True

    def ask(self, _: object = None) -> None:
        """End the simulation if one runs; called from any thread."""
        if self.running:
            self._asked.set()

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """End the simulation; the handler of a signal.

        Raises:
            KeyboardInterrupt: No simulation runs, or it was asked before and does not end.
        """
        if not self.running or self.asked:
            raise KeyboardInterrupt
        self._asked.set()
