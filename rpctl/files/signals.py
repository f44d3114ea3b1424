"""Moments in which a Ctrl-C and its like have to wait."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

NAMES = "SIGINT", "SIGTERM", "SIGHUP", "SIGALRM"


@contextmanager
def held_signals() -> Iterator[None]:
    """Let signals whose handlers are Python's wait for the end of the ``with`` block.

    A mask would not do: any other thread of the process may take the signal, and its handler still
    runs in the main one. In other threads nothing changes, for handlers never run there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    numbers = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    own = [number for number, handler in before.items() if callable(handler)]
    for number in own:
        signal.signal(number, lambda *told: held.append(told))
    try:
        yield
    finally:
        for number in own:
            signal.signal(number, before[number])
        if held:
            number, frame = held[0]
            before[number](number, frame)  # type: ignore[operator, misc]
