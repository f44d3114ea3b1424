"""Designs: what their points must be, and that they follow from the seed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from rpctl import RpctlError
from rpctl.study.experiment import DESIGNS, Design

SIZES = {"monte-carlo": 60, "grid": 27, "latin-hypercube": 60, "sobol": 40, "morris": 60}


@pytest.mark.parametrize("kind", DESIGNS)
def test_points_fill_the_cube_and_follow_from_the_seed(kind: str) -> None:
    design = Design(kind, 60, seed=3)
    points = design.points(3)
    assert points.shape == (SIZES[kind], 3)
    assert design.size(3) == SIZES[kind]
    assert ((points >= 0.0) & (points <= 1.0)).all()
    assert (np.ptp(points, axis=0) > 0.6).all()
    np.testing.assert_array_equal(points, Design(kind, 60, seed=3).points(3))
    if kind != "grid":
        assert not np.array_equal(points, Design(kind, 60, seed=4).points(3))


def test_more_runs_extend_monte_carlo() -> None:
    many = Design(count=1000, seed=7).points(5)
    np.testing.assert_array_equal(Design(count=10, seed=7).points(5), many[:10])
    drawn_by_runs = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0,))).random(5)
    assert not np.isclose(many[0], drawn_by_runs).any()  # a run's noise has numbers of its own
    assert abs(many.mean() - 0.5) < 4.0 / np.sqrt(12.0 * many.size)


def test_a_grid_has_all_combinations_of_its_levels() -> None:
    points = Design("grid", 30).points(3)  # 3 levels: 27 are the most within 30
    expected = set(itertools.product((0.0, 0.5, 1.0), repeat=3))
    assert {tuple(point) for point in points.tolist()} == expected
    assert points[1].tolist() == [0.0, 0.0, 0.5]


def test_a_latin_hypercube_has_one_point_in_each_stratum() -> None:
    points = Design("latin-hypercube", 50, seed=1).points(4)
    for column in points.T:
        assert sorted(np.floor(50.0 * column)) == list(range(50))


def test_saltelli_rows_exchange_one_entry() -> None:
    n = 3
    blocks = Design("sobol", 8 * (n + 2) + 4, seed=2).points(n).reshape(8, n + 2, n)
    for first, *exchanged, second in blocks:
        for j, row in enumerate(exchanged):
            expected = first.copy()
            expected[j] = second[j]
            np.testing.assert_array_equal(row, expected)


def test_morris_steps_change_one_entry() -> None:
    n = 4
    trajectories = Design("morris", 53, seed=0).points(n).reshape(10, n + 1, n)
    for trajectory in trajectories:
        changed = np.diff(trajectory, axis=0) != 0.0
        assert (changed.sum(axis=1) == 1).all()
        assert changed.any(axis=0).all()


@pytest.mark.parametrize(
    ("kind", "count", "needed"), [("grid", 7, 8), ("sobol", 9, 10), ("morris", 7, 8)]
)
def test_too_few_runs_are_refused(kind: str, count: int, needed: int) -> None:
    with pytest.raises(RpctlError, match=f"of 3 parameters needs {needed} runs"):
        Design(kind, count).points(3)
    assert len(Design(kind, needed).points(3)) == needed


def test_what_is_no_design_is_refused() -> None:
    with pytest.raises(RpctlError, match="design 'sobolev' is not known; did you mean sobol"):
        Design("sobolev")
    with pytest.raises(RpctlError, match="count is 0"):
        Design(count=0)
    with pytest.raises(RpctlError, match="seed is -1"):
        Design(seed=-1)
    with pytest.raises(RpctlError, match=r"needs parameters; write some under \[scatter\]"):
        Design("grid", 10).points(0)
    assert Design("monte-carlo", 10).points(0).shape == (10, 0)
