"""Splines in time to a table's columns: through every row, or smoothed, and what that changed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.reference.paths import through
from rpctl.reference.recorded.smoothing import REST_RATE, Smoothed, smooth
from rpctl.reference.recorded.table_file import Table
from rpctl.reference.sizing import Told

METRES_PER_RADIAN = 0.3  # m/rad: weight of turning relative to travelling
UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "": (1.0, "")}  # what figures are told in


@dataclass(frozen=True)
class SmoothedColumns(Told):
    """What smoothing changed of columns that belong together.

    Attributes:
        columns: Their names.
        unit: Of the figures: m, rad, or none of quaternions.
        rms: Root mean square of their differences from the reference.
        largest: The largest distance of a row from it.
        line: Of the file, where that is.
        noise: Standard deviation of a column's noise as estimated.
        time_constant: Of the low pass, s: slower motion passes, faster is taken for noise.
    """

    columns: str
    unit: str
    rms: float
    largest: float
    line: int
    noise: float
    time_constant: float

    @property
    def sentence(self) -> str:
        """It in one line."""
        factor, unit = UNITS[self.unit]
        rms, largest, noise = (
            f"{factor * figure:.3g} {unit}".rstrip()
            for figure in (self.rms, self.largest, self.noise)
        )
        return (
            f"{self.columns} by {rms} rms and {largest} at most (line {self.line}), with a time "
            f"constant of {self.time_constant:.2g} s; the noise is about {noise}"
        )


class FittedSpline(NamedTuple):
    """A spline to rows, whether it begins and ends in motion, and how fast no motion may seem."""

    spline: BSpline
    starts_moving: bool
    ends_moving: bool
    rate_error: float = 0.0


class RowFit:
    """Fits splines to a table's columns, and keeps what that changed in them.

    Args:
        wish: None passes a spline through every row. A number is the tolerance: the largest root
            mean square of the columns' differences from it, m. ``auto`` chooses by
            cross-validation.
    """

    def __init__(self, table: Table, wish: float | str | None) -> None:
        self.table, self.wish = table, wish
        self.changes: list[SmoothedColumns] = []
        self._changed: dict[str, Array] = {}

    def tolerance(self, lever: float = 1.0) -> float | None:
        """Return the tolerance of a column of which one unit moves the robot by ``lever`` m."""
        return None if isinstance(self.wish, str) or self.wish is None else self.wish / lever

    def smoothed(self, values: Array, lever: float = 1.0) -> Smoothed | None:
        """Return the smoothing spline of rows, or None where they are to be passed.

        Args:
            values: Of the rows (K, n).
            lever: What one unit moves, m.
        """
        if self.wish is None:
            return None
        return smooth(self.table.t, values, self.tolerance(lever))

    def fit(self, names: str, values: Array, unit: str, lever: float = 1.0) -> FittedSpline:
        """Return the spline to columns that share a noise.

        Args:
            values: Of the rows (K, n).
            unit: m, rad or none.
            lever: What one unit moves, m.
        """
        found = self.smoothed(values, lever)
        if found is None:
            return fit_spline(self.table.t, values)
        spline = found.problem.spline(found.coefficients)
        self.keep(names, unit, values, spline, found)
        starts, ends = (not rest for rest in found.rests)
        return FittedSpline(spline, starts, ends, found.rate_error)

    def keep(
        self,
        names: str,
        unit: str,
        values: Array,
        spline: BSpline,
        found: Smoothed,
        columns: slice = slice(None),
    ) -> SmoothedColumns:
        """Keep what a spline changes in columns, and return it.

        Args:
            unit: m, rad or none.
            values: Of the rows (K, n).
            found: With which noise and time constant.
            columns: Which of the spline's they are.
        """
        now = spline(self.table.t)[:, columns]
        self._changed |= dict(zip(names.split(", "), now.T, strict=True))
        off = np.linalg.norm(values - now, axis=1)
        row = int(off.argmax())
        change = SmoothedColumns(
            names, unit, math.sqrt(float(off @ off) / values.size), float(off[row]),
            self.table.lines[row], found.noise, found.tau * found.problem.unit,
        )  # fmt: skip
        self.changes.append(change)
        return change

    def changed_table(self) -> Table:
        """Return the table with what smoothing made of its columns."""
        return replace(self.table, columns={**self.table.columns, **self._changed})


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
