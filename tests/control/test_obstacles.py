"""Obstacles: linear bounds that never cut into them, and detours that lead round."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import RpctlError
from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane, Obstacle

DISC = Disc(0.4, -0.2, 0.3)
WALL = HalfPlane(3.0, 4.0, 0.5)
RADIUS = 0.25
ROUNDING = 1e-12


@pytest.mark.parametrize("obstacle", [DISC, WALL])
def test_what_keeps_the_bound_keeps_the_distance(
    obstacle: Obstacle, rng: np.random.Generator
) -> None:
    points, others = rng.normal(size=(2, 500, 2))
    line = obstacle.linearise(points, RADIUS)
    np.testing.assert_allclose(np.linalg.norm(line.normal, axis=1), 1.0)
    room = (line.normal * others).sum(axis=1) - line.level
    far = obstacle.distance(others) - RADIUS
    assert (far >= room - ROUNDING).all()
    # At the predicted point itself the bound is the distance.
    here = (line.normal * points).sum(axis=1) - line.level
    np.testing.assert_allclose(here, obstacle.distance(points) - RADIUS, atol=ROUNDING)


def test_a_chord_between_two_bounds_does_not_cut_in() -> None:
    stride = 0.2
    line = DISC.linearise(np.array([[0.0, 1.0]]), RADIUS, stride)
    far = float(line.level[0] - line.normal[0] @ (DISC.x, DISC.y))
    middle = np.sqrt(far**2 - (0.5 * stride) ** 2)
    assert middle == pytest.approx(DISC.radius + RADIUS)


def closest(start: Array, goal: Array) -> float:
    """Return how near the way from start to goal comes to the disc."""
    return float(DISC.distance(start + np.linspace(0.0, 1.0, 2001)[:, None] * (goal - start)).min())


def test_a_detour_passes_on_the_side_of_the_goals(rng: np.random.Generator) -> None:
    for _ in range(50):
        angle, side = rng.uniform(-np.pi, np.pi), rng.uniform(-0.4, 0.4)
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        centre = np.array([DISC.x, DISC.y])
        start = centre - 1.2 * along
        goals = centre + side * across + np.linspace(1.0, 2.0, 5)[:, None] * along
        around = DISC.around(start, goals, RADIUS)
        for goal, detour in zip(goals, around, strict=True):
            if closest(start, goal) < RADIUS:
                assert closest(start, detour) == pytest.approx(RADIUS + 0.01, abs=1e-5)
                # Lengths are kept, and the side is that on which the goals pass the centre.
                assert np.hypot(*(detour - start)) == pytest.approx(np.hypot(*(goal - start)))
                assert np.sign((detour - start) @ across) == np.sign(side)


def test_goals_before_the_disc_stay() -> None:
    start, goals = np.array([-2.0, -0.2]), np.array([[-1.0, -0.2], [-1.0, 0.5], [0.4, 3.0]])
    np.testing.assert_array_equal(DISC.around(start, goals, RADIUS), goals)
    np.testing.assert_array_equal(WALL.around(start, goals, RADIUS), goals)


def test_what_is_no_obstacle_is_refused() -> None:
    with pytest.raises(RpctlError, match="radius of a disc is -1; give a positive number"):
        Disc(0.0, 0.0, -1.0)
    with pytest.raises(RpctlError, match="centre of a disc"):
        Disc(np.nan, 0.0, 1.0)
    with pytest.raises(RpctlError, match="length of a half-plane's normal is 0"):
        HalfPlane(0.0, 0.0, 1.0)
