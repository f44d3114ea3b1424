"""Intervals against values known by paper and against their own promise: coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl import RpctlError
from rpctl.study.statistics import describe, envelope, mean, quantile, share, worst_rows
from tests.grids import cells


def test_a_median_lies_between_the_order_statistics_of_the_binomial() -> None:
    # N = 10: P(K <= 1) = 11/1024 = .0107, P(K <= 2) = .0547 > .025: the 2nd and the 9th
    found = quantile(np.arange(1.0, 11.0), 0.5)
    assert found == (5.0, 2.0, 9.0)
    # N = 6: P(K = 0) = 1/64 = .0156: the extremes; N = 5: 1/32 > .025, nothing bounds it
    assert quantile(np.arange(1.0, 7.0), 0.5) == (3.0, 1.0, 6.0)
    assert quantile(np.arange(1.0, 6.0), 0.5) == (3.0, -math.inf, math.inf)


def test_a_high_quantile_needs_enough_runs() -> None:
    # .95^N <= .025 from N = 72 on bounds the 95 % quantile from above
    assert quantile(np.arange(72.0), 0.95).high == 71.0
    assert quantile(np.arange(71.0), 0.95).high == math.inf
    assert quantile(np.arange(100.0), 0.95).value == 94.0
    assert quantile(np.arange(100.0), 0.05).value == 4.0


@pytest.mark.parametrize("level", cells([0.05, 0.5, 0.9], [0.9], [0.05, 0.5]))
def test_intervals_of_quantiles_cover_as_promised(level: float) -> None:
    rng, true = np.random.default_rng(1), -math.log(1.0 - level)
    inside = 0
    for sample in rng.exponential(size=(600, 130)):
        found = quantile(sample, level)
        inside += found.low <= true <= found.high
    assert 0.945 - 0.02 < inside / 600 < 0.99  # at least .95; discrete, so a little more


def test_a_share_has_the_interval_of_clopper_and_pearson() -> None:
    assert share(0, 10) == pytest.approx((0.0, 0.0, 1.0 - 0.025**0.1))  # (1 - p)^10 = .025
    assert share(10, 10) == pytest.approx((1.0, 0.025**0.1, 1.0))
    found = share(5, 10)
    assert found == pytest.approx((0.5, 0.1871, 0.8129), abs=1e-4)  # of their tables
    assert share(0, 0)[1:] == (0.0, 1.0)


def test_the_mean_has_students_interval() -> None:
    # 1, 2, 3: s = 1, t(.975, 2) = 4.302653
    assert mean(np.array([1.0, 2.0, 3.0])) == pytest.approx(
        (2.0, 2.0 - 4.302653 / math.sqrt(3.0), 2.0 + 4.302653 / math.sqrt(3.0))
    )
    assert mean(np.array([1.0])) == (1.0, -math.inf, math.inf)


def test_runs_without_a_merit_are_the_worst_and_are_counted() -> None:
    values = np.array([3.0, np.nan, 1.0, np.inf, 2.0])
    found = describe("error", values, levels=(0.2, 0.6, 0.8))
    assert (found.runs, found.missing, found.largest) == (5, 2, 3.0)
    assert found.mean.value == 2.0
    assert {p: q.value for p, q in found.quantiles.items()} == {0.2: 1.0, 0.6: 3.0, 0.8: math.inf}
    assert worst_rows(values, 3).tolist() == [1, 3, 0]
    assert math.isnan(describe("error", np.full(3, np.nan)).largest)


def test_an_envelope_holds_quantiles_of_each_instant() -> None:
    series = np.array([[0.0, 5.0], [1.0, np.nan], [2.0, 4.0]])
    np.testing.assert_array_equal(envelope(series, (0.3, 0.5, 0.9)), [[0, 4], [1, 5], [2, np.inf]])


def test_a_level_is_a_share() -> None:
    with pytest.raises(RpctlError, match="level is 95; give one between 0 and 1"):
        quantile(np.arange(3.0), 95.0)
