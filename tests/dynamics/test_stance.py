"""The support polygon and the split of a load: geometry and statics, by their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.dynamics.stance import loads, make_stance, width

SQUARE = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [0.2, 0.1], [-1.0, 1.0], [0.0, 1.0]])


def margin(points: Array, at: Array) -> float:
    stance = make_stance(points)
    return float((stance.inward @ at + stance.offset).min())


def test_the_margin_is_the_distance_to_the_nearest_edge(rng: np.random.Generator) -> None:
    for order in (rng.permutation(6) for _ in range(20)):
        assert margin(SQUARE[order], np.array([0.0, 0.0])) == pytest.approx(1.0)
        assert margin(SQUARE[order], np.array([0.7, -0.2])) == pytest.approx(0.3)
        assert margin(SQUARE[order], np.array([0.3, -1.0])) == pytest.approx(0.0)
        assert margin(SQUARE[order], np.array([0.3, -1.4])) == pytest.approx(-0.4)
    assert len(make_stance(SQUARE).offset) == 4


def test_three_contacts_share_by_their_levers() -> None:
    points = np.array([[0.0, 0.5], [0.0, -0.5], [0.8, 0.1]])
    at, total = np.array([0.2, -0.1]), 100.0
    moments = total * np.array([1.0, *at])
    front = total * 0.2 / 0.8
    left = 0.5 * (total - front) + (total * -0.1 - front * 0.1)
    load = loads(make_stance(points), moments, 1.0)
    np.testing.assert_allclose(load, [left, total - front - left, front], rtol=1e-13)


def test_many_contacts_only_push_and_balance(rng: np.random.Generator) -> None:
    """The split is that of equal springs: max(0, a + b x + c y), the least nonnegative one."""
    for _ in range(300):
        points = rng.normal(size=(rng.integers(4, 9), 2))
        stance = make_stance(points)
        at = rng.dirichlet(np.full(len(points), 0.3)) @ points
        moments = 50.0 * np.array([1.0, *at])
        load = loads(stance, moments, float((stance.inward @ at + stance.offset).min()))
        assert load.min() >= -1e-9
        np.testing.assert_allclose(stance.statics @ load, moments, atol=1e-9)
        pressed = load > 0.0
        plane = np.linalg.lstsq(stance.statics[:, pressed].T, load[pressed], rcond=None)[0]
        np.testing.assert_allclose(stance.statics[:, pressed].T @ plane, load[pressed], atol=1e-9)
        assert (stance.statics[:, ~pressed].T @ plane).max(initial=0.0) < 1e-8


def test_outside_the_polygon_some_contact_pulls() -> None:
    stance = make_stance(SQUARE)
    load = loads(stance, np.array([1.0, 1.5, 0.0]), -0.5)
    assert load.min() < 0.0
    np.testing.assert_allclose(stance.statics @ load, [1.0, 1.5, 0.0], atol=1e-12)


def test_where_no_split_only_pushes_that_of_the_plane_stays() -> None:
    """Rounding may call a margin positive that is not."""
    stance, moments = make_stance(SQUARE), np.array([1.0, 1.5, 0.0])
    np.testing.assert_array_equal(loads(stance, moments, 1e-17), stance.split @ moments)


def test_contacts_on_a_line_have_no_width() -> None:
    assert width(SQUARE[:2]) == 0.0
    assert width(np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]])) == pytest.approx(0.0, abs=1e-15)
    assert width(SQUARE) > 1.0
