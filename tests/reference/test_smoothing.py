"""Smoothing splines: the least of their cost, within their tolerance, and as noisy as the rows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.reference.recorded import smoothing
from rpctl.reference.recorded.smoothing import Smoothed, SmoothingProblem, smooth, spread


def eight(t: Array) -> Array:
    """Return a figure-eight (K, 2), m, that is at rest at both ends."""
    u = t / t[-1]
    angle = 2.0 * math.pi * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    return np.column_stack([0.8 * np.sin(angle), 0.4 * np.sin(2.0 * angle)])


def noisy(step: float, sigma: float, seed: int = 0) -> tuple[Array, Array]:
    t = np.arange(0.0, 20.0 + 1e-9, step)
    return t, eight(t) + sigma * np.random.default_rng(seed).normal(size=(len(t), 2))


def found(t: Array, rows: Array, tolerance: float | None) -> Smoothed:
    smoothed = smooth(t, rows, tolerance)
    assert smoothed is not None
    return smoothed


def differences(smoothed: Smoothed, t: Array, rows: Array) -> float:
    off = rows - smoothed.problem.spline(smoothed.coefficients)(t)
    return math.sqrt(float((off**2).mean()))


@pytest.mark.parametrize("sigma", [1e-5, 1e-2])
@pytest.mark.parametrize("step", [0.1, 0.025])  # the second has fewer knots than rows
def test_cross_validation_finds_the_noise(step: float, sigma: float) -> None:
    t, rows = noisy(step, sigma)
    smoothed = found(t, rows, None)
    assert smoothed.noise == pytest.approx(sigma, rel=0.12)
    spline = smoothed.problem.spline(smoothed.coefficients)
    error = math.sqrt(float(((spline(t) - eight(t)) ** 2).mean()))
    assert error < 0.7 * sigma
    assert differences(smoothed, t, rows) == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize("step", [0.1, 0.02, 0.005])
def test_rows_without_noise_stay_as_they_are(step: float) -> None:
    t, rows = noisy(step, 0.0)
    smoothed = smooth(t, rows, None)
    if smoothed is not None:
        assert differences(smoothed, t, rows) < 1e-9


@pytest.mark.parametrize("tolerance", [2e-3, 0.01, 0.05])
@pytest.mark.parametrize("step", [0.1, 0.02])
def test_a_tolerance_is_used_and_kept(step: float, tolerance: float) -> None:
    t, rows = noisy(step, 0.01)
    off = differences(found(t, rows, tolerance), t, rows)
    assert 0.98 * tolerance < off <= tolerance


def test_a_tolerance_that_nothing_smooth_keeps_leaves_rows_as_they_are() -> None:
    assert smooth(*noisy(0.1, 0.01), 1e-6) is None


def cost(problem: SmoothingProblem, tau: float, coefficients: Array) -> float:
    """Return Σ |y - f|² + λ ∫ |f'''|² dt by the trapezium rule."""
    spline = problem.spline(coefficients)
    t = np.linspace(problem.t[0], problem.t[-1], 20001)
    bend = np.trapezoid((spline(t, 3) ** 2).sum(axis=1), t)
    weight = (tau * problem.unit) ** 6 / problem.unit
    return float(((problem.values - spline(problem.t)) ** 2).sum() + weight * bend)


def test_no_other_spline_costs_less() -> None:
    rng = np.random.default_rng(2)
    t = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 3.0, 28)), [3.0]])
    problem = SmoothingProblem(t, rng.normal(size=(30, 2)))
    for tau in (0.5, 2.0, 8.0):
        best = problem.coefficients(tau)
        least = cost(problem, tau, best)
        slope, step = [], 1e-4
        for _ in range(6):
            way = rng.normal(size=best.shape)
            up, down = (cost(problem, tau, best + sign * step * way) for sign in (1.0, -1.0))
            assert min(up, down) > least
            slope.append((up - down) / (up + down - 2.0 * least))
        assert np.abs(slope).max() < 1e-2  # of the step: the least is there, not nearby


@pytest.mark.parametrize("rests", [(True, False), (False, True), (True, True)])
def test_a_rest_is_one(rests: tuple[bool, bool]) -> None:
    t, rows = noisy(0.1, 0.01)
    problem = SmoothingProblem(t, rows + t[:, None])
    spline = problem.spline(problem.coefficients(3.0, rests))
    for at, rest in zip((0.0, 20.0), rests, strict=True):
        assert bool(np.abs(spline(at, 1)).max() < 1e-9) == rest
        assert bool(np.abs(spline(at, 2)).max() < 1e-9) == rest
    # In the middle the ends are not felt.
    free = problem.spline(problem.coefficients(3.0))
    np.testing.assert_allclose(spline(10.0), free(10.0), atol=1e-4)


def test_who_starts_at_rest_is_seen() -> None:
    t, rows = noisy(0.1, 0.01)
    assert found(t, rows, None).rests == (True, True)
    assert found(t, rows + 0.1 * t[:, None], None).rests == (False, False)
    early = t < 10.0
    assert found(t[early], rows[early], None).rests == (True, False)


def test_degrees_of_freedom_are_the_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    t, rows = noisy(0.1, 0.01)
    for tau in (0.3, 3.0):
        problem = SmoothingProblem(t, rows)
        each = SmoothingProblem(t, np.eye(len(t)))
        exact = float(np.trace(each.at_rows @ each.coefficients(tau)))
        assert problem.freedom(tau) == pytest.approx(exact, rel=1e-9)
        with monkeypatch.context() as patch:
            patch.setattr(smoothing, "EXACT_TRACE", 0)
            sampled = SmoothingProblem(t, rows).freedom(tau)
        assert sampled == pytest.approx(exact, rel=0.08)
        assert sampled != exact


def test_the_error_of_a_rate_is_that_of_many_trials() -> None:
    t = np.arange(0.0, 10.0 + 1e-9, 0.1)
    rows = np.random.default_rng(1).normal(size=(len(t), 400))  # a trial a column
    rates, errors = SmoothingProblem(t, rows).rates(3.0)
    np.testing.assert_allclose(rates.std(axis=1), errors, rtol=0.15)
    line = SmoothingProblem(t, np.column_stack([0.5 * t, -t])).rates(3.0)[0]
    np.testing.assert_allclose(line, np.tile([0.5, -1.0], (3, 1)), atol=1e-6)


def test_spread_keeps_both_ends_and_the_least_distance() -> None:
    u = np.array([0.0, 0.1, 0.5, 0.9, 1.2, 2.0, 2.4, 2.5])
    np.testing.assert_array_equal(spread(u, 0.5), [0, 2, 4, 5, 7])
    np.testing.assert_array_equal(spread(u, 0.0), np.arange(8))
    np.testing.assert_array_equal(spread(u, 10.0), [0, 7])
