"""Smooth curves: in the plane through waypoints, and in space through the end effector's points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import BSpline
from scipy.sparse import block_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.paths import (
    Path,
    basis_at,
    clamped_knots,
    driven,
    quintic,
    uniform_knots,
)
from rpctl.reference.planned.arm import pose_error

SPANS_PER_LEG = 4  # of the spline between two waypoints
SAMPLES_PER_LEG = 24  # points between two waypoints where bending is measured
STIFFNESS_LENGTH = 0.3  # of the mean distance: over this length curvature changes
REWEIGHTING_STEPS = 60  # steps that shift the bend away from where it is too sharp
COINCIDENT = 1e-6  # m; points nearer than this are one
MAX_TURN_DEG = 170.0  # a turn beyond is a cusp
DEFAULT_CORNER = 0.15  # m


class Waypoint(NamedTuple):
    """A position to pass (m), and the heading there (rad); None leaves the heading open."""

    x: float
    y: float
    heading: float | None = None


def _require_passable(waypoints: Sequence[Waypoint]) -> None:
    """Refuse waypoints that no smooth curve can pass."""
    if len(waypoints) < 2:
        raise RpctlError(f"{len(waypoints)} waypoints; give two or more")
    legs = np.diff([complex(w.x, w.y) for w in waypoints])
    faults = [
        f"waypoint {i} repeats waypoint {i - 1}; leave one of them out"
        for i, leg in enumerate(legs, start=2)
        if abs(leg) < COINCIDENT
    ]
    turns = np.abs(np.degrees(np.angle(legs[1:] * legs[:-1].conj())))
    faults += [
        f"waypoint {i} turns the path back by {turn:.0f} degrees; add waypoints that lead it round"
        for i, turn in enumerate(turns, start=2)
        if turn > MAX_TURN_DEG and not faults
    ]
    if faults:
        raise RpctlError("; ".join(faults))


def curve_through(waypoints: Sequence[Waypoint], radius: float = 0.0) -> tuple[Path, float]:
    """Return the smooth path through waypoints, driven forward, and its end: s from 0 to there.

    Of all quintic splines through the waypoints, over their distances s, the one that bends least:
    min ∫ w |p''|² + ℓ² |p'''|² ds, a linear system. Where it bends more than allowed, w grows.

    Args:
        radius: Least radius of the path, m; 0 for any.

    Raises:
        RpctlError: Waypoints coincide, or no curve was found that keeps to the radius.
    """
    _require_passable(waypoints)
    legs = [math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(waypoints)]
    s = np.concatenate([[0.0], np.cumsum(legs)])
    spline, sharpest = _fit(waypoints, s, radius)
    if sharpest is not None:
        at, least = sharpest
        number = int(np.abs(s - at).argmin()) + 1
        raise RpctlError(
            f"waypoint {number}: near it the path bends with a radius of {least:.3g} m, and "
            f"{max(radius, 0.0):.3g} m is the least; set the waypoints farther apart, leave a "
            "heading open, or lower turning_radius"
        )
    return driven(lambda at: at.spline(spline)), float(s[-1])


def _fit(
    waypoints: Sequence[Waypoint], s: Array, radius: float
) -> tuple[BSpline, tuple[float, float] | None]:
    """Return the spline, and where it is too sharp (s, radius) if it is."""
    inner = np.concatenate(
        [np.linspace(a, b, SPANS_PER_LEG, endpoint=False) for a, b in pairwise(s)]
    )
    knots = clamped_knots(np.append(inner, s[-1]))
    grid = np.linspace(s[:-1], s[1:], SAMPLES_PER_LEG, endpoint=False).T.ravel()
    grid = np.append(grid, s[-1])
    quadrature = np.gradient(grid)
    slope, bend, twist = (basis_at(knots, grid, order) for order in (1, 2, 3))
    stiff = (STIFFNESS_LENGTH * s[-1] / (len(s) - 1)) ** 2
    fixed, values = _conditions(waypoints, s, knots)
    stiffness = stiff * twist.T @ diags_array(quadrature) @ twist
    right = np.vstack([np.zeros((fixed.shape[1], 2)), values])
    weight = np.ones(len(grid))
    least, found, where = -1.0, np.empty(0), 0.0
    for _ in range(REWEIGHTING_STEPS):
        cost = bend.T @ diags_array(weight * quadrature) @ bend + stiffness
        system = block_array([[cost, fixed.T], [fixed, None]], format="csc")
        c = splu(system).solve(right)[: cost.shape[0]]
        d1, d2 = slope @ c, bend @ c
        speed = np.hypot(d1[:, 0], d1[:, 1])
        curvature = np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.maximum(speed, 1e-9) ** 3
        sharpest = int(curvature.argmax())
        reached = 1.0 / max(float(curvature[sharpest]), 1e-9)
        if reached > least:
            least, found, where = reached, c, float(grid[sharpest])
        if reached >= max(radius, 1e-3):
            break
        weight *= np.maximum(1.0, 1.1 * curvature * max(radius, 1e-3)) ** 0.5
    return quintic(knots, found), (where, least) if least < max(radius, 1e-3) else None


def _conditions(
    waypoints: Sequence[Waypoint], s: Array, knots: Array
) -> tuple[csr_array, list[tuple[float, float]]]:
    """Return the linear conditions on the coefficients: places, and headings at unit speed."""
    headings = [(k, w.heading) for k, w in enumerate(waypoints) if w.heading is not None]
    places, slopes = (basis_at(knots, s, order) for order in (0, 1))
    rows = vstack([places, slopes[np.array([k for k, _ in headings], int)]])
    values = [(w.x, w.y) for w in waypoints]
    return csr_array(rows), [
        *values,
        *((math.cos(angle), math.sin(angle)) for _, angle in headings),
    ]


@dataclass(frozen=True)
class Goal:
    """A path of the end effector, by s: a length (m) or a time (s).

    Attributes:
        position: (3,) in the world by s, m.
        turn: Quaternion (x, y, z, w) by s, to be scaled to length 1; None leaves it open.
        start: First s.
        end: Last s.
        timed: Whether s is time: then speeds are given.
    """

    position: BSpline = field(repr=False)
    turn: BSpline | None = field(repr=False)
    start: float
    end: float
    timed: bool

    def rotation(self, s: float) -> Array | None:
        """Return the orientation (3, 3) at s, or None where it is open."""
        return None if self.turn is None else Rotation.from_quat(self.turn(s)).as_matrix()

    def error(self, found: pin.SE3, s: float) -> Array:
        """Return how far an end effector is from it at s (3 or 6,), m."""
        return pose_error(found, self.position(s), self.rotation(s))

    @property
    def length(self) -> float:
        """Length of the path, m."""
        points = self.position(np.linspace(self.start, self.end, 400))
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def label(self, s: float) -> str:
        """Return s in words, for messages."""
        return f"t = {s - self.start:.3g} s" if self.timed else f"{s:.3g} m of the path on"


def polyline(points: Sequence[Sequence[float]], corner: float) -> Goal:
    """Return straight lines between points, corners rounded; s is the length along them, m.

    Samples of the lines are the coefficients of a uniform quintic spline: it is each line where
    three samples either way lie on it, and rounds what is between.

    Args:
        points: Points (x, y, z), m; two or more.
        corner: Distance from a corner at which its rounding begins, m.

    Raises:
        RpctlError: Points coincide, or a line is shorter than its roundings.
    """
    places = np.array(points, dtype=np.float64)
    if len(places) < 2:
        raise RpctlError(f"{len(places)} points; give two or more")
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1)
    for number, leg in enumerate(legs, start=1):
        if leg < COINCIDENT:
            raise RpctlError(f"point {number + 1} repeats point {number}; leave one of them out")
        if leg < 2.0 * corner:
            raise RpctlError(
                f"points {number} and {number + 1} are {leg:.3g} m apart, and each corner is "
                f"rounded over {corner:.3g} m; set them farther apart or lower corner"
            )
    way = np.concatenate([[0.0], np.cumsum(legs)])
    count = math.ceil(round(way[-1] / (corner / 3.0), 6))  # no piece more for a rounding's sake
    step = way[-1] / count
    # Beyond the ends the lines go on, so that the path begins and ends in the points themselves.
    way[0] -= 3.0 * step
    way[-1] += 3.0 * step
    before, after = (places[1] - places[0]) / legs[0], (places[-1] - places[-2]) / legs[-1]
    places[0] -= 3.0 * step * before
    places[-1] += 3.0 * step * after
    samples = step * np.arange(-2, count + 3)
    values = np.column_stack([np.interp(samples, way, places[:, i]) for i in range(3)])
    return Goal(
        quintic(step * uniform_knots(len(values)), values), None, 0.0, way[-1] - 3.0 * step, False
    )
