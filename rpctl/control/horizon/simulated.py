"""Planning beside the samples in a simulation: what it takes there is told, or measured."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from rpctl.control.horizon.planner import Asked, Planned
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.reference.motion import Reference

ComputingTime = float | str  # s, or "measured"
REMEMBERED_DELAYS = 20
EXPECTED_RANK = 15  # of them, in ascending order: the delay to expect; few come later


@dataclass
class SimulatedTime:
    """What computing takes in a simulation, in the place of what it takes on this machine.

    Attributes:
        computing_time: Of a computation, s, or "measured": its processor time.
        spent_in_background: Processor time of what was computed beside the samples, s.
    """

    computing_time: ComputingTime = 0.0
    spent_in_background: float = 0.0


simulated_time: ContextVar[SimulatedTime | None] = ContextVar("simulated", default=None)


@contextmanager
def in_simulated_time(simulated: SimulatedTime) -> Iterator[None]:
    """Let the laws that are started meanwhile compute in simulated time."""
    token = simulated_time.set(simulated)
    try:
        yield
    finally:
        simulated_time.reset(token)


class Delays:
    """How long plans took, s.

    Attributes:
        largest: The longest.
    """

    def __init__(self) -> None:
        self._last = deque[float](maxlen=REMEMBERED_DELAYS)
        self.largest = 0.0

    def add(self, delay: float) -> None:
        """Take note of another, s."""
        self._last.append(delay)
        self.largest = max(self.largest, delay)

    @property
    def expected(self) -> float:
        """What the next is not expected to exceed, s; 0 before the first."""
        if not self._last:
            return 0.0
        return sorted(self._last)[EXPECTED_RANK * len(self._last) // REMEMBERED_DELAYS]


class SimulatedPlanning:
    """What :class:`PlanningProcess` does, in simulated time."""

    def __init__(
        self, planning: Callable[[Reference, Asked], Planned], simulated: SimulatedTime
    ) -> None:
        self._planning, self._simulated = planning, simulated
        self._found: Planned | None = None
        self._due = 0.0

    @property
    def busy(self) -> bool:
        """Whether it owes a plan."""
        return self._found is not None

    def can_begin(self, reference: Reference, t: float, lag: float, delay: float) -> bool:
        """Return whether no plan is on its way."""
        return not self.busy

    def begin(self, reference: Reference, asked: Asked) -> None:
        """Compute a plan, and hold it back."""
        began = time.thread_time()
        self._found = self._planning(reference, asked)
        spent, stated = time.thread_time() - began, self._simulated.computing_time
        self._due = asked.t + (spent if isinstance(stated, str) else stated)
        self._simulated.spent_in_background += spent

    def result(self, t: float) -> Planned | None:
        """Return the plan that is there at a time, once."""
        if self._found is None or t < self._due - TIME_ROUNDING:
            return None
        found, self._found = self._found, None
        return found
