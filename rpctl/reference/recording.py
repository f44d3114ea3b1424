"""What became of a table on its way to a reference, and what that still asks of its robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rpctl.reference.demands import Demand
from rpctl.reference.jumps import Jump
from rpctl.reference.retiming import Retimed
from rpctl.reference.row_fit import SmoothedColumns
from rpctl.reference.timed_path import TimedPath

MOST_TOLD = 3  # demands, and jumps, that are told in full


@dataclass(frozen=True)
class Recording:
    """A table as it is tracked.

    Attributes:
        smooth: What was asked of smoothing: metres, ``auto`` or None.
        smoothed: What that changed; empty where the rows have no noise.
        retimed: How it was slowed down; None where it was not asked for.
        jumps: Rows that lie far from those about them.
        demands: What it asks beyond the robot's limits, the worst first.
    """

    smooth: float | str | None
    smoothed: tuple[SmoothedColumns, ...]
    retimed: Retimed | None
    jumps: tuple[Jump, ...]
    demands: tuple[Demand, ...]

    @property
    def changes(self) -> tuple[str, ...]:
        """What was changed of the rows, a sentence each."""
        found = [f"smoothed {each.sentence}" for each in self.smoothed]
        if self.smooth is not None and not self.smoothed:
            found.append("not smoothed: its rows have no noise, or more than that was not allowed")
        if self.retimed is not None:
            found.append(self.retimed.sentence)
        return tuple(found)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What it asks beyond the robot's limits, a sentence each, and what to do."""
        found = [each.sentence for each in self.jumps[:MOST_TOLD]]
        found += [each.sentence for each in self.demands[:MOST_TOLD]]
        more = max(len(self.jumps) - MOST_TOLD, 0), max(len(self.demands) - MOST_TOLD, 0)
        found += [f"{more[0]} more jumps"] if more[0] else []
        found += [f"{more[1]} more limits are exceeded"] if more[1] else []
        ways = []
        if self.smooth is None:
            ways.append("smoothing (--smooth auto) takes the noise out of the rows")
        if self.retimed is None:
            ways.append("retiming (--retime) slows the motion down where limits bind")
        return (*found, "; ".join(ways)) if found and ways else tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON says it."""
        return {
            "smooth": self.smooth,
            "smoothed": [each.to_dict() for each in self.smoothed],
            "retimed": None if self.retimed is None else self.retimed.to_dict(),
            "jumps": [each.to_dict() for each in self.jumps],
            "demands": [each.to_dict() for each in self.demands],
            "sentence": "; ".join((*self.changes, *self.warnings)),
        }


@dataclass(frozen=True)
class RecordedPath(TimedPath):
    """A reference from a table.

    Attributes:
        recording: What became of the table on the way to it.
    """

    recording: Recording | None = None
