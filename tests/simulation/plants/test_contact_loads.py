"""How contacts share a load, with its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl.dynamics.stance import make_split, make_stance, share_load
from rpctl.simulation.plants.free_tree import NO_CONTACTS

RIM = 1e-6  # m from the polygon's edge: nearer, rounding decides whether it tips


def test_loads_push_and_have_derivatives(rng: np.random.Generator) -> None:
    lifted = tipped = 0
    for _ in range(250):
        points = rng.uniform(-1.0, 1.0, (int(rng.integers(4, 9)), 2))
        zmp = rng.uniform(-0.9, 0.9, 2)
        moments = 100.0 * np.array([1.0, *zmp])
        stance, split = make_stance(points), make_split(points)
        margin = float((stance.inward @ zmp + stance.offset).min())
        found = share_load(split, moments)
        assert found.tips == (margin < 0.0) or abs(margin) < RIM
        assert found.load.min() >= 0.0
        assert found.load.sum() == pytest.approx(100.0)
        if margin > RIM:
            lifted += found.load.min() == 0.0
        tipped += found.tips
        change = 1e-6 * rng.normal(size=3)
        ahead, behind = (share_load(split, moments + s * change).load for s in (1.0, -1.0))
        np.testing.assert_allclose(0.5 * (ahead - behind), found.slope @ change, atol=1e-9)
    assert lifted > 10
    assert tipped > 50


def test_contacts_on_a_line_take_the_moment_along_it() -> None:
    split = make_split(np.array([[0.0, 0.3], [0.0, -0.1]]))
    found = share_load(split, np.array([100.0, 7.0, 10.0]))
    np.testing.assert_allclose(found.load, [50.0, 50.0])  # 10 N·m = .3 · 50 − .1 · 50
    np.testing.assert_allclose(found.slope[:, 1], 0.0)
    assert share_load(split, np.array([100.0, 0.0, 40.0])).tips


def test_what_pulls_off_the_ground_bears_nothing() -> None:
    points = np.array([[1.0, 0.0], [-1.0, 1.0], [-1.0, -1.0]])
    found = share_load(make_split(points), np.array([-5.0, 0.0, 0.0]))
    assert found.tips
    np.testing.assert_array_equal(found.load, 0.0)
    assert share_load(NO_CONTACTS, np.array([100.0, 0.0, 0.0])).load.size == 0
