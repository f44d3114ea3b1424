"""Base paths with exact derivatives, the ramp that starts them softly, and quintic splines.

Each formula is written once, of one number and of many alike. A number is a float, and many are an
array (K,). A vector of a number is an array (n,), and of many it is an array (K, n), a row each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse import csr_array, diags_array

from rpctl.arrays import Array

Numbers = Any  # a float or an array (K,)
Answer = TypeVar("Answer", bound=NamedTuple)


def functions(s: Numbers) -> Any:
    """Return the module whose sin, cos, atan2 and sqrt are the quickest for numbers."""
    return np if isinstance(s, np.ndarray) else math


def factors(s: Numbers) -> Any:
    """Return numbers such that they scale vectors of as many."""
    return s[:, None] if isinstance(s, np.ndarray) else s


def entries(vectors: Array) -> list[Any]:
    """Return the entries of a vector (n,) or of vectors (K, n): n numbers, or n arrays (K,)."""
    found: list[Any] = vectors.tolist() if vectors.ndim == 1 else list(vectors.T)
    return found


def vector(s: Numbers, parts: Sequence[Numbers]) -> Array:
    """Return a vector (n,) of its entries, or as many (K, n) as there are numbers.

    Args:
        parts: The entries (n,): of all, or those of each.
    """
    if not isinstance(s, np.ndarray):
        return np.array(parts)
    found = np.empty((len(s), len(parts)))
    for column, part in enumerate(parts):
        found[:, column] = part
    return found


def matrix(s: Numbers, rows: Sequence[Sequence[Numbers]]) -> Array:
    """Return a matrix (m, n) of its rows' entries, or as many (K, m, n) as there are numbers."""
    if not isinstance(s, np.ndarray):
        return np.array(rows)
    return vector(s, [part for row in rows for part in row]).reshape(len(s), len(rows), -1)


def split_rows(matrices: Array) -> Array:
    """Return the rows of a matrix (m, n) or of matrices (K, m, n), to be unpacked."""
    return matrices if matrices.ndim == 2 else matrices.swapaxes(0, 1)


def stack_rows(*rows: Array) -> Array:
    """Return the matrix of rows (n,), or the matrices of rows (K, n)."""
    found = np.array(rows)
    return found if found.ndim == 2 else np.ascontiguousarray(found.swapaxes(0, 1))


def choose(
    condition: Any,
    s: Numbers,
    then: Callable[[Any], Answer],
    otherwise: Callable[[Any], Answer],
) -> Answer:
    """Return one of two formulas' answers, for each number that of its own.

    Args:
        condition: Whether it is the first one's; of many numbers an array (K,).
    """
    if not isinstance(s, np.ndarray):
        return then(s) if condition else otherwise(s)
    if condition.all():
        return then(s)
    if not condition.any():
        return otherwise(s)
    first, second = then(s[condition]), otherwise(s[~condition])
    found = []
    for a, b in zip(first, second, strict=True):
        whole = np.empty((len(s), *np.shape(a)[1:]))
        whole[condition], whole[~condition] = a, b
        found.append(whole)
    make: Callable[..., Answer] = type(first)
    return make(*found)


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


class PathPoint(NamedTuple):
    """A point of a path, and the direction of travel there.

    The direction is the twist by the path's parameter s: speed forward (m, negative where the
    robot drives backwards), speed to the left, turning (rad). A path in these terms may turn on
    the spot and may be run through at any pace, from standstill on, without a division by zero.
    """

    pose: Array  # (3,) x, y in m, heading in rad; (K, 3) of many points
    direction: Array  # (3, 3): the twist by s, and its first and second derivative by s; (K, 3, 3)


Path = Callable[[Numbers], PathPoint]
"""A path: its point at s, or its points at many s; see :mod:`rpctl.reference.paths`."""


def line(step: float = 1.0) -> Path:
    """Return a straight line along x; ``step`` m a unit of s, backwards where negative."""

    def at(s: Numbers) -> PathPoint:
        return PathPoint(vector(s, (step * s, 0.0, 0.0)), steady(s, step, 0.0))

    return at


def spin(sense: float = 1.0) -> Path:
    """Return a turn on the spot, one radian a unit of s; to the right where ``sense`` is −1."""

    def at(s: Numbers) -> PathPoint:
        return PathPoint(vector(s, (0.0, 0.0, sense * s)), steady(s, 0.0, sense))

    return at


def placed(path: Path, start: Array) -> Path:
    """Return a path that begins at the origin as one that begins at a pose (3,)."""
    cos, sin = math.cos(start[2]), math.sin(start[2])

    def at(s: Numbers) -> PathPoint:
        pose, direction = path(s)
        x, y, heading = entries(pose)
        place = (start[0] + cos * x - sin * y, start[1] + sin * x + cos * y, start[2] + heading)
        return PathPoint(vector(s, place), direction)

    return at


def circle(radius: float = 1.0) -> Path:
    """Return a circle to the left of the start, one radian a unit of s; ``radius`` in m."""

    def at(s: Numbers) -> PathPoint:
        of = functions(s)
        pose = vector(s, (radius * of.sin(s), radius * (1.0 - of.cos(s)), s))
        return PathPoint(pose, steady(s, radius, 1.0))

    return at


def eight(length: float = 1.5, width: float = 0.75) -> Path:
    """Return a figure-eight about the origin, one lap a 2π of s.

    x = length sin s, y = width sin 2s: ``length`` and ``width`` (m) are its half sizes, and the
    start is its crossing.
    """

    def at(s: Numbers) -> PathPoint:
        of, twice = functions(s), 2.0 * s
        x, x1 = length * of.sin(s), length * of.cos(s)
        y, y1 = width * of.sin(twice), 2.0 * width * of.cos(twice)
        return planar((x, y), (x1, y1), (-x, -4.0 * y), (-x1, -4.0 * y1), (x, 16.0 * y))

    return at


def scaled(path: Path, factor: float) -> Path:
    """Return a path ``factor`` times larger, by the same parameter."""
    if factor == 1.0:
        return path
    size = np.array([factor, factor, 1.0])

    def at(s: Numbers) -> PathPoint:
        pose, direction = path(s)
        return PathPoint(pose * size, direction * size)

    return at


Planar = tuple[Numbers, Numbers]  # x and y


def planar(position: Planar, d1: Planar, d2: Planar, d3: Planar, d4: Planar) -> PathPoint:
    """Return the point of a curve driven forward, heading along it; or as many as there are x.

    Args:
        position: x, y, m.
        d1: Their first derivatives by the curve's parameter, not both zero.
    """
    (x, y), (x1, y1), (x2, y2), (x3, y3), (x4, y4) = position, d1, d2, d3, d4
    of = functions(x)
    square, slope = x1 * x1 + y1 * y1, 2.0 * (x1 * x2 + y1 * y2)
    bend = 2.0 * (x2 * x2 + y2 * y2 + x1 * x3 + y1 * y3)
    across, across_rate = x1 * y2 - y1 * x2, x1 * y3 - y1 * x3
    across_bend = x2 * y3 - y2 * x3 + x1 * y4 - y1 * x4
    speed = of.sqrt(square)
    speed_rate = 0.5 * slope / speed
    speed_bend = (0.5 * bend - speed_rate * speed_rate) / speed
    turn = across / square
    turn_rate = (across_rate - turn * slope) / square
    turn_bend = (across_bend - 2.0 * turn_rate * slope - turn * bend) / square
    rows = (speed, 0.0, turn), (speed_rate, 0.0, turn_rate), (speed_bend, 0.0, turn_bend)
    return PathPoint(vector(x, (x, y, of.atan2(y1, x1))), matrix(x, rows))


def steady(s: Numbers, speed: float, turn: float) -> Array:
    """Return a direction (3, 3) that does not change along the path, or as many as there are s.

    Args:
        s: The path's parameter.
        speed: Forward, m a unit of s.
        turn: rad a unit of s.
    """
    return matrix(s, ((speed, 0.0, turn), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


class PathTime(NamedTuple):
    """Path parameter at a time, and its first two derivatives by time; or arrays (K,) of each."""

    s: Numbers
    rate: Numbers
    acceleration: Numbers


def ramped_time(t: Numbers, rate: float, ramp: float) -> PathTime:
    """Return s(t) whose rate rises from 0 to ``rate`` in ``ramp`` seconds, then stays.

    The rise is a quintic: rate, acceleration and jerk start and end at zero, so no effort jumps.

    Args:
        rate: Final rate, 1/s.
        ramp: Duration of the rise, s; 0 for none.
    """

    def steadily(t: Numbers) -> PathTime:
        return PathTime(rate * (t - 0.5 * ramp), rate, 0.0)

    def rising(t: Numbers) -> PathTime:
        step = smooth_step(t / ramp)
        return PathTime(rate * ramp * step.area, rate * step.value, rate / ramp * step.slope)

    return choose(t >= ramp, t, steadily, rising)


DEGREE = 5


class Curves:
    """A spline of a path parameter s, with its first two derivatives."""

    def __init__(self, spline: BSpline) -> None:
        self._orders = spline, spline.derivative(1), spline.derivative(2)

    def __call__(self, s: float | Array) -> tuple[Array, Array, Array]:
        """Return values, and first and second derivatives by s, (n,) or (K, n) each."""
        value, slope, bend = (order(s) for order in self._orders)
        return value, slope, bend


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
        width = knots[degree + 1 : -1] - knots[1 : -degree - 1]
        rate = degree / width
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
