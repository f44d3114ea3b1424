"""Ctrl-C and its like at any moment: one line, an exit code, no traceback.

Before a command begins there is nothing to lose, and a signal ends the process at once. While it
runs, a signal raises `Interrupted`, so that files stay whole and what was simulated is kept. This
module is imported before all others and imports little itself.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
SIGNALLED = 128  # exit code of a process that a signal ended, less the signal's number
PATIENCE = 2.0  # s after a signal in which another one changes nothing; later, it ends at once
RETRY = 0.01  # s until a signal that came during an import is looked at again
IMPORTER = "<frozen importlib._bootstrap>"  # the file of the frames of an import


class Interrupted(KeyboardInterrupt):
    """A signal that ends the command.

    Attributes:
        number: Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(WORDS[signal.Signals(number)])
        self.number = number


def leave_at_signals() -> None:
    """Let signals end the process at once, but for those that its parent ignores."""
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)


@contextmanager
def raised_signals() -> Iterator[None]:
    """Let signals raise `Interrupted` inside the ``with`` block, and ignore them behind it.

    Nothing changes in a process whose signals are its own, as that of a test or a notebook.
    """
    found = [number for number in SIGNALS if signal.getsignal(number) is _leave]
    if not found:
        yield
        return
    interrupts = _Interrupts()
    sys.unraisablehook = interrupts.on_unraisable
    signal.signal(signal.SIGALRM, interrupts.again)
    for number in found:
        signal.signal(number, interrupts.on_signal)
    try:
        yield
    finally:
        for number in (*found, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)


def ignore_signals() -> None:
    """Let signals change nothing any more: all is done, and the process ends."""
    for number in SIGNALS:
        if signal.getsignal(number) is _leave:
            signal.signal(number, signal.SIG_IGN)


def exit_code(error: KeyboardInterrupt) -> int:
    """Return the exit code of a command that was interrupted."""
    return SIGNALLED + (error.number if isinstance(error, Interrupted) else signal.SIGINT)


def _leave(number: int, frame: object = None) -> None:
    try:
        os.write(2, f"{WORDS[signal.Signals(number)]}\n".encode())
    finally:
        os._exit(SIGNALLED + number)


class _Interrupts:
    """The signals that came while a command runs."""

    def __init__(self) -> None:
        self._number = 0  # of the first signal
        self._asked = 0.0  # when it came, s

    def on_signal(self, number: int, frame: object) -> None:
        """Raise at the first signal; end the process at one that comes when patience is over."""
        if not self._number:
            self._number, self._asked = number, time.monotonic()
            self.again(number, frame)
        elif time.monotonic() > self._asked + PATIENCE:
            _leave(number)

    def again(self, _: int, frame: object) -> None:
        """Raise, unless a module is being imported; then look again a little later.

        Modules in C turn what is raised in their imports into errors of their own.

        Raises:
            Interrupted: Always, but for imports.
        """
        if _imports(frame):
            signal.setitimer(signal.ITIMER_REAL, RETRY)
        else:
            raise Interrupted(self._number)

    def on_unraisable(self, lost: object) -> None:
        """Raise again later what was raised where nothing can be, as in a destructor."""
        if isinstance(getattr(lost, "exc_value", None), Interrupted):
            signal.setitimer(signal.ITIMER_REAL, RETRY)
        else:
            sys.__unraisablehook__(lost)  # type: ignore[arg-type]


def _imports(frame: object) -> bool:
    """Return whether a frame is called, however far above, by the import of a module."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORTER:  # type: ignore[attr-defined]
            return True
        frame = frame.f_back  # type: ignore[attr-defined]
    return False
