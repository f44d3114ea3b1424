"""Time laws: the fastest that limits allow, then smooth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.reference.time_law import SMOOTHING, Bound, fastest, time_law

S = np.linspace(0.0, 3.0, 601)
FLAT = np.zeros(len(S))


def test_on_a_line_the_fastest_is_a_trapezoid() -> None:
    speed, acceleration = 0.7, 0.4
    x = fastest(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    ramps = np.minimum(2 * acceleration * S, 2 * acceleration * (S[-1] - S))
    np.testing.assert_allclose(x, np.minimum(ramps, speed**2), atol=1e-9)


def test_a_bend_costs_acceleration() -> None:
    """A coordinate sin s with |d²/dt²| ≤ a: where it turns back, ṡ² ≤ a."""
    speed = math.inf
    slope, bend = np.cos(S), -np.sin(S)
    x = fastest(S, [Bound(slope, bend, speed, 0.3), Bound(FLAT + 1.0, FLAT, 5.0)])
    turning = int(np.abs(S - 0.5 * math.pi).argmin())
    assert x[turning] == pytest.approx(0.3, rel=0.02)
    pace = 0.5 * np.diff(x) / (S[1] - S[0])
    for end in (slice(None, -1), slice(1, None)):
        assert np.abs(bend[end] * x[end] + slope[end] * pace).max() <= 0.3 * (1.0 + 1e-6)


def test_the_clock_is_smooth_within_limits_and_hardly_slower() -> None:
    speed, acceleration = 0.7, 0.4
    clock = time_law(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    best = S[-1] / speed + speed / acceleration
    assert best < clock.duration < best + 6.0 * SMOOTHING
    t = np.linspace(0.0, clock.duration, 5000)
    s, rate, change = clock.at(t)
    assert (s[0], s[-1]) == pytest.approx((0.0, S[-1]), abs=1e-12)
    assert np.diff(s).min() >= 0.0
    assert rate.max() <= speed
    assert np.abs(change).max() <= acceleration
    assert np.abs(np.diff(change)).max() < 0.01 * acceleration  # no jump
    np.testing.assert_allclose(np.gradient(s, t)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(rate, t)[1:-1], change[1:-1], atol=1e-4)
    for end in (-1.0, 0.0, clock.duration, clock.duration + 1.0):
        assert clock(end)[1:] == pytest.approx((0.0, 0.0), abs=1e-12)
