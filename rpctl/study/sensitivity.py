"""Which parameters matter: Sobol's indices, Morris's effects, or rank correlations; and maps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.libraries import library
from rpctl.study.design import MORRIS_LEVELS, Design, extra, unit_problem
from rpctl.study.statistics import CONFIDENCE, Interval

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
        order = np.argsort(-size, kind="stable")
        return tuple(self.parameters[j] for j in order)


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
        names = NAMES[method]
        found = dict.fromkeys(names, (Interval(0.0, 0.0, 0.0),) * points.shape[1])
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
