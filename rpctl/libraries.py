"""Libraries that take long to import, imported where they are needed, and whole."""

from __future__ import annotations

import signal
import threading
from importlib import import_module
from types import FrameType
from typing import Any


def library(name: str) -> Any:
    """Return a library; a Ctrl-C while it is imported waits until it is.

    Trimesh, and with it yourdfpy, takes every exception of an optional import for its absence: a
    Ctrl-C that came just then would be lost.
    """
    if threading.current_thread() is not threading.main_thread():
        return import_module(name)  # signals are the main thread's
    held: list[tuple[int, FrameType | None]] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: held.append(arguments))
    try:
        return import_module(name)
    finally:
        signal.signal(signal.SIGINT, before)
        if held and callable(before):
            before(*held[0])
