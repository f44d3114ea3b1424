"""A reference through a table's poses: splines in time that pass every pose at its time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.csv_file import Table
from rpctl.reference.csv_header import (
    BASE_COLUMNS,
    EE_COLUMNS,
    HEADING,
    POSE_COLUMNS,
    QUATERNION,
)
from rpctl.reference.demands import find_demands
from rpctl.reference.edge_time_law import EDGE_TIME, EdgeTimeLaw
from rpctl.reference.end_effector_plan import plan_reach
from rpctl.reference.goal import Goal
from rpctl.reference.jumps import find_jumps
from rpctl.reference.limits import Limits
from rpctl.reference.paths import Path
from rpctl.reference.recorded_base import fit_base, spline_path, travel_direction
from rpctl.reference.recorded_speeds import speed_faults
from rpctl.reference.recording import RecordedPath, Recording
from rpctl.reference.retiming import retimed
from rpctl.reference.robot_length import robot_length
from rpctl.reference.row_fit import METRES_PER_RADIAN, FittedSpline, RowFit, fit_spline
from rpctl.reference.smoothing import Smoothed, on_knots
from rpctl.reference.splines import Curves
from rpctl.reference.timed_path import TimedPath, still
from rpctl.robot.model import Robot


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

    Args:
        robot: The robot.
        table: The rows.
        limits: The user's limits, for a planned base path.
        smooth: Tolerance of smoothing, m, or ``auto``; None passes every row.
        retime: Whether to slow it down where limits bind.

    Raises:
        DescriptionError: The rows do not fit the robot; each is named by its line.
        RpctlError: The end effector cannot follow.
    """
    _check_columns(robot, table)
    rows, fits = RowFit(table, smooth), []
    if smooth is None:
        _check_rows(robot, table)
    path: Path | None = None if robot.drive.base_speeds else still(np.zeros(3))
    direction = goal = joints = None
    if BASE_COLUMNS[0] in table.columns:
        fits.append(fit_base(robot, rows))
        path = spline_path(fits[-1].spline)
        direction = travel_direction(robot, fits[-1], table.t)
    if EE_COLUMNS[0] in table.columns:
        goal, found = _goal(rows)
    else:
        found = _fit_joints(robot, rows)
        joints = found.spline
    fits.append(found)
    if smooth is not None:
        _check_rows(robot, rows.changed_table())
    if goal is not None:
        plan = plan_reach(robot, goal, limits, path)
        path, joints = plan.path, plan.joints
    end = float(table.t[-1])
    starts, ends = any(k.starts_moving for k in fits), any(k.ends_moving for k in fits)
    time_law = EdgeTimeLaw(end, starts, ends, min(EDGE_TIME, 0.4 * end))
    reference = TimedPath(path or still(np.zeros(3)), Curves(joints), time_law, direction)
    return _with_recording(robot, reference, rows, retime)


def _with_recording(robot: Robot, reference: TimedPath, rows: RowFit, retime: bool) -> TimedPath:
    """Return a reference, slowed down where it is wanted, that tells what became of its rows."""
    dynamics, told = ReducedDynamics(robot), None
    if retime:
        reference, told = retimed(dynamics, reference, rows.table)
    recording = Recording(
        rows.wish,
        tuple(rows.changes),
        told,
        tuple(find_jumps(robot, rows.table)),
        tuple(find_demands(dynamics, reference, rows.table)),
    )
    return RecordedPath(
        reference.path,
        reference.arm,
        reference.time_law,
        reference.travel_direction,
        recording=recording,
    )


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
                f"{EE_COLUMNS[0]} and {named[0]} both say where the arm is; leave one of them out"
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
    return _together(table.t, values, [found.get(name) for name in robot.joint_names])


def _together(t: Array, values: Array, found: Sequence[Smoothed | None]) -> FittedSpline:
    """Return the splines of columns as one.

    Args:
        t: Times (K,), s.
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
        turns *= np.cumprod(np.where(_same_hemisphere(turns), 1.0, -1.0))[:, None]
        turn = rows.fit_inside(", ".join(QUATERNION), turns, "", 2.0 * METRES_PER_RADIAN)
    return Goal(found.spline, turn, 0.0, float(table.t[-1]), True), found


def _same_hemisphere(turns: Array) -> Array:
    """Return whether each quaternion (K, 4) has its predecessor's sign: q and −q turn alike."""
    return np.concatenate([[True], np.einsum("ki,ki->k", turns[1:], turns[:-1]) >= 0.0])
