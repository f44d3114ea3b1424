"""Speeds between a table's rows that its robot cannot come near, and jumps of single rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from rpctl.arrays import Array
from rpctl.reference.limits import wheel_rates
from rpctl.reference.recorded.table_file import BASE_COLUMNS, EE_COLUMNS, HEADING, Table
from rpctl.robot.model import Robot

IMPOSSIBLE_RATIO = 10.0  # times the robot's limit; what it misses by less may be meant
MOST_FAULTS = 20  # rows that are named each: more of them are noise, or wrong units
MAX_SPEED = 100.0  # m/s or rad/s of anything, whatever limit it has
ABOUT = 51  # steps whose median is the pace about a row
JUMP_RATIO = 6.0  # times the pace about it: of 100 000 steps of noise the longest is 4 times it
FREE_SPEED = 2.0  # m/s or rad/s: of what has no limit


class RecordedSpeed(NamedTuple):
    """What moves, how fast between rows (K - 1,), its limit (inf: none), and the unit of both."""

    label: str
    speeds: Array
    limit: float
    unit: str


def speed_faults(robot: Robot, table: Table) -> list[tuple[int, str]]:
    """Return the lines before which a table moves impossibly fast, each with what to do."""
    faults = []
    for label, speeds, limit, unit in motions(robot, table):
        for row in np.flatnonzero(speeds > min(IMPOSSIBLE_RATIO * limit, MAX_SPEED)):
            limited = f", where {robot.name}'s limit is {limit:.3g}" if limit < math.inf else ""
            fault = f"{label} at {speeds[row]:.3g} {unit} from the row before{limited}"
            faults.append((table.lines[row + 1], f"{fault}; use s, m and rad, or mend the row"))
    if len(faults) > MOST_FAULTS:
        line, first = min(faults)
        fault = f"{first.partition(';')[0]}, and {len(faults) - 1} more rows are like it"
        return [(line, f"{fault}; use s, m and rad, or take their noise out (--smooth auto)")]
    return sorted(faults)


def motions(robot: Robot, table: Table) -> Iterator[RecordedSpeed]:
    """Yield the speeds between a table's rows of all that moves in it."""
    step = np.diff(table.t)
    drive, turn = base_limits(robot)
    for names, limit in ((BASE_COLUMNS, drive), (EE_COLUMNS, math.inf)):
        if names[0] in table.columns:
            way = np.linalg.norm(np.diff(table.stack(names), axis=0), axis=1)
            yield RecordedSpeed(f"{', '.join(names)} move", way / step, limit, "m/s")
    if HEADING in table.columns:
        yield RecordedSpeed(
            f"{HEADING} turns", _turns(table.columns[HEADING]) / step, turn, "rad/s"
        )
    for joint in robot.joints:
        if joint.name in table.columns:
            values = table.columns[joint.name]
            endless = joint.kind == "continuous"
            way = _turns(values) if endless else np.abs(np.diff(values))
            unit = "m/s" if joint.kind == "prismatic" else "rad/s"
            yield RecordedSpeed(f"{joint.name} moves", way / step, joint.velocity, unit)


def _turns(angles: Array) -> Array:
    """Return the shortest turns (K - 1,) between angles (K,), rad."""
    return np.abs(np.remainder(np.diff(angles) + math.pi, 2.0 * math.pi) - math.pi)


def base_limits(robot: Robot) -> tuple[float, float]:
    """Return the speed (m/s) and turning rate (rad/s) that the wheels' velocity limits allow.

    Each on its own, and in the direction in which the wheels turn fastest; inf without limits.
    """
    drive = turn = math.inf
    for wheel, rates in zip(robot.drive.wheels, wheel_rates(robot).tolist(), strict=True):
        limit = robot.description.joint[wheel.joint].velocity
        forward = 1.0 / wheel.radius if wheel.swivel is not None else math.hypot(*rates[:2])
        drive = min(drive, limit / forward if forward else math.inf)
        turn = min(turn, limit / abs(rates[2]) if rates[2] else math.inf)
    return drive, turn


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
