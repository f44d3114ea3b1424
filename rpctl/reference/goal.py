"""The end effector's goal: a path through space, with or without orientation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.splines import quintic, uniform_knots

COINCIDENT = 1e-6  # m; points nearer than this are one


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
        if self.turn is None:
            return None
        return Rotation.from_quat(self.turn(s)).as_matrix()

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
