"""Time laws: the fastest that limits allow, then smooth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import BSpline

from rpctl.reference.time_law import (
    KNOT_SPACING,
    Bound,
    TimeLaw,
    _slowdown,
    max_squared_rate,
    time_law,
)

S = np.linspace(0.0, 3.0, 601)
FLAT = np.zeros(len(S))


def test_on_a_line_the_fastest_is_a_trapezoid() -> None:
    speed, acceleration = 0.7, 0.4
    x = max_squared_rate(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    ramps = np.minimum(2 * acceleration * S, 2 * acceleration * (S[-1] - S))
    np.testing.assert_allclose(x, np.minimum(ramps, speed**2), atol=1e-9)


def test_a_bend_costs_acceleration() -> None:
    """A coordinate sin s with |d²/dt²| ≤ a: where it turns back, ṡ² ≤ a."""
    speed = math.inf
    slope, bend = np.cos(S), -np.sin(S)
    x = max_squared_rate(S, [Bound(slope, bend, speed, 0.3), Bound(FLAT + 1.0, FLAT, 5.0)])
    turning = int(np.abs(S - 0.5 * math.pi).argmin())
    assert x[turning] == pytest.approx(0.3, rel=0.02)
    pace = 0.5 * np.diff(x) / (S[1] - S[0])
    for end in (slice(None, -1), slice(1, None)):
        assert np.abs(bend[end] * x[end] + slope[end] * pace).max() <= 0.3 * (1.0 + 1e-6)


def test_the_clock_is_smooth_within_limits_and_hardly_slower() -> None:
    speed, acceleration = 0.7, 0.4
    timing = time_law(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    best = S[-1] / speed + speed / acceleration
    assert best < timing.duration < best + 6.0 * KNOT_SPACING
    t = np.linspace(0.0, timing.duration, 5000)
    s, rate, change = timing(t)
    assert (s[0], s[-1]) == pytest.approx((0.0, S[-1]), abs=1e-12)
    assert np.diff(s).min() >= 0.0
    assert rate.max() <= speed
    assert np.abs(change).max() <= acceleration
    assert np.abs(np.diff(change)).max() < 0.01 * acceleration  # no jump
    np.testing.assert_allclose(np.gradient(s, t)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(rate, t)[1:-1], change[1:-1], atol=1e-4)
    for end in (-1.0, 0.0, timing.duration, timing.duration + 1.0):
        assert timing(end)[1:] == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_clock_is_slowed_by_the_root_of_its_acceleration() -> None:
    """Run k times slower, ṡ falls by k and s̈ by k²: with ṡ = 2 throughout, on c' = 1, c'' = −3,
    speeds are 2 and accelerations 12."""
    duration = S[-1] / 2.0
    straight = BSpline(np.repeat([0.0, duration], 3), np.array([0.0, 0.5, 1.0]) * S[-1], 2)
    timing, bend = TimeLaw(straight, duration), FLAT - 3.0
    for speed, acceleration, expected in ((0.5, math.inf, 4.0), (math.inf, 0.75, 4.0),
                                          (4.0, 48.0, 0.5), (1.0, 3.0, 2.0)):  # fmt: skip
        bounds = [Bound(FLAT + 1.0, bend, speed, acceleration), Bound(FLAT + 1.0, FLAT, 1e3)]
        for order in (bounds, bounds[::-1]):
            assert _slowdown(timing, S, order) == pytest.approx(expected)


def test_smoothing_breaks_no_acceleration_on_a_bend() -> None:
    """A sharp bend, whose fastest motion changes within less than the clock's smoothing."""
    slope, bend = np.ones(len(S)), 8.0 * np.exp(-(((S - 1.5) / 0.05) ** 2))
    bounds = [Bound(slope, FLAT, 1.0, 2.0), Bound(slope, bend, 1.0, 1.0)]
    timing = time_law(S, bounds)
    at, rate, change = timing(np.linspace(0.0, timing.duration, 20000))
    for bound in bounds:
        c1, c2 = np.interp(at, S, bound.slope), np.interp(at, S, bound.bend)
        assert np.abs(c1 * rate).max() <= bound.speed
        assert np.abs(c2 * rate**2 + c1 * change).max() <= bound.acceleration
