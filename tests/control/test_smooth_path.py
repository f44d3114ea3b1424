"""Smooth paths: they end where they should, keep their bend, and are what their rates say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.control.smooth_path import SmoothPath, shortest_paths, smooth_path

RADIUS, TRANSITION, STEP = 1.5, 0.6, 1e-5


def paths(rng: np.random.Generator, count: int) -> list[SmoothPath]:
    found = []
    for _ in range(count):
        start, goal = rng.uniform(-3.0, 3.0, (2, 3))
        ends = rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)
        path = smooth_path(start, goal, ends, RADIUS, TRANSITION)
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
