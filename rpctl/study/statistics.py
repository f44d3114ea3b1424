"""Figures of runs with intervals that assume no distribution, and which parameters matter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.libraries import library
from rpctl.study.experiment import MORRIS_LEVELS, Design, extra, unit_problem

CONFIDENCE = 0.95
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)  # of the quantiles that are told


class Interval(NamedTuple):
    """An estimate and its confidence interval; ±inf where the sample does not bound it."""

    value: float
    low: float
    high: float


class MeritStatistics(NamedTuple):
    """What is known of a merit over all runs.

    Attributes:
        name: Of the merit.
        runs: How many there are.
        missing: Runs without it, as those that diverged; for quantiles it is infinite there.
        mean: Over the runs that have it.
        quantiles: By level (0 to 1).
        largest: The worst that is finite.
    """

    name: str
    runs: int
    missing: int
    mean: Interval
    quantiles: dict[float, Interval]
    largest: float


def describe(
    name: str, values: Array, levels: Sequence[float] = LEVELS, confidence: float = CONFIDENCE
) -> MeritStatistics:
    """Return the statistics of a merit.

    Args:
        name: Of the merit.
        values: Of each run (N,); NaN or infinite where a run has none.
        levels: Of the quantiles.
        confidence: Of the intervals.
    """
    known = np.isfinite(values)
    ordered = np.sort(np.where(known, values, np.inf))
    return MeritStatistics(
        name,
        len(values),
        int((~known).sum()),
        mean(values[known], confidence),
        {p: quantile(ordered, p, confidence) for p in levels},
        float(values[known].max()) if known.any() else math.nan,
    )


def mean(values: Array, confidence: float = CONFIDENCE) -> Interval:
    """Return the mean of a sample (N,) and Student's interval.

    Args:
        values: The sample, finite.
        confidence: Of the interval.
    """
    count = len(values)
    center = float(np.mean(values)) if count else math.nan
    if count < 2:
        return Interval(center, -math.inf, math.inf)
    error = float(np.std(values, ddof=1)) / math.sqrt(count)
    reach = error * float(library("scipy.stats").t.ppf(0.5 + 0.5 * confidence, count - 1))
    return Interval(center, center - reach, center + reach)


def quantile(values: Array, level: float, confidence: float = CONFIDENCE) -> Interval:
    """Return the quantile of a sample (N,) and an interval between two order statistics.

    The number of values below the true quantile p is binomial (N, p) whatever the distribution, so
    X₍ₗ₎ ≤ q ≤ X₍ᵤ₎ with at least the confidence if l and u leave (1 − confidence)/2 on each side.
    The estimate is the smallest value with at least a share p of the sample at or below it.

    Args:
        values: The sample; infinite values are allowed.
        level: p, above 0 and below 1.
        confidence: Of the interval.
    """
    if not 0.0 < level < 1.0:
        raise RpctlError(f"a quantile's level is {level:g}; give one between 0 and 1")
    ordered, count = np.sort(values), len(values)
    if not count:
        return Interval(math.nan, -math.inf, math.inf)
    binom = library("scipy.stats").binom
    tail = 0.5 * (1.0 - confidence)
    # P(K < l) <= tail and P(K >= u) <= tail, K of the values being below the quantile
    low = int(binom.ppf(tail, count, level))
    high = int(binom.isf(tail, count, level)) + 1
    at = max(math.ceil(level * count * (1.0 - 1e-12)), 1)
    return Interval(
        float(ordered[at - 1]),
        float(ordered[low - 1]) if low >= 1 else -math.inf,
        float(ordered[high - 1]) if high <= count else math.inf,
    )


def share(hits: int, count: int, confidence: float = CONFIDENCE) -> Interval:
    """Return a share and the interval of Clopper and Pearson, which keeps its confidence always.

    Args:
        hits: How many.
        count: Of how many.
        confidence: Of the interval.
    """
    if not count:
        return Interval(math.nan, 0.0, 1.0)
    found = library("scipy.stats").binomtest(hits, count).proportion_ci(confidence, "exact")
    return Interval(hits / count, float(found.low), float(found.high))


def worst_rows(values: Array, count: int) -> NDArray[np.intp]:
    """Return the rows of the worst values, the worst first; those without a value lead.

    Args:
        values: Of each run (N,), larger is worse; NaN where a run has none.
        count: How many rows.
    """
    return np.argsort(-np.where(np.isnan(values), np.inf, values), kind="stable")[:count]


def envelope(series: Array, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
    """Return the quantiles of a series at each instant, (levels, T); NaN counts as infinite.

    Args:
        series: Of each run (N, T).
        levels: Of the quantiles.
    """
    ordered = np.sort(np.where(np.isnan(series), np.inf, series), axis=0)
    at = [max(math.ceil(p * len(series) * (1.0 - 1e-12)), 1) - 1 for p in levels]
    return np.asarray(ordered[at])


# ---- which parameters matter --------------------------------------------------------------

RESAMPLES = 200  # of SALib's bootstrap
MAP_BINS = 8  # along each parameter of a map
RANKS = ("rank_correlation", "from_middle")  # measures where the design has none of its own
MAIN = {"sobol": "total", "morris": "mu_star"}  # of the measures: by which parameters are ranked
NAMES = {"sobol": ("first", "total"), "morris": ("mu_star", "sigma"), "rank-correlation": RANKS}
ROUNDING = 1e-14  # of a correlation
MONOTONIC, EITHER_SIDE = "monotonic", "either side"
SMALLEST_SPREAD = 1e-12  # of a merit, relative to its size: less is rounding and explains nothing

Measures = dict[str, tuple[Interval, ...]]


@dataclass(frozen=True)
class Sensitivity:
    """How much each parameter matters to a merit.

    Attributes:
        merit: Its name.
        method: ``"sobol"``, ``"morris"`` or ``"rank-correlation"``.
        parameters: Their names.
        measures: By name, an interval for each parameter. Of Sobol ``first`` and ``total``: shares
            of the merit's variance that it causes alone, and with all others. Of Morris
            ``mu_star``: mean size of the change of the merit over the parameter's range, in the
            merit's unit, and ``sigma``: how that change varies. Else from −1 to 1
            ``rank_correlation``, and ``from_middle``: that of the parameter's distance from its
            median, as of an initial error that matters on either side.
        replaced: Runs that have no such merit; they count as the worst that has.
    """

    merit: str
    method: str
    parameters: tuple[str, ...]
    measures: Mapping[str, tuple[Interval, ...]]
    replaced: int

    @property
    def ranking(self) -> tuple[str, ...]:
        """The parameters, what matters most first."""
        keys = (MAIN[self.method],) if self.method in MAIN else RANKS
        size = np.max([[abs(each.value) for each in self.measures[key]] for key in keys], axis=0)
        return tuple(self.parameters[j] for j in np.argsort(-size, kind="stable"))


class Importance(NamedTuple):
    """How much a parameter matters to a merit, within which interval, and in which way.

    Attributes:
        name: The parameter's path.
        value: The measure of the method: Sobol's ``total``, Morris's ``mu_star``, or the larger one
            of both rank correlations.
        low: Of its interval; NaN or infinite where there is none.
        high: Likewise.
        way: :data:`MONOTONIC` where it is the parameter that correlates, :data:`EITHER_SIDE` where
            it is its distance from its median; empty where the method does not tell.
    """

    name: str
    value: float
    low: float
    high: float
    way: str = ""


def importances(found: Sensitivity, most: int) -> list[Importance]:
    """Return how much parameters matter, what matters most first.

    Args:
        found: What was found.
        most: Number of parameters.
    """
    listed = []
    for name in found.ranking[:most]:
        j = found.parameters.index(name)
        if found.method in MAIN:
            listed.append(Importance(name, *found.measures[MAIN[found.method]][j]))
            continue
        straight, folded = (found.measures[key][j] for key in RANKS)
        bent = abs(folded.value) > abs(straight.value)
        way = EITHER_SIDE if bent else MONOTONIC
        listed.append(Importance(name, *(folded if bent else straight), way))
    return listed


@dataclass(frozen=True)
class ParameterMap:
    """The median of a merit over two parameters.

    Attributes:
        merit: Its name.
        x: The first parameter.
        y: The second one.
        x_edges: Of the bins (nx + 1,), which hold about as many runs each.
        y_edges: Of the bins (ny + 1,).
        median: (ny, nx); NaN where there is no run, inf where most runs have no such merit.
        count: Runs in each bin (ny, nx).
    """

    merit: str
    x: str
    y: str
    x_edges: Array
    y_edges: Array
    median: Array
    count: NDArray[np.intp]


def sensitivity(
    merit: str,
    parameters: Sequence[str],
    design: Design,
    points: Array,
    values: Array,
) -> Sensitivity:
    """Return how much each parameter matters to a merit.

    Args:
        merit: Its name.
        parameters: Names of the parameters.
        design: The design of the runs; it decides the method.
        points: Its points (N, parameters), in [0, 1].
        values: The merit of each run (N,); NaN or infinite where it has none.
    """
    known = np.isfinite(values)
    finite = np.where(known, values, values[known].max() if known.any() else 0.0)
    method = design.kind if design.kind in MAIN else "rank-correlation"
    varies = bool(np.ptp(finite) > SMALLEST_SPREAD * np.abs(finite).max())
    if method == "rank-correlation":
        # a run without a merit is worse than any that has one, and ranks can say so
        varies = varies or 0 < known.sum() < len(values)
        found = _ranks(points, np.where(known, values, np.inf))
    elif varies:  # SALib would divide by a variance of zero
        found = _indices(design, points, finite)
    if not varies:
        found = dict.fromkeys(NAMES[method], (Interval(0.0, 0.0, 0.0),) * points.shape[1])
    return Sensitivity(merit, method, tuple(parameters), found, int((~known).sum()))


def _indices(design: Design, points: Array, values: Array) -> Measures:
    """Return what SALib makes of Sobol's or Morris's design."""
    analyze = extra(f"SALib.analyze.{design.kind}").analyze
    problem = unit_problem(points.shape[1])
    # SALib takes 0 for no seed
    common = {"num_resamples": RESAMPLES, "conf_level": CONFIDENCE, "seed": design.seed + 1}
    if design.kind == "sobol":
        found = analyze(problem, values, calc_second_order=False, **common)
        reaches = {"first": ("S1", "S1_conf"), "total": ("ST", "ST_conf")}
    else:
        problem["groups"] = problem["names"]
        found = analyze(problem, points, values, num_levels=MORRIS_LEVELS, **common)
        found["none"] = np.full(points.shape[1], np.nan)
        reaches = {"mu_star": ("mu_star", "mu_star_conf"), "sigma": ("sigma", "none")}
    return {
        name: tuple(
            Interval(float(v), float(v - r), float(v + r))
            for v, r in zip(found[value], found[reach], strict=True)
        )
        for name, (value, reach) in reaches.items()
    }


def _ranks(points: Array, values: Array) -> Measures:
    ranks = library("scipy.stats").rankdata(points, axis=0)
    distances = np.abs(ranks - ranks.mean(axis=0))
    return {
        name: tuple(rank_correlation(column, values) for column in columns.T)
        for name, columns in zip(RANKS, (ranks, distances), strict=True)
    }


def rank_correlation(x: Array, y: Array, confidence: float = CONFIDENCE) -> Interval:
    """Return Spearman's rank correlation and its interval, by Fisher's transformation.

    The transformed correlation has the standard error √((1 + ρ²/2)/(N − 3)) (Bonett and Wright,
    Psychometrika 65, 2000).

    Args:
        x: A sample (N,).
        y: Another one, of the same runs; infinite values are allowed.
        confidence: Of the interval.
    """
    stats, count = library("scipy.stats"), len(x)
    ranks = stats.rankdata([x, y], axis=1)
    if not np.ptp(ranks, axis=1).all():
        return Interval(0.0, -1.0, 1.0)
    rho = float(np.clip(np.corrcoef(ranks)[0, 1], -1.0, 1.0))
    if count <= 3:
        return Interval(rho, -1.0, 1.0)
    if 1.0 - abs(rho) < ROUNDING:
        rho = math.copysign(1.0, rho)
        return Interval(rho, rho, rho)
    error = math.sqrt((1.0 + 0.5 * rho**2) / (count - 3))
    low, high = stats.norm.interval(confidence, math.atanh(rho), error)
    return Interval(rho, math.tanh(low), math.tanh(high))


def parameter_map(
    merit: str, names: tuple[str, str], x: Array, y: Array, values: Array, bins: int = MAP_BINS
) -> ParameterMap:
    """Return the median of a merit over two parameters, in bins of about as many runs.

    Args:
        merit: Its name.
        names: Of the two parameters.
        x: The first parameter of each run (N,).
        y: The second one (N,).
        values: The merit (N,); NaN or infinite where a run has none.
        bins: The most along each parameter.
    """
    edges = [_edges(each, bins) for each in (x, y)]
    ranked = np.where(np.isfinite(values), values, np.inf)
    found = library("scipy.stats").binned_statistic_2d(
        x, y, ranked, lambda inside: np.sort(inside)[(len(inside) - 1) // 2], edges
    )
    median = found.statistic.T  # a value of a run: no mean with infinity
    count = np.histogram2d(x, y, edges)[0].T.astype(np.intp)
    return ParameterMap(merit, *names, edges[0], edges[1], median, count)


def _edges(values: Array, bins: int) -> Array:
    """Return the edges of bins: as many values in each, or a bin for each value if they are few."""
    distinct = np.unique(values)
    if len(distinct) <= bins:
        middles = 0.5 * (distinct[1:] + distinct[:-1])
        first = distinct[0] - (middles[0] - distinct[0] if len(middles) else 0.5)
        last = distinct[-1] + (distinct[-1] - middles[-1] if len(middles) else 0.5)
        return np.array([first, *middles, last])
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)))
