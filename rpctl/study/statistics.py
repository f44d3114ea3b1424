"""Figures of samples with confidence intervals that assume no distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.libraries import library

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
    order = np.argsort(-np.where(np.isnan(values), np.inf, values), kind="stable")
    return order[:count]


def envelope(series: Array, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
    """Return the quantiles of a series at each instant, (levels, T); NaN counts as infinite.

    Args:
        series: Of each run (N, T).
        levels: Of the quantiles.
    """
    ordered = np.sort(np.where(np.isnan(series), np.inf, series), axis=0)
    at = [max(math.ceil(p * len(series) * (1.0 - 1e-12)), 1) - 1 for p in levels]
    return np.asarray(ordered[at])
