"""What matters: functions whose indices are known by paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.study.experiment import Design
from rpctl.study.statistics import Sensitivity, parameter_map, rank_correlation, sensitivity

NAMES = ("x1", "x2", "x3")


def ishigami(points: Array) -> Array:
    """sin x1 + 7 sin² x2 + .1 x3⁴ sin x1 on (−π, π)³, from points of the unit cube."""
    x = math.pi * (2.0 * points - 1.0)
    return np.asarray(
        np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    )


def found(design: Design, values: Array, points: Array) -> Sensitivity:
    return sensitivity("merit", NAMES, design, points, values)


def test_sobol_finds_the_indices_of_ishigami() -> None:
    design = Design("sobol", 2048 * 5, seed=0)
    points = design.points(3)
    result = found(design, ishigami(points), points)
    # V = a²/8 + bπ⁴/5 + b²π⁸/18 + 1/2 with a = 7, b = .1; V1 = ½(1 + bπ⁴/5)², V13 = 8b²π⁸/225
    total = 49 / 8 + 0.1 * math.pi**4 / 5 + 0.01 * math.pi**8 / 18 + 0.5
    v1, v2 = 0.5 * (1 + 0.1 * math.pi**4 / 5) ** 2, 49 / 8
    v13 = 8 * 0.01 * math.pi**8 / 225
    first, whole = result.measures["first"], result.measures["total"]
    assert [each.value for each in first] == pytest.approx([v1 / total, v2 / total, 0.0], abs=0.02)
    assert [each.value for each in whole] == pytest.approx(
        [(v1 + v13) / total, v2 / total, v13 / total], abs=0.02
    )
    assert all(0.0 < each.high - each.low < 0.2 for each in (*first, *whole))
    assert result.ranking == NAMES


def test_morris_finds_the_effects_of_a_linear_function() -> None:
    design = Design("morris", 80, seed=0)
    points = design.points(3)
    result = found(design, points @ np.array([1.0, -5.0, 2.0]), points)
    assert [each.value for each in result.measures["mu_star"]] == pytest.approx([1.0, 5.0, 2.0])
    assert [each.value for each in result.measures["sigma"]] == pytest.approx([0.0] * 3, abs=1e-12)
    assert result.ranking == ("x2", "x3", "x1")


def test_ranks_see_any_monotone_dependence_and_its_sign() -> None:
    design = Design("latin-hypercube", 200, seed=0)
    points = design.points(3)
    result = found(design, np.exp(-5.0 * points[:, 1]), points)
    rho = result.measures["rank_correlation"]
    assert rho[1] == (-1.0, -1.0, -1.0)
    assert abs(rho[0].value) < 0.2
    assert rho[0].low < 0.0 < rho[0].high
    assert result.ranking[0] == "x2"


def test_what_matters_on_either_side_is_seen() -> None:
    design = Design("latin-hypercube", 200, seed=0)
    points = design.points(3)
    result = found(design, np.abs(points[:, 2] - 0.5) + 0.05 * points[:, 0], points)
    assert abs(result.measures["rank_correlation"][2].value) < 0.2
    assert result.measures["from_middle"][2].low > 0.95
    assert result.ranking == ("x3", "x1", "x2")


def test_the_rank_correlation_of_a_few_values() -> None:
    # d = (0, 1, -1, 0, 0): rho = 1 - 6·2/(5·24) = .9; Fisher: artanh .9 ± 1.96 √(1.405/2)
    rho = rank_correlation(np.arange(5.0), np.array([1.0, 9.0, 3.0, 10.0, 20.0]))
    reach = 1.959964 * math.sqrt((1.0 + 0.405) / 2.0)
    low, high = (math.tanh(math.atanh(0.9) + s * reach) for s in (-1, 1))
    assert rho == pytest.approx((0.9, low, high), abs=1e-6)


def test_intervals_of_rank_correlations_cover_as_promised() -> None:
    rng, r = np.random.default_rng(0), 0.5
    true, inside = 6.0 / math.pi * math.asin(r / 2.0), 0  # Spearman's of the normal distribution
    for _ in range(400):
        x, noise = rng.standard_normal((2, 60))
        rho = rank_correlation(x, r * x + math.sqrt(1.0 - r * r) * noise)
        inside += rho.low <= true <= rho.high
    assert 0.92 < inside / 400 < 0.98


@pytest.mark.parametrize("kind", ["monte-carlo", "sobol", "morris"])
def test_nothing_matters_to_a_constant(kind: str) -> None:
    design = Design(kind, 40)
    points = design.points(3)
    for values in (np.full(40, 3.0), np.full(40, np.nan)):
        for intervals in found(design, values, points).measures.values():
            assert all(each == (0.0, 0.0, 0.0) for each in intervals)


@pytest.mark.parametrize("kind", ["monte-carlo", "morris"])
def test_runs_without_a_merit_count_as_the_worst(kind: str) -> None:
    design = Design(kind, 160, seed=1)
    points = design.points(3)
    values = points @ np.array([0.1, 1.0, 0.1])
    values[points[:, 1] > 0.7] = np.nan
    result = found(design, values, points)
    assert result.replaced == np.isnan(values).sum() > 0
    assert result.ranking[0] == "x2"
    worst = np.nanmax(values)
    replaced = found(design, np.where(np.isnan(values), worst, values), points)
    if kind == "morris":
        assert result.measures["mu_star"] == replaced.measures["mu_star"]
    if kind == "monte-carlo":  # the sign is that of a merit that failures make worse
        assert result.measures["rank_correlation"][1].low > 0.8


def test_a_map_has_the_medians_of_its_bins() -> None:
    x, y = np.meshgrid(np.arange(16.0), np.array([0.0, 1.0]))
    values = x + 100.0 * y
    values[1, -3:] = np.nan
    found = parameter_map("merit", ("a", "b"), x.ravel(), y.ravel(), values.ravel(), bins=4)
    np.testing.assert_array_equal(found.count, np.full((2, 4), 4))
    np.testing.assert_array_equal(found.median, [[1, 5, 9, 13], [101, 105, 109, np.inf]])
    np.testing.assert_allclose(found.x_edges, [0.0, 3.75, 7.5, 11.25, 15.0])
    np.testing.assert_allclose(found.y_edges, [-0.5, 0.5, 1.5])


@pytest.mark.parametrize("design", [Design("sobol", 64 * 5, seed=0), Design("morris", 80, seed=0)])
def test_a_run_without_a_merit_is_as_bad_as_the_worst_that_has_one(design: Design) -> None:
    """Merits are the better the smaller; a run that failed is not the best of all."""
    points = design.points(3)
    values = 2.0 + points @ np.array([1.0, -5.0, 2.0])
    failed = points[:, 0] > 0.7
    worst = values[~failed].max()
    result = found(design, np.where(failed, np.nan, values), points)
    same = found(design, np.where(failed, worst, values), points)
    for name, intervals in same.measures.items():
        np.testing.assert_allclose(np.array(result.measures[name]), np.array(intervals))
    assert result.replaced == failed.sum()
