"""Dubins' paths and smooth ones: they end where they should, keep their bend, none is longer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.control.smooth_path import Bends, SmoothPath, shortest_paths, smooth_path


def driven(start: Array, path: Bends) -> Array:
    """Return where a path ends, by exact arcs."""
    x, y, heading = start
    for curvature, length in zip(*path, strict=True):
        half = 0.5 * curvature * length
        chord = length * np.sinc(half / math.pi)
        x, y = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
        heading += 2.0 * half
    return np.array([x, y, heading])


def test_every_path_ends_at_the_goal(rng: np.random.Generator) -> None:
    kinds = set()
    for _ in range(40):
        start, goal = rng.uniform(-3.0, 3.0, (2, 3))
        radius = rng.uniform(0.3, 2.0)
        paths = shortest_paths(start, goal, radius)
        lengths = [sum(path.lengths) for path in paths]
        assert lengths == sorted(lengths)
        for path in paths:
            off = driven(start, path) - goal
            off[2] = math.remainder(off[2], 2.0 * math.pi)
            np.testing.assert_allclose(off, 0.0, atol=1e-9)
            assert min(path.lengths) >= 0.0
            assert max(map(abs, path.curvatures)) == pytest.approx(1.0 / radius)
            kinds.add(tuple(np.sign(path.curvatures)))
    assert len(kinds) == 6


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((5.0, 0.0, 0.0), 5.0),
        ((0.0, 4.0, math.pi), 2.0 * math.pi),  # half a circle of radius 2
        ((2.0, 2.0, 0.5 * math.pi), math.pi),  # a quarter
        ((0.0, -4.0, math.pi), 2.0 * math.pi),
        ((-3.0, 4.0, math.pi), 3.0 + 2.0 * math.pi),
        ((0.0, 0.0, math.pi), 14.0 * math.pi / 3.0),  # turning round: three arcs, 60 + 300 + 60°
    ],
)
def test_lengths_by_paper_and_pencil(goal: tuple[float, float, float], length: float) -> None:
    shortest = shortest_paths(np.zeros(3), np.array(goal), 2.0)[0]
    assert sum(shortest.lengths) == pytest.approx(length)


RADIUS, TRANSITION, STEP = 1.5, 0.6, 1e-5


def paths(rng: np.random.Generator, count: int) -> list[SmoothPath]:
    found = []
    for _ in range(count):
        start, goal = rng.uniform(-3.0, 3.0, (2, 3))
        ends = rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)
        path = smooth_path(start, goal, ends, RADIUS, TRANSITION, 40.0)
        assert path is not None
        assert path.length < 1.5 * sum(shortest_paths(start, goal, RADIUS)[0].lengths) + 1.0
        np.testing.assert_allclose(path(0.0).pose, start, atol=1e-12)
        last, kappa = path(path.length)
        off = last - goal
        off[2] = math.remainder(off[2], 2.0 * math.pi)
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
        assert [path(0.0).curvature[0], kappa[0]] == pytest.approx(ends)
        found.append(path)
    return found


def test_a_path_leads_from_pose_to_pose_within_its_bend(rng: np.random.Generator) -> None:
    for path in paths(rng, 6):
        points = [path(s) for s in np.linspace(0.0, path.length, 60)]
        assert max(abs(point.curvature[0]) for point in points) < 1.05 / RADIUS


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_path_that_its_steps_lead_past_its_line_comes_back_without_a_turn(side: float) -> None:
    """Sharp arcs meet the line ahead by turns to one side, with .07 m to spare.

    From .295 m beside it and .5 rad towards it these need 1.8 (1 - cos .5) = .22 m. The first step
    takes .36 m of the way straight on, .17 m across: the smooth path is past the line, comes back
    and turns to the other side at last, where the sharp one would wind round by 350 degrees.
    """
    start, goal = np.array([0.0, -0.295 * side, 0.5 * side]), np.array([2.5, 0.0, 0.0])
    path = smooth_path(start, goal, (0.0, 0.0), 1.8, 0.72, 20.0)
    assert path is not None
    assert path.length < 2.7
    assert np.sign(path.steps).tolist() == [-side, side, side, -side]


def test_no_path_is_longer_than_it_may_be() -> None:
    """The one above has 2.58 m, its sharp path 2.54 m, and 13 m what winds round."""
    start, goal = np.array([0.0, -0.295, 0.5]), np.array([2.5, 0.0, 0.0])
    for longest, found in ((2.5, False), (2.57, False), (2.6, True)):
        path = smooth_path(start, goal, (0.0, 0.0), 1.8, 0.72, longest)
        assert (path is not None) is found


def test_its_points_move_as_its_derivatives_say(rng: np.random.Generator) -> None:
    (path,) = paths(rng, 1)
    for s in rng.uniform(0.05, 0.95, 9) * path.length:
        behind, at, ahead = (path(s + step) for step in (-STEP, 0.0, STEP))
        slope = (ahead.pose - behind.pose) / (2.0 * STEP)
        heading = at.pose[2]
        expected = [math.cos(heading), math.sin(heading), at.curvature[0]]
        np.testing.assert_allclose(slope, expected, atol=1e-8)
        bend = (ahead.curvature - behind.curvature) / (2.0 * STEP)
        np.testing.assert_allclose(bend[:2], at.curvature[1:], atol=1e-6)


def test_a_length_below_zero_that_a_search_tries_ends_behind_the_start() -> None:
    none = np.zeros(0)
    ends = SmoothPath(np.array([1.0, 2.0, 0.0]), 0.0, none, none, 1.0, -20.0).end
    np.testing.assert_allclose(ends, [-19.0, 2.0, 0.0], atol=1e-12)
