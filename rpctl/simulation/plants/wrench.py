"""A force from outside: somebody pushes or pulls a link."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rpctl.errors import RpctlError, require_within

TIME_ROUNDING = 1e-9  # s: rounding of a sample's time
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Wrench:
    """A force and a moment that act on a link for a while.

    Attributes:
        link: The link.
        force: At the origin of its frame (3,), world axes, N.
        moment: (3,), world axes, N·m.
        start: When they begin, s.
        end: When they end, s; None: not before the run.
    """

    link: str
    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    start: float = 0.0
    end: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no force, and what ends before it begins."""
        require_within(f"the force on {self.link}", self.force)
        require_within(f"the moment on {self.link}", self.moment)
        require_within(f"the start of the push on {self.link}", [self.start])
        if not 0.0 <= self.start < self.until:
            raise RpctlError(
                f"the push on {self.link} lasts from {self.start:g} to {self.until:g} s; give a "
                "start of 0 or more, and an end after it"
            )

    def acts(self, t: float) -> bool:
        """Return whether they act at a time (s)."""
        return self.start - TIME_ROUNDING <= t < self.until - TIME_ROUNDING

    @property
    def until(self) -> float:
        """When they end, s; infinite if that is not before the run."""
        return math.inf if self.end is None else self.end


def pushes(
    wrenches: Sequence[Wrench], t: float, duration: float
) -> Iterator[tuple[float, tuple[Wrench, ...]]]:
    """Yield how long (s) which wrenches act, one after another.

    Args:
        wrenches: All that there are.
        t: From when on, s.
        duration: For how long, s.
    """
    end = t + duration
    changes = {time for each in wrenches for time in (each.start, each.until)}
    inside = [x for x in sorted(changes) if t + TIME_ROUNDING < x < end - TIME_ROUNDING]
    for begin, after in pairwise((t, *inside, end)):
        yield after - begin, tuple(each for each in wrenches if each.acts(begin))
