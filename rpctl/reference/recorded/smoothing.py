"""Splines in time to a table's columns: through every row, or smoothed, and what that changed.

They are quintic, and as smooth as a tolerance or the rows' own noise allows. Of all splines f it is
the one that minimises Σ |yₖ − f(tₖ)|² + λ ∫ |f'''|² dt: a low pass 1/(1 + (ωτ)⁶) whose time
constant τ grows with λ^(1/6) (Green and Silverman, *Nonparametric Regression and Generalized Linear
Models*, 1994). Either the columns' root mean square difference from it is a tolerance, or λ is by
generalised cross-validation (Craven and Wahba, *Numerische Mathematik* 31, 1979).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import brentq, minimize_scalar
from scipy.sparse import csr_array, diags_array

from rpctl.arrays import Array
from rpctl.reference.paths import DEGREE, basis_at, clamped_knots, quintic, through
from rpctl.reference.recorded.table_file import Table
from rpctl.reference.sizing import Told

MIN_KNOT_SPACING = 0.04  # s: such a spline follows what a robot can, up to some hertz
LEAST_GAP = 0.25  # of the rows' mean spacing: knots nearer than this make a bad system
SHORTEST, LONGEST = 0.2, 50.0  # τ in knot spacings: rounding is felt where (τ/spacing)⁶ is 1e12
PER_OCTAVE = 2  # values of τ that are tried in each octave
INFLATION = 1.4  # of the fit's degrees of freedom: without it few rows are hardly smoothed
CLEAN_RATIO = 1.5  # to the least score: of rows with noise the shortest τ's is 3.8 times the least
EXACT_TRACE = 300  # coefficients up to which the trace is exact; above, it is sampled
PROBES = 64  # that sample it, to about 1 %
REST_RATE = 2e-3  # m/s or rad/s: what begins or ends slower does so at rest
REST_ERRORS = 3.0  # standard errors of a rate: a smaller one is none
RELATIVE_TAU, AUTO_TAU = 1e-3, 0.05  # to which τ is found; its score is flat about the least
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for |f'''|², of degree 4

Ends = tuple[bool, bool]  # of the first row, of the last


class Fit(NamedTuple):
    """How well a spline fits: the differences' root mean square, and the share of the rows that
    the degrees of freedom are."""

    tau: float
    residual: float
    share: float

    @property
    def noise(self) -> float:
        """The estimated standard deviation of the rows' noise in each column."""
        return self.residual / math.sqrt(max(1.0 - self.share, 1e-3))

    def score(self, inflation: float = 1.0) -> float:
        """Return the score of generalised cross-validation, a variance."""
        left = 1.0 - inflation * self.share
        return (self.residual / left) ** 2 if left > 0.0 else math.inf


class SmoothingProblem:
    """Rows to be smoothed. Times are counted in mean spacings of the rows; λ is τ⁶ in these.

    Args:
        values: Of the rows (K, n).
        spacing: Least distance of the spline's knots, s.
    """

    def __init__(self, t: Array, values: Array, spacing: float = MIN_KNOT_SPACING) -> None:
        self.t, self.values, self.spacing = t, values, spacing
        self.unit = float(t[-1] - t[0]) / (len(t) - 1)
        u = (t - t[0]) / self.unit
        self.breaks = u[spread(u, max(spacing / self.unit, LEAST_GAP))]
        self.knots = clamped_knots(self.breaks)
        width = np.diff(self.breaks)
        points = (self.breaks[:-1, None] + 0.5 * width[:, None] * (1.0 + GAUSS_NODES)).ravel()
        weight = np.sqrt((0.5 * width[:, None] * GAUSS_WEIGHTS).ravel())
        self.at_rows = basis_at(self.knots, u, 0)  # (K, m)
        self.third = csr_array(diags_array(weight) @ basis_at(self.knots, points, 3))
        self._gram = _bands(self.at_rows)
        self._bend = _bands(self.third)
        mean = float(width.mean())
        self.shortest, self.longest = SHORTEST * mean, LONGEST * mean

    def coefficients(self, tau: float, rests: Ends = (False, False)) -> Array:
        """Return the spline's coefficients (m, n).

        Args:
            rests: Whether it begins and ends at rest: there it stays where it would be without.
        """
        right = self.at_rows.T @ self.values
        found = np.asarray(cho_solve_banded(self._factor(tau), right))
        if not any(rests):
            return found
        free = slice(3 if rests[0] else 0, len(found) - (3 if rests[1] else 0))
        held = np.zeros(found.shape)
        held[: free.start], held[free.stop :] = found[0], found[-1]
        right -= self.at_rows.T @ (self.at_rows @ held)
        right -= tau**6 * (self.third.T @ (self.third @ held))
        held[free] = cho_solve_banded(self._factor(tau, free), right[free])
        return held

    def residual(self, coefficients: Array) -> float:
        """Return the root mean square of the columns' differences from a spline."""
        off = self.values - self.at_rows @ coefficients
        return math.sqrt(float((off**2).sum()) / off.size)

    def freedom(self, tau: float) -> float:
        """Return the degrees of freedom: the trace of the map from rows to fitted ones."""
        return float((self._probes * cho_solve_banded(self._factor(tau), self._probed)).sum())

    def fit(self, tau: float) -> Fit:
        """Return how well a spline with free ends fits."""
        return Fit(tau, self.residual(self.coefficients(tau)), self.freedom(tau) / len(self.t))

    def rates(self, tau: float) -> tuple[Array, Array]:
        """Return the free spline's rates at both ends and in the middle (3, n), and what a noise
        of 1 makes of each (3,); both by s."""
        ends = self.knots[0], self.knots[-1]
        a = basis_at(self.knots, np.array([*ends, 0.5 * sum(ends)]), 1).toarray()
        spread_out = self.at_rows @ cho_solve_banded(self._factor(tau), a.T)  # (K, 3)
        error = np.linalg.norm(spread_out, axis=0)
        return a @ self.coefficients(tau) / self.unit, error / self.unit

    def spline(self, coefficients: Array) -> BSpline:
        """Return the spline of coefficients (m, n), by time."""
        return quintic(self.t[0] + self.unit * self.knots, coefficients)

    @cached_property
    def _probes(self) -> Array:
        """Vectors (m, p) whose outer products sum up to the identity, or do so on average."""
        count = self.at_rows.shape[1]
        if count <= EXACT_TRACE:
            return np.eye(count)
        signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(count, PROBES))
        return np.asarray(signs / math.sqrt(PROBES))

    @cached_property
    def _probed(self) -> Array:
        return np.asarray(self.at_rows.T @ (self.at_rows @ self._probes))

    def _factor(self, tau: float, free: slice = slice(None)) -> tuple[Array, bool]:
        return cholesky_banded((self._gram + tau**6 * self._bend)[:, free], lower=True), True


class Smoothed(NamedTuple):
    """A smoothing spline of rows.

    Attributes:
        problem: The rows.
        tau: Its time constant, in mean spacings of the rows.
        coefficients: (m, n).
        noise: Standard deviation of the rows' noise in each column, as estimated.
        rate_error: Standard error of the spline's rate, by s.
        rests: Whether it begins, and whether it ends, at rest.
    """

    problem: SmoothingProblem
    tau: float
    coefficients: Array
    noise: float
    rate_error: float
    rests: Ends


def smooth(t: Array, values: Array, tolerance: float | None) -> Smoothed | None:
    """Return the smoothing spline of rows; where they begin or end at rest, so does it.

    Args:
        values: Of the rows (K, n).
        tolerance: Root mean square of the columns' differences from it; None: cross-validation.

    Returns:
        The spline; None where rows without noise, or within so small a tolerance, are to be left
        as they are.
    """
    problem, tau = _problem(t, values, tolerance)
    if tau is None:
        return None
    noise = problem.fit(tau).noise
    rates, errors = problem.rates(tau)
    slow = np.linalg.norm(rates, axis=1) <= np.maximum(REST_RATE, REST_ERRORS * noise * errors)
    rests = bool(slow[0]), bool(slow[1])
    if tolerance is not None:
        tau = _within(problem, tolerance, rests) or tau
    found = problem.coefficients(tau, rests)
    return Smoothed(problem, tau, found, noise, float(noise * errors[2]), rests)


def on_knots(found: Smoothed | None, t: Array, values: Array, dense: bool) -> Smoothed:
    """Return rows smoothed, though they may have no noise, on the knots of other columns.

    Args:
        found: As smoothed on their own; None: without noise.
        values: The rows (K, n).
        dense: Whether there is a knot at every row.
    """
    if found is None:  # smoothed as little as may be
        problem = SmoothingProblem(t, values, 0.0 if dense else MIN_KNOT_SPACING)
        rates, _ = problem.rates(problem.shortest)
        slow = np.linalg.norm(rates, axis=1) <= REST_RATE
        rests = bool(slow[0]), bool(slow[1])
        least = problem.coefficients(problem.shortest, rests)
        return Smoothed(problem, problem.shortest, least, 0.0, 0.0, rests)
    if dense and found.problem.spacing:
        problem = SmoothingProblem(t, values, 0.0)
        return found._replace(problem=problem, coefficients=problem.coefficients(found.tau))
    return found


def _problem(
    t: Array, values: Array, tolerance: float | None
) -> tuple[SmoothingProblem, float | None]:
    """Return the problem and its τ; None if the rows are not to be smoothed."""
    problem, dense = SmoothingProblem(t, values), SmoothingProblem(t, values, 0.0)
    if tolerance is None:
        return problem, _by_cross_validation(problem, dense)
    tau = _within(problem, tolerance, (False, False))
    if tau is None:
        problem, tau = dense, _within(dense, tolerance, (False, False))
    return problem, tau


def _by_cross_validation(problem: SmoothingProblem, dense: SmoothingProblem) -> float | None:
    """Return the τ of the least score; None if interpolation predicts left-out rows as well.

    Args:
        dense: The rows, with a knot at each.
    """
    count = math.ceil(PER_OCTAVE * math.log2(problem.longest / problem.shortest)) + 1
    tried = np.geomspace(problem.shortest, problem.longest, count)
    fits = [problem.fit(tau) for tau in tried.tolist()]
    clean = dense.fit(dense.shortest)
    if clean.score() <= CLEAN_RATIO * min(fit.score() for fit in fits):
        return None
    scores = [fit.score(INFLATION) for fit in fits]
    best = int(np.argmin(scores))
    near = fits[max(best - 1, 0)], fits[min(best + 1, len(fits) - 1)]
    found = minimize_scalar(
        lambda log: problem.fit(math.exp(log)).score(INFLATION),
        bounds=[math.log(fit.tau) for fit in near],
        method="bounded",
        options={"xatol": AUTO_TAU},
    )
    return math.exp(found.x) if found.fun < scores[best] else fits[best].tau


def _within(problem: SmoothingProblem, tolerance: float, rests: Ends) -> float | None:
    """Return the longest τ whose spline is within a tolerance; None if the shortest is not."""

    def excess(log: float) -> float:
        return problem.residual(problem.coefficients(math.exp(log), rests)) - tolerance

    low, high = math.log(problem.shortest), math.log(problem.longest)
    if excess(low) > 0.0:
        return None
    if excess(high) <= 0.0:
        return problem.longest
    found = brentq(excess, low, high, xtol=RELATIVE_TAU)
    return math.exp(found if excess(found) <= 0.0 else found - 2.0 * RELATIVE_TAU)


def spread(u: Array, least: float) -> Array:
    """Return indices of increasing numbers that are ``least`` apart, of the first and the last."""
    kept, latest = [0], float(u[0])
    for index, at in enumerate(u[1:-1].tolist(), start=1):
        if at - latest >= least and u[-1] - at >= least:
            kept.append(index)
            latest = at
    return np.array([*kept, len(u) - 1])


def _bands(rows: csr_array) -> Array:
    """Return the lower bands (DEGREE + 1, m) of rowsᵀ rows."""
    gram = csr_array(rows.T @ rows)
    bands = np.zeros((DEGREE + 1, gram.shape[0]))
    for k in range(DEGREE + 1):
        bands[k, : gram.shape[0] - k] = gram.diagonal(-k)
    return bands


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
