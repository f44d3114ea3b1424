"""A force from outside: somebody pushes or pulls a link."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rpctl.errors import RpctlError, require_within

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

    @property
    def until(self) -> float:
        """When they end, s; infinite if that is not before the run."""
        return math.inf if self.end is None else self.end
