"""The base's path through a table's poses, or near them: places, headings, direction of travel.

A tangent has no direction where the base stands, turns on the spot or reverses, and the tangent of
noisy rows points anywhere there. So the heading is a spline of its own, and the fit minimises

    Σ |pₖ − p(tₖ)|² + λ ∫ |p'''|² dt + Σ ℓₖ² (θₖ − θ(tₖ))² + λ ℓ² ∫ θ'''² dt + μ Σ (n(θ)·ṗ)²

with n across the heading: the last sum, with a term between every two knots and one at each end,
is of the sideways speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.formula import Along
from rpctl.reference.paths import Path, Place, basis_at, posed, through
from rpctl.reference.recorded.smoothing import (
    METRES_PER_RADIAN,
    REST_ERRORS,
    Ends,
    FittedSpline,
    RowFit,
    Smoothed,
    SmoothedColumns,
    SmoothingProblem,
    fit_spline,
    on_knots,
)
from rpctl.reference.recorded.table_file import BASE_COLUMNS, HEADING
from rpctl.robot.model import Robot

SLIDING_WEIGHT = 1e6  # of the sideways speed, relative to that of the low pass: it is a constraint
STEPS = 12  # of Gauss and Newton; from a good start four are enough
STEP_TOLERANCE = 1e-6  # m: a step that moves nothing farther is the last
HALVINGS = 8  # of a step that does not lower the cost
MOVING_SPEED = 0.02  # m/s: above it the heading is that of P's velocity
MAX_SIDEWAYS_SPEED = 0.02  # m/s: sideways speed tolerated of a base that cannot slide, ...
MAX_SIDEWAYS_RATIO = 0.05  # ... or this fraction of its speed
MAX_HEADING_CHANGE = 0.5  # rad: a heading that smoothing turns farther contradicts the way, ...
MAX_PLACE_RATIO, MAX_PLACE_CHANGE = 2.0, 0.05  # ... or moves places more than their noise; 1, m
MIN_LEVER, MAX_LEVER = 0.03, 3.0  # m/rad: of a heading whose noise is large, and of one without
HELD_LEVER = 0.1  # m/rad: weight of the heading that is held where the base stands
PATH_LEVER = 0.03  # m/rad: stiffness of a heading that the path alone gives
REFITS = 6  # halvings of the way to the τ that brings a fit that rolls back into its tolerance
HEADING_ERRORS = 5.0  # standard errors of the velocity: a smaller one has no direction
FULL_SPEED = 0.5  # of the largest: from there on noise does not decide which way is forward


class HeadingRows(NamedTuple):
    """What is known of the heading.

    Attributes:
        angle: At each row (K,), continuous, rad.
        lever: Weight of its residual relative to a position's, m/rad; (K,), 0: not known.
        stiffness: Weight of its third derivative, likewise, m/rad.
    """

    angle: Array
    lever: Array
    stiffness: float


def fit_rolling(
    problem: SmoothingProblem, tau: float, start: Array, heading: HeadingRows, fixed: Array
) -> Array:
    """Return the coefficients (m, 3) of a pose spline along which the base hardly slides.

    Args:
        start: Coefficients (m, 3) to start from.
        heading: What is known of the heading.
        fixed: Which coefficients (m, 3) stay as they are.
    """
    rows = _RollingRows(problem, tau, heading)
    free, c = np.logical_not(fixed.ravel()), start.copy()
    residual, jacobian = rows.cost(c)
    for _ in range(STEPS):
        J = jacobian[:, free]
        step = np.zeros(c.size)
        step[free] = -splu((J.T @ J).tocsc()).solve(J.T @ residual)
        for _ in range(HALVINGS):
            tried, slopes = rows.cost(c + step.reshape(c.shape))
            if tried @ tried <= residual @ residual:
                break
            step *= 0.5
        else:
            break
        c, residual, jacobian = c + step.reshape(c.shape), tried, slopes
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    return c


class _RollingRows:
    """The residuals of a fit, and their derivatives by the coefficients, x, y, θ in turn."""

    def __init__(self, problem: SmoothingProblem, tau: float, heading: HeadingRows) -> None:
        self._places, self._heading = problem.values, heading
        breaks = problem.breaks
        at = np.concatenate([breaks[:1], 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:]])
        bend, b = tau**3 * problem.third, problem.at_rows
        lever = diags_array(heading.lever)
        self._linear = csr_array(
            block_array(
                [
                    [_column(b, 0)], [_column(b, 1)], [_column(lever @ b, 2)],
                    [_column(bend, 0)], [_column(bend, 1)], [_column(heading.stiffness * bend, 2)],
                ]
            )
        )  # fmt: skip
        places = [*problem.values.T, heading.lever * heading.angle]
        self._target = np.concatenate([*places, np.zeros(3 * bend.shape[0])])
        self._value, self._rate = (basis_at(problem.knots, at, order) for order in (0, 1))
        width = np.sqrt(np.gradient(at))
        self._weight = math.sqrt(SLIDING_WEIGHT) * max(tau, 1.0) * width

    def cost(self, c: Array) -> tuple[Array, csr_array]:
        """Return the residual of coefficients (m, 3) and its derivatives."""
        (x, y), theta = (self._rate @ c[:, :2]).T, self._value @ c[:, 2]
        cos, sin, w = np.cos(theta), np.sin(theta), self._weight
        sliding = (
            _column(diags_array(-w * sin) @ self._rate, 0)
            + _column(diags_array(w * cos) @ self._rate, 1)
            + _column(diags_array(-w * (x * cos + y * sin)) @ self._value, 2)
        )
        residual = np.concatenate(
            [self._linear @ c.ravel() - self._target, w * (y * cos - x * sin)]
        )
        return residual, csr_array(block_array([[self._linear], [sliding]]))


def _column(matrix: csr_array, column: int) -> csr_array:
    """Return the derivatives by coefficients of one column as those by all, row by row."""
    found = matrix.tocoo()
    shape = found.shape[0], 3 * found.shape[1]
    return csr_array((found.data, (found.row, 3 * found.col + column)), shape=shape)


def fit_base(robot: Robot, rows: RowFit) -> FittedSpline:
    """Return the spline (x, y, theta) to a table's poses.

    Raises:
        DescriptionError: The base would have to slide; each such row is named.
    """
    table = rows.table
    t, place, given = table.t, table.stack(BASE_COLUMNS), table.columns.get(HEADING)
    turned = None if given is None else np.unwrap(given)[:, None]
    way = rows.smoothed(place)
    turning = None if turned is None else rows.smoothed(turned, METRES_PER_RADIAN)
    if way is None and turning is None:
        rate = fit_spline(t, place).spline(t, 1)
        heading = headings(rate, MOVING_SPEED) if turned is None else turned
        found = fit_spline(t, np.column_stack([place, heading]))
    else:
        dense = any(each is not None and each.problem.spacing == 0.0 for each in (way, turning))
        way = on_knots(way, t, place, dense)
        turning = None if turned is None else on_knots(turning, t, turned, dense)
        found = _fit_near(robot, rows, way, turning)
    if robot.drive.has_axle:
        _refuse_sliding(robot, rows, found)
    return found


def _fit_near(robot: Robot, rows: RowFit, way: Smoothed, turning: Smoothed | None) -> FittedSpline:
    """Return the smooth pose spline.

    Args:
        way: Its places, smoothed on their own.
        turning: Its headings, likewise; None where it has none.
    """
    t, rests = rows.table.t, way.rests
    if turning is not None:
        first, last = (a and b for a, b in zip(rests, turning.rests, strict=True))
        rests = first, last
    problem, heading = way.problem, _heading_rows(t, way, turning)
    angles = SmoothingProblem(t, heading.angle[:, None], problem.spacing)
    theta = angles.coefficients(way.tau if turning is None else turning.tau)
    found = np.column_stack([problem.coefficients(way.tau, rests), theta])
    for end, rest in zip((slice(0, 3), slice(-3, None)), rests, strict=True):
        if rest:
            found[end, 2] = theta[0 if end.start == 0 else -1]
    alone = problem.residual(way.coefficients)
    if robot.drive.has_axle or turning is None:
        way, found = _rolled(way, found, heading, rests, rows.tolerance())
        _refuse_coarse(rows, problem.residual(found[:, :2]))
    spline = problem.spline(found)
    places = rows.keep(", ".join(BASE_COLUMNS), "m", problem.values, spline, way, slice(0, 2))
    if turning is not None:
        change = rows.keep(HEADING, "rad", turning.problem.values, spline, turning, slice(2, 3))
        _refuse_contradiction(rows, places, change, alone)
    return FittedSpline(spline, not rests[0], not rests[1], way.rate_error)


def _refuse_coarse(rows: RowFit, rms: float) -> None:
    """Refuse a tolerance that a base that rolls cannot keep.

    Args:
        rms: Root mean square of what smoothing changes of the places, m.

    Raises:
        RpctlError: It is more than the tolerance.
    """
    tolerance = rows.tolerance()
    if tolerance is not None and rms > tolerance:
        raise RpctlError(
            f"smooth = {tolerance:g}: a base that rolls cannot follow its rows closer than "
            f"{rms:.2g} m rms; allow at least that"
        )


def _refuse_contradiction(
    rows: RowFit, places: SmoothedColumns, headings: SmoothedColumns, alone: float
) -> None:
    """Refuse headings that do not go with the way that the places describe.

    Args:
        places: What smoothing changed of the places.
        alone: Root mean square by which it changes the places if nobody heeds the headings, m.

    Raises:
        DescriptionError: Naming the row that is farthest off.
    """
    fault = ""
    if headings.largest > MAX_HEADING_CHANGE:
        line, fault = (
            headings.line,
            (f"{HEADING} is {headings.largest:.2g} rad off the smoothed path"),
        )
    if places.rms > MAX_PLACE_RATIO * alone and places.largest > MAX_PLACE_CHANGE:
        line = places.line
        fault = f"a base that follows {HEADING} stays off x, y by up to {places.largest:.2g} m"
    if fault:
        raise rows.table.refuse(
            [(line, f"{fault}; make {HEADING} follow the path, or leave it out")]
        )


def _heading_rows(t: Array, way: Smoothed, turning: Smoothed | None) -> HeadingRows:
    """Return what the rows say of the heading: as given, or as their smoothed way points."""
    if turning is None:
        rate = way.problem.spline(way.coefficients)(t, 1)
        slow = max(MOVING_SPEED, HEADING_ERRORS * way.rate_error)
        held = np.where(np.hypot(*rate.T) > slow, 0.0, HELD_LEVER)
        return HeadingRows(headings(rate, slow, FULL_SPEED), held, PATH_LEVER)
    ratio = way.noise / turning.noise if turning.noise else math.inf
    lever = float(np.clip(ratio, MIN_LEVER, MAX_LEVER))
    angle = turning.problem.values[:, 0]
    return HeadingRows(angle, np.full(len(angle), lever), lever * (turning.tau / way.tau) ** 3)


def _rolled(
    way: Smoothed, start: Array, heading: HeadingRows, rests: Ends, tolerance: float | None
) -> tuple[Smoothed, Array]:
    """Return the fit that rolls, its time constant as short as a tolerance asks for.

    Args:
        way: The places, smoothed on their own.
        start: Coefficients of the poses (m, 3) to start from.
        heading: What is known of the heading.
        rests: Whether it begins and ends at rest.
        tolerance: Of the places, m; None: any.
    """
    fixed = np.zeros(start.shape, bool)
    for end, rest in zip((slice(0, 3), slice(-3, None)), rests, strict=True):
        fixed[end] = rest
    problem, longest, shortest = way.problem, math.log(way.tau), math.log(way.problem.shortest)
    found = fit_rolling(problem, way.tau, start, heading, fixed)
    if tolerance is None or problem.residual(found[:, :2]) <= tolerance:
        return way, found
    for _ in range(REFITS):
        middle = 0.5 * (longest + shortest)
        tried = fit_rolling(problem, math.exp(middle), found, heading, fixed)
        if problem.residual(tried[:, :2]) > tolerance:
            longest = middle
        else:
            shortest = middle
    tau = math.exp(shortest)
    return way._replace(tau=tau), fit_rolling(problem, tau, found, heading, fixed)


def _refuse_sliding(robot: Robot, rows: RowFit, found: FittedSpline) -> None:
    """Refuse poses between which a base that cannot slide would have to.

    Raises:
        DescriptionError: Naming each such row.
    """
    t, lines = rows.table.t, rows.table.lines
    rate, heading = found.spline(t, 1), found.spline(t)[:, 2]
    sideways = rate[:, 1] * np.cos(heading) - rate[:, 0] * np.sin(heading)
    allowed = np.maximum(MAX_SIDEWAYS_SPEED, MAX_SIDEWAYS_RATIO * np.hypot(rate[:, 0], rate[:, 1]))
    fix = f"make {HEADING} follow the path, or leave {HEADING} out"
    fix += "" if rows.tolerance() is None else f", or smooth by more than {rows.wish} m"
    faults = [
        (lines[row], f"at t = {t[row]:g} s {robot.name} would have to slide sideways at "
         f"{abs(sideways[row]):.2g} m/s; {fix}")
        for row in np.flatnonzero(np.abs(sideways) > allowed)
    ]  # fmt: skip
    if faults:
        raise rows.table.refuse(faults)


def headings(rate: Array, slow: float, sure: float = 0.0) -> Array:
    """Return headings (K,) along velocities (K, 2), held where P almost stands.

    The first is forward; after a turn of more than a right angle the base drives in reverse.

    Args:
        rate: Velocities (K, 2), m/s.
        slow: Speed below which there is none, m/s.
        sure: From which share of the largest speed on the first one is forward.
    """
    speed = np.hypot(rate[:, 0], rate[:, 1])
    moving = np.flatnonzero(speed > min(slow, 0.5 * speed.max()))
    if not len(moving):
        return np.zeros(len(rate))
    way = np.arctan2(rate[moving, 1], rate[moving, 0])
    angles = np.unwrap(way, period=math.pi)
    first = int((speed[moving] >= sure * speed.max()).argmax())
    if math.cos(way[first] - angles[first]) < 0.0:
        angles -= math.pi
    return np.interp(np.arange(len(rate)), moving, angles)


def rolled_path(robot: Robot, found: FittedSpline, t: Array) -> Path:
    """Return the base's path of a pose spline by time.

    A base that cannot slide moves along (cos φ, 0, sin φ / ℓ), which does not vanish where the data
    stand still: φ is a spline through the rows (K,) that move, modulo π, held between them.
    """
    if not robot.drive.has_axle:
        return Path(lambda at: posed(at, at.spline(found.spline)))
    spline = found.spline
    rate, heading = spline(t, 1), spline(t)[:, 2]
    speed = rate[:, 0] * np.cos(heading) + rate[:, 1] * np.sin(heading)
    turning = METRES_PER_RADIAN * rate[:, 2]
    pace = np.hypot(speed, turning)
    slow = max(MOVING_SPEED, REST_ERRORS * found.rate_error)
    moving = np.flatnonzero(pace > min(slow, 0.5 * pace.max()))
    angle = np.zeros(len(t))
    if len(moving):
        turned = np.unwrap(np.arctan2(turning[moving], speed[moving]), period=math.pi)
        angle = np.interp(np.arange(len(t)), moving, turned)
    angles = through(t, angle)

    def formula(at: Along) -> Place:
        (phi,) = at.spline(angles)
        toward = casadi.cos(phi), 0.0, casadi.sin(phi) / METRES_PER_RADIAN
        return posed(at, at.spline(spline), toward)

    return Path(formula)
