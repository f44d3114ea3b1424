"""Speeds between a table's rows that its robot cannot come near: slips of units or of a row."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.csv_file import Table
from rpctl.reference.csv_header import BASE_COLUMNS, EE_COLUMNS, HEADING
from rpctl.reference.limits import wheel_rates
from rpctl.robot.model import Robot

IMPOSSIBLE_RATIO = 10.0  # times the robot's limit; what it misses by less may be meant
MOST_FAULTS = 20  # rows that are named each: more of them are noise, or wrong units
MAX_SPEED = 100.0  # m/s or rad/s of anything, whatever limit it has


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
