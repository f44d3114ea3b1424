"""Computing beside a controller's samples: in a thread, or as if it took a time in a simulation."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, Literal, Protocol, TypeVar

ComputingTime = float | Literal["measured"]  # s
REMEMBERED_DELAYS = 20  # results: the longest of them is expected next
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time

Result = TypeVar("Result")
Result_co = TypeVar("Result_co", covariant=True)


class Beside(Protocol[Result]):
    """Runs one computation at a time, whose result comes later."""

    largest_delay: float  # of a result so far, s

    @property
    def busy(self) -> bool:
        """Whether a computation runs, or its result waits."""

    @property
    def expected_delay(self) -> float:
        """How long the next result will take, s."""

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Begin a computation at a time (s)."""

    def result(self, t: float) -> Result | None:
        """Return the result that is there at a time (s), once."""

    def close(self) -> None:
        """End; no result comes any more."""


class Delays:
    """How long results took."""

    def __init__(self) -> None:
        self._last = deque[float](maxlen=REMEMBERED_DELAYS)
        self.largest_delay = 0.0

    @property
    def expected_delay(self) -> float:
        """The longest of the last delays, s; 0 before the first."""
        return max(self._last, default=0.0)

    def took(self, delay: float) -> None:
        """Take note of a delay, s."""
        self._last.append(delay)
        self.largest_delay = max(self.largest_delay, delay)


class ThreadBeside(Delays, Generic[Result]):
    """A thread that computes; times are those of the samples that begin and fetch."""

    def __init__(self) -> None:
        super().__init__()
        self._threads = ThreadPoolExecutor(1, "horizon")
        self._running: Future[Result] | None = None
        self._began = 0.0

    @property
    def busy(self) -> bool:
        """Whether a computation runs, or its result waits."""
        return self._running is not None

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Begin a computation at a time (s)."""
        self._began, self._running = t, self._threads.submit(compute)

    def result(self, t: float) -> Result | None:
        """Return the result that is there at a time (s), once."""
        running = self._running
        if running is None or not running.done():
            return None
        self._running = None
        self.took(t - self._began)
        return running.result()

    def close(self) -> None:
        """End the thread once it has computed."""
        self._threads.shutdown(wait=False, cancel_futures=True)


class ChargedBeside(Delays, Generic[Result]):
    """Computes at once, and holds the result back for the time it takes.

    Args:
        computing_time: Of each computation, s, or "measured": its processor time.
    """

    def __init__(self, computing_time: ComputingTime) -> None:
        super().__init__()
        self._charge = computing_time
        self._result: Result | None = None
        self._began = self._delay = self.seconds = 0.0

    @property
    def busy(self) -> bool:
        """Whether a result waits."""
        return self._result is not None

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Compute; the result is held back."""
        began = time.thread_time()
        self._result = compute()
        spent = time.thread_time() - began
        self._began, self._delay = t, spent if self._charge == "measured" else float(self._charge)
        self.seconds += spent

    def result(self, t: float) -> Result | None:
        """Return the result that is there at a time (s), once."""
        if self._result is None or t < self._began + self._delay - TIME_ROUNDING:
            return None
        found, self._result = self._result, None
        self.took(self._delay)
        return found

    def close(self) -> None:
        """End."""
        self._result = None
