"""A reference through a table's poses: splines in time that pass every pose at its time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.reference.csv_file import Table
from rpctl.reference.csv_header import (
    BASE_COLUMNS,
    EE_COLUMNS,
    HEADING,
    POSE_COLUMNS,
    QUATERNION,
)
from rpctl.reference.end_effector_plan import plan_reach
from rpctl.reference.goal import Goal
from rpctl.reference.limits import Limits
from rpctl.reference.paths import Path, PathPoint, PathTime, ramped_time
from rpctl.reference.recorded_speeds import speed_faults
from rpctl.reference.splines import Curves, through
from rpctl.reference.timed_path import TimedPath, still
from rpctl.robot.model import Robot

REST_RATE = 2e-3  # m/s or rad/s: data that begin or end slower do so at rest
MOVING_SPEED = 0.02  # m/s: above it the heading is that of P's velocity
MAX_SIDEWAYS_SPEED = 0.02  # m/s: sideways speed tolerated of a base that cannot slide, ...
MAX_SIDEWAYS_RATIO = 0.05  # ... or this fraction of its speed
METRES_PER_RADIAN = 0.3  # m/rad: weight of turning relative to travelling
EDGE_TIME = 1.0  # s; duration of the start and the stop of data that begin or end in motion
# Of u⁴..u⁷: zero with three derivatives at 0, and 1, 1, 0, 0 at 1.
CATCH_UP_COEFFICIENTS = 20.0, -45.0, 36.0, -10.0


class EdgeTimeLaw(NamedTuple):
    """s(t) = t, but at rest where data begin or end in motion.

    Data that start in motion are reached from rest within ``edge`` seconds: s = edge f(t/edge),
    with f of degree 7 from rest (three zero derivatives) to rate one, on time. The last ``edge``
    seconds of data that end in motion take twice as long while the rate falls to zero. Every
    recorded pose is passed.
    """

    end: float
    soft_start: bool
    soft_end: bool
    edge: float

    @property
    def duration(self) -> float:
        """Time after which it stays, s."""
        return self.end + self.edge if self.soft_end else self.end

    def __call__(self, t: float) -> PathTime:
        """Return s and its derivatives by time at ``t`` (s)."""
        left = self.duration - t
        if t <= 0.0 or left <= 0.0:
            return PathTime(0.0 if t <= 0.0 else self.end, 0.0, 0.0)
        if self.soft_start and t < self.edge:
            f, rate, bend = _catch_up_profile(t / self.edge)
            return PathTime(self.edge * f, rate, bend / self.edge)
        if self.soft_end and left < 2.0 * self.edge:
            s, rate, change = ramped_time(left, 1.0, 2.0 * self.edge)
            return PathTime(self.end - s, rate, -change)
        return PathTime(t, 1.0, 0.0)


def _catch_up_profile(u: float) -> tuple[float, float, float]:
    a, b, c, d = CATCH_UP_COEFFICIENTS
    return (
        u**4 * (a + u * (b + u * (c + u * d))),
        u**3 * (4 * a + u * (5 * b + u * (6 * c + u * 7 * d))),
        u**2 * (12 * a + u * (20 * b + u * (30 * c + u * 42 * d))),
    )


class FittedSpline(NamedTuple):
    """A spline through rows, and whether it begins and ends in motion."""

    spline: BSpline
    starts_moving: bool
    ends_moving: bool


def fit_spline(t: Array, values: Array) -> FittedSpline:
    """Return the quintic spline through values (K, n) at times (K,).

    Where the data begin or end at rest it has zero velocity and acceleration there.
    """
    free = through(t, values)
    ends, moving = [], []
    for at in (t[0], t[-1]):
        rates = free(at, 1), free(at, 2)
        moving.append(bool(np.linalg.norm(rates[0]) > REST_RATE))
        ends.append([(i, r if moving[-1] else 0.0 * r) for i, r in enumerate(rates, start=1)])
    return FittedSpline(through(t, values, (ends[0], ends[1])), *moving)


def reference_from_table(robot: Robot, table: Table, limits: Limits) -> TimedPath:
    """Return the reference through a table's rows; the first is at time zero.

    If the table has no end effector, joints that it does not name stay at home. An end effector
    beside a base moves the arm by inverse kinematics; for one alone a base path is planned.

    Args:
        robot: The robot.
        table: The rows.
        limits: The user's limits, for a planned base path.

    Raises:
        DescriptionError: The rows do not fit the robot; each is named by its line.
        RpctlError: The end effector cannot follow.
    """
    _check_fit(robot, table)
    fits = []
    path: Path | None = None if robot.drive.base_speeds else still(np.zeros(3))
    travel_direction = None
    if BASE_COLUMNS[0] in table.columns:
        fitted = _fit_base(robot, table)
        fits.append(fitted)
        path, travel_direction = (
            _spline_path(fitted.spline),
            _travel_direction(robot, fitted.spline, table.t),
        )
    if EE_COLUMNS[0] in table.columns:
        goal, found = _goal(table)
        fits.append(found)
        plan = plan_reach(robot, goal, limits, path)
        path, joints = plan.path, plan.joints
    else:
        found = _fit_joints(robot, table)
        fits.append(found)
        path, joints = path or still(np.zeros(3)), found.spline
    end = float(table.t[-1])
    starts, ends = any(k.starts_moving for k in fits), any(k.ends_moving for k in fits)
    time_law = EdgeTimeLaw(end, starts, ends, min(EDGE_TIME, 0.4 * end))
    return TimedPath(path, Curves(joints), time_law, travel_direction)


def _check_fit(robot: Robot, table: Table) -> None:
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


def _fit_joints(robot: Robot, table: Table) -> FittedSpline:
    values = np.tile(robot.home, (len(table.t), 1))
    for column, joint in enumerate(robot.joints):
        if joint.name in table.columns:
            values[:, column] = table.columns[joint.name]
            if joint.kind == "continuous":
                values[:, column] = np.unwrap(values[:, column])
    return fit_spline(table.t, values)


def _goal(table: Table) -> tuple[Goal, FittedSpline]:
    found = fit_spline(table.t, table.stack(EE_COLUMNS))
    turn = None
    if QUATERNION[0] in table.columns:
        turns = table.stack(QUATERNION)
        turns *= np.cumprod(np.where(_same_hemisphere(turns), 1.0, -1.0))[:, None]
        turn = through(table.t, turns)
    return Goal(found.spline, turn, 0.0, float(table.t[-1]), True), found


def _same_hemisphere(turns: Array) -> Array:
    """Return whether each quaternion (K, 4) has its predecessor's sign: q and −q turn alike."""
    return np.concatenate([[True], np.einsum("ki,ki->k", turns[1:], turns[:-1]) >= 0.0])


def _fit_base(robot: Robot, table: Table) -> FittedSpline:
    t, place = table.t, table.stack(BASE_COLUMNS)
    rate = fit_spline(t, place).spline(t, 1)
    given = table.columns.get(HEADING)
    heading = _headings(rate) if given is None else np.unwrap(given)
    found = fit_spline(t, np.column_stack([place, heading]))
    if robot.drive.has_axle:
        rate = found.spline(t, 1)
        sideways = rate[:, 1] * np.cos(heading) - rate[:, 0] * np.sin(heading)
        allowed = np.maximum(
            MAX_SIDEWAYS_SPEED, MAX_SIDEWAYS_RATIO * np.hypot(rate[:, 0], rate[:, 1])
        )
        faults = [
            (table.lines[row], f"at t = {t[row]:g} s {robot.name} would have to slide sideways at "
             f"{abs(sideways[row]):.2g} m/s; turn theta into the way, or leave theta out")
            for row in np.flatnonzero(np.abs(sideways) > allowed)
        ]  # fmt: skip
        if faults:
            raise table.refuse(faults)
    return found


def _headings(rate: Array) -> Array:
    """Return headings (K,) along velocities (K, 2), held where P almost stands.

    The first is forward; after a turn of more than a right angle the base drives in reverse.
    """
    speed = np.hypot(rate[:, 0], rate[:, 1])
    moving = np.flatnonzero(speed > min(MOVING_SPEED, 0.5 * speed.max()))
    if not len(moving):
        return np.zeros(len(rate))
    angles = np.unwrap(np.arctan2(rate[moving, 1], rate[moving, 0]), period=math.pi)
    return np.interp(np.arange(len(rate)), moving, angles)


def _spline_path(spline: BSpline) -> Path:
    orders = [spline.derivative(order) if order else spline for order in range(4)]

    def at(s: float) -> PathPoint:
        pose, d1, d2, d3 = (order(s) for order in orders)
        omega, alpha, jerk = d1[2], d2[2], d3[2]
        # In the base's axes, u = e^(-iθ) ż: they turn, so u' = e^(-iθ) (z̈ - iω ż), and so on.
        v, a, j = (complex(d[0], d[1]) for d in (d1, d2, d3))
        back = complex(math.cos(pose[2]), -math.sin(pose[2]))
        first = back * (a - 1j * omega * v)
        second = back * (j - 2j * omega * a - (1j * alpha + omega**2) * v)
        rows = ((back * v, omega), (first, alpha), (second, jerk))
        return PathPoint(pose, np.array([[u.real, u.imag, turn] for u, turn in rows]))

    return at


def _travel_direction(robot: Robot, spline: BSpline, t: Array) -> Callable[[float], Array] | None:
    """Return a direction of travel that does not vanish where the data stand still.

    A base that cannot slide moves along (cos φ, 0, sin φ / ℓ): φ is a spline through the rows
    that move, modulo π, held between them.
    """
    if not robot.drive.has_axle:
        return None
    rate, heading = spline(t, 1), spline(t)[:, 2]
    speed = rate[:, 0] * np.cos(heading) + rate[:, 1] * np.sin(heading)
    turning = METRES_PER_RADIAN * rate[:, 2]
    pace = np.hypot(speed, turning)
    moving = np.flatnonzero(pace > min(MOVING_SPEED, 0.5 * pace.max()))
    angle = np.zeros(len(t))
    if len(moving):
        found = np.unwrap(np.arctan2(turning[moving], speed[moving]), period=math.pi)
        angle = np.interp(np.arange(len(t)), moving, found)
    orders = Curves(through(t, angle))

    def at(s: float) -> Array:
        phi, slope, bend = (float(order) for order in orders(s))
        cos, sin = math.cos(phi), math.sin(phi)
        lean = np.array([cos, 0.0, sin / METRES_PER_RADIAN])
        across = np.array([-sin, 0.0, cos / METRES_PER_RADIAN])
        return np.array([lean, across * slope, across * bend - lean * slope**2])

    return at
