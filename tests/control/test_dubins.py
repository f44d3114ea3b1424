"""Dubins' paths: they end where they should, and none that is allowed is shorter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.control.smooth_path import Bends, shortest_paths


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
