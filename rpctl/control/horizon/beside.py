"""Computing beside a controller's samples: in a thread, or as if it took a time in a simulation."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

ComputingTime = float | str  # s, or "measured"
REMEMBERED_DELAYS = 20  # results: the longest of them is expected next
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time

Result = TypeVar("Result")
Result_co = TypeVar("Result_co", covariant=True)


@dataclass
class SimulatedTime:
    """What computing takes in a simulation, in the place of what it takes on this machine.

    Attributes:
        computing_time: Of a computation, s, or "measured": its processor time.
        spent_beside: Processor time of what was computed beside the samples, s.
    """

    computing_time: ComputingTime = 0.0
    spent_beside: float = 0.0


_simulated: ContextVar[SimulatedTime | None] = ContextVar("simulated", default=None)


@contextmanager
def in_simulated_time(simulated: SimulatedTime) -> Iterator[None]:
    """Let the laws that are started meanwhile compute in simulated time."""
    token = _simulated.set(simulated)
    try:
        yield
    finally:
        _simulated.reset(token)


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
        """End the thread; waits for what it computes."""
        self._threads.shutdown(wait=True, cancel_futures=True)


class ChargedBeside(Delays, Generic[Result]):
    """Computes at once, and holds the result back for the time it takes.

    Args:
        simulated: What computing takes.
    """

    def __init__(self, simulated: SimulatedTime) -> None:
        super().__init__()
        self._simulated = simulated
        self._result: Result | None = None
        self._began = self._delay = 0.0

    @property
    def busy(self) -> bool:
        """Whether a result waits."""
        return self._result is not None

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Compute; the result is held back."""
        began = time.thread_time()
        self._result = compute()
        spent = time.thread_time() - began
        stated = self._simulated.computing_time
        self._began, self._delay = t, spent if isinstance(stated, str) else stated
        self._simulated.spent_beside += spent

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


def compute_beside() -> Beside[Any]:
    """Return a thread, or what stands for one in a simulation."""
    simulated = _simulated.get()
    return ThreadBeside() if simulated is None else ChargedBeside(simulated)
