"""Jumps in a table: rows that lie far from those about them, on a robot that cannot jump."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from rpctl.reference.csv_file import Table
from rpctl.reference.recorded_speeds import motions
from rpctl.robot.model import Robot

ABOUT = 51  # steps whose median is the pace about a row
JUMP_RATIO = 6.0  # times the pace about it: of 100 000 steps of noise the longest is 4 times it
FREE_SPEED = 2.0  # m/s or rad/s: of what has no limit


@dataclass(frozen=True)
class Jump:
    """A step of a table that is faster than its robot, and far faster than the steps about it.

    Attributes:
        columns: What jumps.
        line: Of the file: the row after the jump.
        time: Of that row, s.
        speed: Mean speed on the way to it, m/s or rad/s.
        pace: Median of the speeds about it.
        unit: Of both.
    """

    columns: str
    line: int
    time: float
    speed: float
    pace: float
    unit: str

    @property
    def sentence(self) -> str:
        """It in one line."""
        return (
            f"line {self.line}: {self.columns} at {self.speed:.3g} {self.unit} from the row "
            f"before, {self.pace:.2g} {self.unit} about it; mend the row or leave it out"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


def find_jumps(robot: Robot, table: Table) -> list[Jump]:
    """Return the jumps of a table, the largest first."""
    return sorted(_jumps(robot, table), key=lambda jump: jump.speed / max(jump.pace, 1e-9))[::-1]


def _jumps(robot: Robot, table: Table) -> Iterator[Jump]:
    for motion in motions(robot, table):
        pace = median_filter(motion.speeds, min(ABOUT, len(motion.speeds)), mode="nearest")
        least = np.maximum(min(motion.limit, FREE_SPEED), JUMP_RATIO * pace)
        for step in np.flatnonzero(motion.speeds > least).tolist():
            speed, about = float(motion.speeds[step]), float(pace[step])
            row = step + 1
            yield Jump(
                motion.label, table.lines[row], float(table.t[row]), speed, about, motion.unit
            )
