"""A reference through a table's poses, and what became of the table on the way to it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.path_reference import TimedPath, still
from rpctl.reference.paths import Path, constant, spline_curve, through
from rpctl.reference.planned.curve import Goal
from rpctl.reference.planned.reach import plan_reach
from rpctl.reference.recorded.base import fit_base, rolled_path
from rpctl.reference.recorded.demands import Demand, Retimed, find_demands, retimed
from rpctl.reference.recorded.smoothing import (
    METRES_PER_RADIAN,
    FittedSpline,
    RowFit,
    Smoothed,
    SmoothedColumns,
    fit_spline,
    on_knots,
)
from rpctl.reference.recorded.table_file import (
    BASE_COLUMNS,
    EE_COLUMNS,
    HEADING,
    POSE_COLUMNS,
    QUATERNION,
    Table,
)
from rpctl.reference.sizing import Limits, Told, robot_length, wheel_rates
from rpctl.reference.time_law import recorded_time
from rpctl.robot.model import Robot

IMPOSSIBLE_RATIO = 10.0  # times the robot's limit; what it misses by less may be meant
MOST_FAULTS = 20  # rows that are named each: more of them are noise, or wrong units
MAX_SPEED = 100.0  # m/s or rad/s of anything, whatever limit it has
ABOUT = 51  # steps whose median is the pace about a row
JUMP_RATIO = 6.0  # times the pace about it: of 100 000 steps of noise the longest is 4 times it
FREE_SPEED = 2.0  # m/s or rad/s: of what has no limit


def speed_faults(robot: Robot, table: Table) -> list[tuple[int, str]]:
    """Return the lines before which a table moves impossibly fast, each with what to do."""
    faults = []
    for label, speeds, limit, unit in motions(robot, table):
        for row in np.flatnonzero(speeds > min(IMPOSSIBLE_RATIO * limit, MAX_SPEED)):
            limited = f", where {robot.name}'s limit is {limit:.3g}" if limit < math.inf else ""
            fault = f"{label} at {speeds[row]:.3g} {unit} from the row before{limited}"
            faults.append((table.lines[row + 1], f"{fault}; use s, m and rad, or correct the row"))
    if len(faults) > MOST_FAULTS:
        line, first = min(faults)
        fault = f"{first.partition(';')[0]}, and {len(faults) - 1} more rows have the same fault"
        return [(line, f"{fault}; use s, m and rad, or remove their noise (--smooth auto)")]
    return sorted(faults)


def motions(robot: Robot, table: Table) -> Iterator[tuple[str, Array, float, str]]:
    """Yield what moves in a table, its speeds (K - 1,) between rows, their limit, and the unit.

    The limit is inf where there is none.
    """
    step = np.diff(table.t)
    drive, turn = base_limits(robot)
    for names, limit in ((BASE_COLUMNS, drive), (EE_COLUMNS, math.inf)):
        if names[0] in table.columns:
            way = np.linalg.norm(np.diff(table.stack(names), axis=0), axis=1)
            yield f"{', '.join(names)} move", way / step, limit, "m/s"
    if HEADING in table.columns:
        yield f"{HEADING} turns", _turns(table.columns[HEADING]) / step, turn, "rad/s"
    for joint in robot.joints:
        if joint.name in table.columns:
            values = table.columns[joint.name]
            way = _turns(values) if joint.kind == "continuous" else np.abs(np.diff(values))
            unit = "m/s" if joint.kind == "prismatic" else "rad/s"
            yield f"{joint.name} moves", way / step, joint.velocity, unit


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
class Jump(Told):
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
            f"before, {self.pace:.2g} {self.unit} about it; correct the row or leave it out"
        )


def find_jumps(robot: Robot, table: Table) -> list[Jump]:
    """Return the jumps of a table, the largest first."""
    found = []
    for label, speeds, limit, unit in motions(robot, table):
        pace = median_filter(speeds, min(ABOUT, len(speeds)), mode="nearest")
        least = np.maximum(min(limit, FREE_SPEED), JUMP_RATIO * pace)
        for step in np.flatnonzero(speeds > least).tolist():
            line, time = table.lines[step + 1], float(table.t[step + 1])
            found.append(Jump(label, line, time, float(speeds[step]), float(pace[step]), unit))
    return sorted(found, key=lambda jump: jump.speed / max(jump.pace, 1e-9), reverse=True)


MOST_TOLD = 3  # demands, and jumps, that are told in full


def reference_from_table(
    robot: Robot,
    table: Table,
    limits: Limits,
    smooth: float | str | None = None,
    retime: bool = False,
) -> TimedPath:
    """Return the reference through a table's rows, or near them; the first is at time zero.

    Its ``recording`` says what was changed of the rows, and what it asks beyond the robot's limits.

    If the table has no end effector, joints that it does not name stay at home. An end effector
    beside a base moves the arm by inverse kinematics; for one alone a base path is planned.
    """
    _check_columns(robot, table)
    rows, fits = RowFit(table, smooth), []
    if smooth is None:
        _check_rows(robot, table)
    path: Path | None = None if robot.drive.base_speeds else still(np.zeros(3))
    goal = joints = None
    if BASE_COLUMNS[0] in table.columns:
        fits.append(fit_base(robot, rows))
        path = rolled_path(robot, fits[-1], table.t)
    if EE_COLUMNS[0] in table.columns:
        goal, found = _goal(rows)
    else:
        found = _fit_joints(robot, rows)
        joints = found.spline
    fits.append(found)
    if smooth is not None:
        _check_rows(robot, rows.changed_table())
    if goal is not None:
        path, joints = plan_reach(robot, goal, limits, path)
    starts, ends = any(k.starts_moving for k in fits), any(k.ends_moving for k in fits)
    law = recorded_time(float(table.t[-1]), starts, ends)
    moves = goal is not None or any(name in table.columns for name in robot.joint_names)
    arm = spline_curve(joints) if moves else constant(robot.home)
    return _with_recording(robot, TimedPath(path or still(np.zeros(3)), arm, law), rows, retime)


def _with_recording(robot: Robot, reference: TimedPath, rows: RowFit, retime: bool) -> TimedPath:
    """Return a reference, slowed down where it is wanted, that tells what became of its rows."""
    dynamics, told = ReducedDynamics(robot), None
    if retime:
        reference, told = retimed(dynamics, reference, rows.table)
    jumps, demands = find_jumps(robot, rows.table), find_demands(dynamics, reference, rows.table)
    recording = Recording(rows.wish, tuple(rows.changes), told, tuple(jumps), tuple(demands))
    return RecordedPath(reference.path, reference.arm, reference.time_law, recording=recording)


def _check_columns(robot: Robot, table: Table) -> None:
    """Refuse columns that a robot has no use for.

    Raises:
        DescriptionError: Naming them.
    """
    faults = []
    if BASE_COLUMNS[0] in table.columns and not robot.drive.base_speeds:
        faults.append(
            f"{robot.name} has a fixed base; leave out {', '.join((*BASE_COLUMNS, HEADING))}"
        )
    if EE_COLUMNS[0] in table.columns:
        if robot.end_effector is None:
            faults.append(f"{robot.name} has no arm, so no end effector; leave out its columns")
        if named := [name for name in table.columns if name not in POSE_COLUMNS]:
            faults.append(
                f"{EE_COLUMNS[0]} and {named[0]} both set the position of the arm; leave one of "
                "them out"
            )
    if faults:
        raise table.refuse([(table.header, fault) for fault in faults])


def _check_rows(robot: Robot, table: Table) -> None:
    """Refuse rows that are out of a robot's reach: joints beyond their limits, absurd speeds.

    Raises:
        DescriptionError: Naming each.
    """
    beyond = [
        (
            table.lines[row],
            f"{joint.name} is {values[row]:g}, outside its limits {joint.lower:g} to "
            f"{joint.upper:g}; keep it within",
        )
        for joint in robot.joints
        if (values := table.columns.get(joint.name)) is not None
        for row in np.flatnonzero((values < joint.lower) | (values > joint.upper))
    ]
    beyond += speed_faults(robot, table)
    if beyond:
        raise table.refuse(sorted(beyond))


def _fit_joints(robot: Robot, rows: RowFit) -> FittedSpline:
    table, given, found = rows.table, {}, {}
    for joint in robot.joints:
        values = table.columns.get(joint.name)
        if values is not None:
            unit, lever = ("m", 1.0) if joint.kind == "prismatic" else ("rad", robot_length(robot))
            given[joint.name] = np.unwrap(values) if joint.kind == "continuous" else values
            smoothed = rows.smoothed(given[joint.name][:, None], lever)
            if smoothed is not None:
                spline = smoothed.problem.spline(smoothed.coefficients)
                rows.keep(joint.name, unit, given[joint.name][:, None], spline, smoothed)
                found[joint.name] = smoothed
    columns = [
        given.get(joint.name, np.full(len(table.t), home))
        for joint, home in zip(robot.joints, robot.home, strict=True)
    ]
    values = np.column_stack(columns) if columns else np.empty((len(table.t), 0))
    if not found:
        return fit_spline(table.t, values)
    return _as_one_spline(table.t, values, [found.get(name) for name in robot.joint_names])


def _as_one_spline(t: Array, values: Array, found: Sequence[Smoothed | None]) -> FittedSpline:
    """Return the splines of columns as one.

    Args:
        values: The rows (K, n).
        found: Each column smoothed on its own; None: without noise.
    """
    dense = any(each is not None and each.problem.spacing == 0.0 for each in found)
    same = [
        on_knots(each, t, column[:, None], dense)
        for each, column in zip(found, values.T, strict=True)
    ]
    spline = same[0].problem.spline(np.hstack([each.coefficients for each in same]))
    starts, ends = (not all(rests) for rests in zip(*(each.rests for each in same), strict=True))
    return FittedSpline(spline, starts, ends)


def _goal(rows: RowFit) -> tuple[Goal, FittedSpline]:
    table = rows.table
    found = rows.fit(", ".join(EE_COLUMNS), table.stack(EE_COLUMNS), "m")
    turn = None
    if QUATERNION[0] in table.columns:
        turns = table.stack(QUATERNION)
        # q and −q turn alike: each has its predecessor's sign.
        along = np.einsum("ki,ki->k", turns[1:], turns[:-1])
        turns[1:] *= np.cumprod(np.where(along >= 0.0, 1.0, -1.0))[:, None]
        # They have no say in where the motion begins and ends.
        turn = (
            through(table.t, turns)
            if rows.wish is None
            else rows.fit(", ".join(QUATERNION), turns, "", 2.0 * METRES_PER_RADIAN).spline
        )
    return Goal(found.spline, turn, 0.0, float(table.t[-1]), True), found


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
            found.append(
                "not smoothed: its rows have no noise, or removing it exceeds what --smooth allows"
            )
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
            ways.append("smoothing (--smooth auto) removes the noise of the rows")
        if self.retimed is None:
            ways.append("retiming (--retime) slows the motion down where it exceeds limits")
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
