"""Base paths as formulas of a parameter, the step that starts them softly, and quintic splines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse import csr_array, diags_array

from rpctl import math
from rpctl.arrays import Array
from rpctl.reference.formula import Along, Columns, Numbers

KNOWN = 8  # paths of each kind that are kept, for what they are made of takes milliseconds


class SmoothStep(NamedTuple):
    """The step at u, or at an array of them, with its integral from 0 and its derivatives by u."""

    area: Any
    value: Any
    slope: Any
    bend: Any


def smooth_step(u: Any) -> SmoothStep:
    """Return the step at u in [0, 1], a number or an array: its slope and bend are 0 at both ends.

    Beyond 1 the value stays 1, and the area goes on by u − 1; the caller sees to it.
    """
    square, rest = u * u, 1.0 - u
    return SmoothStep(
        area=square * square * (2.5 + u * (u - 3.0)),
        value=square * u * (10.0 + u * (6.0 * u - 15.0)),
        slope=30.0 * square * rest * rest,
        bend=60.0 * u * rest * (rest - u),
    )


Vector = Sequence[Any]  # of scalars


class Place(NamedTuple):
    """A place of a path, as a formula of its parameter s.

    The twist by s is speed forward (m, negative where the robot drives backwards), speed to the
    left, turning (rad). A path in these terms may turn on the spot and may be run through at any
    pace, from standstill on, without a division by zero.
    """

    pose: Vector  # (3,) x, y in m, heading in rad
    twist: Vector  # (3,)
    toward: Vector | None = None  # (3,) along the twist, not zero where that is; None: the twist


class PathPoint(NamedTuple):
    """A point of a path, or K of them."""

    pose: Array  # (3,) x, y in m, heading in rad; (K, 3)
    twist: Array  # (2, 3) by the path's parameter s, and its derivative by s; (K, 2, 3)
    direction: Array  # (3, 3) of travel, and its first two derivatives by s; (K, 3, 3)


@dataclass(frozen=True, eq=False)
class Path:
    """A base path.

    Attributes:
        formula: Returns its place where the sheet's x is s.
    """

    formula: Callable[[Along], Place]

    @cached_property
    def columns(self) -> Columns:
        """What :class:`PathPoint` holds, (18,), by s."""
        at = Along()
        pose, twist, toward = self.formula(at)
        return at.columns([*pose, *at.orders(twist, 2), *at.orders(toward or twist)])

    def __call__(self, s: Numbers) -> PathPoint:
        """Return the point at s, or the points at many."""
        found = self.columns(s)
        rows = found.reshape(*found.shape[:-1], 6, 3)
        return PathPoint(rows[..., 0, :], rows[..., 1:3, :], rows[..., 3:, :])


@lru_cache(maxsize=KNOWN)
def line(step: float = 1.0) -> Path:
    """Return a straight line along x; ``step`` m a unit of s, backwards where negative."""
    return Path(lambda at: Place((step * at.x, 0.0, 0.0), (step, 0.0, 0.0)))


@lru_cache(maxsize=KNOWN)
def spin(sense: float = 1.0) -> Path:
    """Return a turn on the spot, one radian a unit of s; to the right where ``sense`` is −1."""
    return Path(lambda at: Place((0.0, 0.0, sense * at.x), (0.0, 0.0, sense)))


@lru_cache(maxsize=KNOWN)
def circle(radius: float = 1.0) -> Path:
    """Return a circle to the left of the start, one radian a unit of s; ``radius`` in m."""

    def formula(at: Along) -> Place:
        pose = radius * math.sin(at.x), radius * (1.0 - math.cos(at.x)), at.x
        return Place(pose, (radius, 0.0, 1.0))

    return Path(formula)


@lru_cache(maxsize=KNOWN)
def eight(length: float = 1.5, width: float = 0.75) -> Path:
    """Return a figure-eight about the origin, one lap a 2π of s.

    x = length sin s, y = width sin 2s: ``length`` and ``width`` (m) are its half sizes, and the
    start is its crossing.
    """
    return driven(lambda at: (length * math.sin(at.x), width * math.sin(2.0 * at.x)))


def driven(curve: Callable[[Along], Vector]) -> Path:
    """Return a curve driven forward, heading along it.

    Args:
        curve: Returns x and y, m, where the sheet's x is s; their rates are never both zero.
    """

    def formula(at: Along) -> Place:
        x, y = curve(at)
        vx, vy = at.rate(x), at.rate(y)
        heading = math.atan2(vy, vx)
        return Place((x, y, heading), (math.sqrt(vx * vx + vy * vy), 0.0, at.rate(heading)))

    return Path(formula)


def posed(at: Along, pose: Vector, toward: Vector | None = None) -> Place:
    """Return a place by its pose: the twist is the pose's rate in its own axes."""
    (vx, vy, turn), heading = map(at.rate, pose), pose[2]
    cos, sin = math.cos(heading), math.sin(heading)
    return Place(pose, (cos * vx + sin * vy, cos * vy - sin * vx, turn), toward)


def placed(path: Path, start: Array) -> Path:
    """Return a path that begins at the origin as one that begins at a pose (3,)."""
    cos, sin = np.cos(start[2]), np.sin(start[2])

    def formula(at: Along) -> Place:
        found = path.formula(at)
        x, y, heading = found.pose
        place = start[0] + cos * x - sin * y, start[1] + sin * x + cos * y, start[2] + heading
        return found._replace(pose=place)

    return Path(formula)


def scaled(path: Path, factor: float) -> Path:
    """Return a path ``factor`` times larger, by the same parameter."""

    def formula(at: Along) -> Place:
        (x, y, heading), (forward, left, turn), _ = path.formula(at)
        pose = factor * x, factor * y, heading
        return Place(pose, (factor * forward, factor * left, turn))

    return Path(formula)


class PathTime(NamedTuple):
    """Path parameter at a time, and its first two derivatives by time; or arrays (K,) of each."""

    s: Numbers
    rate: Numbers
    acceleration: Numbers


def ramped_time(t: Any, ramp: float) -> Any:
    """Return s(t), a scalar whose rate rises from 0 to 1 in ``ramp`` seconds, then stays.

    The rise is a quintic: rate, acceleration and jerk start and end at zero, so no effort jumps.

    Args:
        ramp: Duration of the rise, s; 0 for none.
    """
    if not ramp:
        return t
    return math.if_else(t >= ramp, t - 0.5 * ramp, ramp * smooth_step(t / ramp).area)


DEGREE = 5


Curve = Callable[[Along], Vector]
"""Positions (n,), where the sheet's x is the path's parameter s."""


def spline_curve(spline: BSpline) -> Curve:
    """Return a spline's values (n,) as positions."""
    return lambda at: at.spline(spline)


def constant(values: Array) -> Curve:
    """Return positions (n,) that stay."""
    return lambda at: values.tolist()


def quintic(knots: Array, coefficients: Array) -> BSpline:
    """Return the spline with coefficients (m, ...) over knots (m + 6,)."""
    return BSpline(knots, coefficients, DEGREE)


def basis(knots: Array) -> BSpline:
    """Return the m basis functions over knots (m + 6,), as one spline with values (m,)."""
    return quintic(knots, np.eye(len(knots) - DEGREE - 1))


def basis_at(knots: Array, points: Array, order: int) -> csr_array:
    """Return the m basis functions, or a derivative of them, at points: (N, m), six in a row.

    Args:
        knots: (m + 6,), clamped.
        points: (N,), between the outer knots.
        order: Of the derivative; 0 for the functions.
    """
    to_derivative = diags_array(np.ones(len(knots) - DEGREE - 1))
    for degree in range(DEGREE, DEGREE - order, -1):
        # The derivative's coefficients are differences of the spline's: de Boor, 1978, ch. X.
        rate = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
        shape = len(rate), len(rate) + 1
        to_derivative = diags_array([-rate, rate], offsets=[0, 1], shape=shape) @ to_derivative
        knots = knots[1:-1]
    functions = BSpline.design_matrix(points, knots, DEGREE - order)
    return csr_array(csr_array(functions) @ to_derivative)


def through(t: Array, values: Array, ends: Any = None) -> BSpline:
    """Return the spline through points.

    Args:
        values: Values there (K, n).
        ends: Derivatives at both ends, as ``bc_type`` of SciPy's ``make_interp_spline``; None
            takes the knots from the parameters alone.
    """
    return make_interp_spline(t, values, k=DEGREE, bc_type=ends)


def clamped_knots(points: Array) -> Array:
    """Return the knots (K + 10,) of a spline that begins and ends at the outer points (K,)."""
    return np.concatenate([np.full(DEGREE, points[0]), points, np.full(DEGREE, points[-1])])


def uniform_knots(count: int) -> Array:
    """Return the knots (count + 6,) of ``count`` coefficients, 1 apart; the spline begins at 0."""
    return np.arange(count + DEGREE + 1.0) - DEGREE
