"""A stream of events to any number of pages; a slow page never delays the sender.

What was sent is kept for pages that come late or again, up to a size: memory stays flat however
long a page is used.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any

KEEPALIVE_S = (
    5.0  # s; a silent stream says this often that it is there, and notices a page that left
)
MAX_KEPT_BYTES = 4 * 2**20  # of the latest events; some eight minutes of a robot's motion
RECONNECT_S = 3.0  # s; a page that is loaded again is away for less


class Stream:
    """A log of server-sent events."""

    def __init__(self) -> None:
        self._log: deque[bytes] = deque()
        self._size = 0  # bytes of the log
        self._first = 0  # number of the first event that is kept
        self._closed = False
        self._readers = 0
        self._left = -float("inf")
        self._changed = threading.Condition()

    def send(self, kind: str, value: Any) -> None:
        """Add an event.

        Args:
            kind: Its name in the page.
            value: Its data, sent as JSON.
        """
        data = json.dumps(value, separators=(",", ":"), allow_nan=False)
        with self._changed:
            number = self._first + len(self._log)
            event = f"id: {number}\nevent: {kind}\ndata: {data}\n\n".encode()
            self._log.append(event)
            self._size += len(event)
            while self._size > MAX_KEPT_BYTES and len(self._log) > 1:
                self._size -= len(self._log.popleft())
                self._first += 1
            self._changed.notify_all()

    def forget(self) -> None:
        """Drop the events so far; a page that comes later does not receive them."""
        with self._changed:
            self._first += len(self._log)
            self._log.clear()
            self._size = 0

    def close(self) -> None:
        """End the stream; pages still receive the events already sent."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def events(self, first: int = 0) -> Iterator[bytes]:
        """Yield the events from number ``first`` on, waiting for each, until the stream is closed.

        A comment that pages ignore comes where there is no event for ``KEEPALIVE_S`` seconds.
        """
        at, closed = first, False

        def news() -> bool:
            return self._closed or self._first + len(self._log) > at

        while not closed:
            with self._changed:
                self._changed.wait_for(news, KEEPALIVE_S)
                batch = [*islice(self._log, max(at - self._first, 0), None)]
                closed = self._closed
                at = self._first + len(self._log)
            yield b"".join(batch) or b":\n\n"

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Count a page as a reader inside the ``with`` block."""
        with self._changed:
            self._readers += 1
            self._changed.notify_all()
        try:
            yield
        finally:
            with self._changed:
                self._readers -= 1
                self._left = time.monotonic()

    @property
    def readers(self) -> int:
        """Number of pages reading now."""
        return self._readers

    @property
    def watched(self) -> bool:
        """Whether a page reads now, or did within the last ``RECONNECT_S`` seconds."""
        return self._readers > 0 or time.monotonic() - self._left < RECONNECT_S

    def wait_reader(self, seconds: float) -> bool:
        """Wait until a page reads; return whether one came in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._readers > 0, seconds)
