"""Least squares in a box: its optimality, the bound of its pull, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.end_effector import MIN_KAPPA, Nearest, Task, nearest, nearest_rate
from rpctl.kernels.sheet import Evaluator

STEP = 1e-6


def solve(G: Array, y: Array, posture: Array, size: float, strongest: float) -> Array:
    bounds = np.full(7, -size), np.full(7, size)
    return nearest(Task(G, y, posture, *bounds), strongest).z


@pytest.mark.parametrize("size", [np.inf, 0.5, 0.2])
def test_a_pull_without_bound_gives_bounded_least_squares(
    rng: np.random.Generator, size: float
) -> None:
    bound = 0
    for _ in range(20):
        G, y, posture = rng.normal(size=(3, 7)), rng.normal(size=3), 0.05 * rng.normal(size=7)
        z = solve(G, y, posture, size, 1e9)
        stacked = np.vstack([np.eye(7), G / np.sqrt(MIN_KAPPA)])
        right = np.concatenate([posture, y / np.sqrt(MIN_KAPPA)])
        expected = lsq_linear(stacked, right, (-size, size), method="bvls", tol=1e-15).x
        np.testing.assert_allclose(z, expected, atol=1e-6)
        bound += int(np.count_nonzero(np.abs(z) == size))
    assert (bound > 0) == (size < np.inf)


@pytest.mark.parametrize("size", [np.inf, 0.5, 0.2])
def test_the_penalty_is_exact_up_to_the_strongest_pull(
    rng: np.random.Generator, size: float
) -> None:
    """Optimal is z = clip(posture + Gᵀ pull): G z = y, or the longest pull, towards y."""
    met = 0
    for _ in range(40):
        G, y, posture = rng.normal(size=(3, 7)), rng.normal(size=3), 0.05 * rng.normal(size=7)
        z = solve(G, y, posture, size, 0.5)
        left = y - G @ z
        if np.abs(left).max() < 1e-5:
            met += 1
            continue
        pull = 0.5 * left / np.linalg.norm(left)
        np.testing.assert_allclose(z, np.clip(posture + G.T @ pull, -size, size), atol=1e-9)
    assert 0 < met < 40


def spread(rng: np.random.Generator, singular: Array) -> Array:
    """Return a random matrix (3, 7) of given singular values."""
    U, V = (np.linalg.qr(rng.normal(size=(n, n)))[0] for n in (3, 7))
    return np.asarray((U * singular) @ V[:3])


def test_a_lost_direction_does_not_swing(rng: np.random.Generator) -> None:
    """Along it z leaves the posture by at most the strongest pull times its singular value.

    With G z = y it would leave it by |y|/σ.
    """
    for sigma in np.logspace(-8, 0, 30):
        G, y = spread(rng, np.array([1.0, 0.5, sigma])), rng.normal(size=3)
        z = solve(G, y, np.zeros(7), np.inf, 20.0)
        assert np.linalg.norm(np.linalg.svd(G)[2][2] @ z) < 20.0 * sigma * (1 + 1e-9)


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.3])
@pytest.mark.parametrize("size", [np.inf, 0.9, 0.3])
@pytest.mark.parametrize("strongest", [1.0, 1e3])
def test_the_derivative(
    rng: np.random.Generator, sigma: float, size: float, strongest: float
) -> None:
    """Against differences, bounds and pull active or not; bounds move too."""
    data: dict[str, tuple[Array, Array]] = {
        "G": (spread(rng, np.array([1.0, 0.5, sigma])), rng.normal(size=(3, 7))),
        "y": (rng.normal(size=3), rng.normal(size=3)),
        "posture": (0.1 * rng.normal(size=7), 0.1 * rng.normal(size=7)),
        "lower": (np.full(7, -size), 0.1 * rng.normal(size=7)),
        "upper": (np.full(7, size), 0.1 * rng.normal(size=7)),
    }

    def at(time: float) -> Nearest:
        return nearest(Task(*(value + time * rate for value, rate in data.values())), strongest)

    t = math.SX.sym("t")
    task = Task(*(math.DM(value) + t * math.DM(rate) for value, rate in data.values()))
    symbols, formula = nearest_rate(task, t, math.SX(1))
    slope, now = (at(STEP).z - at(-STEP).z) / (2 * STEP), at(0.0)
    held = now.at_lower, now.at_upper, now.kappa, now.bounded
    (rate,) = Evaluator(math.Function("rate", [t, *symbols], [math.densify(formula)]))(0.0, *held)
    np.testing.assert_allclose(rate, slope, atol=1e-5 * (1 + np.abs(rate).max()))
