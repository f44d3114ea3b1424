"""Computing beside a controller's samples: in a thread, or as if it took a time in a simulation."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Generic, TypeVar

ComputingTime = float | str  # s, or "measured"
REMEMBERED_DELAYS = 20  # results: the longest of them is expected next
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time

Result = TypeVar("Result")


@dataclass
class SimulatedTime:
    """What computing takes in a simulation, in the place of what it takes on this machine.

    Attributes:
        computing_time: Of a computation, s, or "measured": its processor time.
        spent_in_background: Processor time of what was computed beside the samples, s.
    """

    computing_time: ComputingTime = 0.0
    spent_in_background: float = 0.0


_simulated: ContextVar[SimulatedTime | None] = ContextVar("simulated", default=None)


@contextmanager
def in_simulated_time(simulated: SimulatedTime) -> Iterator[None]:
    """Let the laws that are started meanwhile compute in simulated time."""
    token = _simulated.set(simulated)
    try:
        yield
    finally:
        _simulated.reset(token)


class Background(Generic[Result]):
    """Runs one computation at a time, whose result comes later; times are those of the samples.

    In simulated time it computes at once, and holds the result back for the time that it takes.

    Attributes:
        largest_delay: Of a result so far, s.
    """

    def __init__(self) -> None:
        self._simulated = _simulated.get()
        self._thread = None if self._simulated else ThreadPoolExecutor(1, "horizon")
        self._running: Future[Result] | None = None
        self._began = self._held_back = self.largest_delay = 0.0
        self._delays = deque[float](maxlen=REMEMBERED_DELAYS)

    @property
    def busy(self) -> bool:
        """Whether a computation runs, or its result waits."""
        return self._running is not None

    @property
    def expected_delay(self) -> float:
        """The longest of the last delays, s; 0 before the first."""
        return max(self._delays, default=0.0)

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Begin a computation at a time (s)."""
        self._began = t
        if self._thread is not None:
            self._running = self._thread.submit(compute)
        elif self._simulated is not None:
            self._running, began = Future(), time.thread_time()
            self._running.set_result(compute())
            spent, stated = time.thread_time() - began, self._simulated.computing_time
            self._held_back = spent if isinstance(stated, str) else stated
            self._simulated.spent_in_background += spent

    def result(self, t: float) -> Result | None:
        """Return the result that is there at a time (s), once."""
        running, due = self._running, self._began + self._held_back - TIME_ROUNDING
        if running is None or not running.done() or t < due:
            return None
        self._running, delay = None, self._held_back if self._simulated else t - self._began
        self._delays.append(delay)
        self.largest_delay = max(self.largest_delay, delay)
        return running.result()
