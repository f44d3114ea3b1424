"""Paths: exact derivatives, and a clock that starts softly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.reference.paths import Path, circle, eight, line, ramped_time, spin

PATHS = {
    "line": line(1.0),
    "reverse": line(-1.0),
    "spin": spin(),
    "circle": circle(0.8),
    "eight": eight(1.5, 0.75),
}
STEP = 1e-6


@pytest.mark.parametrize("name", PATHS)
def test_derivatives_are_those_of_the_pose(name: str) -> None:
    path: Path = PATHS[name]
    for s in np.linspace(-3.0, 9.0, 41):
        point, ahead, behind = path(s), path(s + STEP), path(s - STEP)
        rate = (ahead.pose - behind.pose) / (2 * STEP)
        heading = np.array([math.cos(point.pose[2]), math.sin(point.pose[2])])
        speed, left, turn = point.direction[0]
        assert left == 0.0
        np.testing.assert_allclose(rate[:2], speed * heading, atol=1e-8)
        turned = math.remainder(ahead.pose[2] - behind.pose[2], 2 * math.pi) / (2 * STEP)
        assert turned == pytest.approx(turn, abs=1e-8)
        changes = (ahead.direction[:2] - behind.direction[:2]) / (2 * STEP)
        np.testing.assert_allclose(changes, point.direction[1:], atol=2e-6)


def test_shapes() -> None:
    np.testing.assert_allclose(circle(0.8)(math.pi).pose, [0.0, 1.6, math.pi], atol=1e-15)
    np.testing.assert_allclose(eight(1.5, 0.75)(math.pi / 2).pose[:2], [1.5, 0.0], atol=1e-15)
    assert line(-1.0)(2.0).direction[0, 0] == -1.0
    np.testing.assert_array_equal(spin()(2.0).pose, [0.0, 0.0, 2.0])


def test_the_clock_starts_softly_and_its_derivatives_are_exact() -> None:
    rate, ramp = 0.4, 3.0
    start = ramped_time(0.0, rate, ramp)
    assert start == (0.0, 0.0, 0.0)
    for t in np.linspace(0.01, 6.0, 60):
        now, ahead, behind = (ramped_time(x, rate, ramp) for x in (t, t + STEP, t - STEP))
        assert (ahead.s - behind.s) / (2 * STEP) == pytest.approx(now.rate, abs=1e-8)
        assert (ahead.rate - behind.rate) / (2 * STEP) == pytest.approx(now.acceleration, abs=1e-6)
    # Jerk, too, is zero at both ends, so that no effort has a kink.
    for t in (0.0, ramp):
        assert ramped_time(abs(t - 1e-4), rate, ramp).acceleration == pytest.approx(0.0, abs=1e-6)
    assert ramped_time(10.0, rate, 0.0) == (4.0, 0.4, 0.0)
