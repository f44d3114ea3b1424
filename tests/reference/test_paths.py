"""Paths: exact derivatives, and a clock that starts softly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.reference.formula import Along
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
    assert line(-1.0)(2.0).twist[0, 0] == -1.0
    np.testing.assert_array_equal(spin()(2.0).pose, [0.0, 0.0, 2.0])


def test_an_eight_by_hand() -> None:
    length, width = 1.5, 0.7
    s = np.linspace(-1.0, 7.0, 57)
    x1, y1 = length * np.cos(s), 2.0 * width * np.cos(2.0 * s)
    x2, y2 = -length * np.sin(s), -4.0 * width * np.sin(2.0 * s)
    x3, y3 = -x1, -4.0 * y1
    speed, cross, dot = np.hypot(x1, y1), x1 * y2 - y1 * x2, x1 * x2 + y1 * y2
    found = eight(length, width)(s)
    np.testing.assert_allclose(found.pose, np.transpose([-x2, -y2 / 4.0, np.arctan2(y1, x1)]))
    np.testing.assert_allclose(found.twist[:, 0, ::2], np.transpose([speed, cross / speed**2]))
    bend = (x1 * y3 - y1 * x3) / speed**2 - 2.0 * cross * dot / speed**4
    np.testing.assert_allclose(
        found.twist[:, 1, ::2], np.transpose([dot / speed, bend]), atol=1e-12
    )
    assert not found.twist[:, :, 1].any()


def test_the_clock_starts_softly() -> None:
    """Its rate is the quintic u³ (10 − 15 u + 6 u²) of u = t / ramp, then 1."""
    ramp, at = 3.0, Along()
    clock = at.columns(at.orders([ramped_time(at.x, ramp)], 4))
    u = np.linspace(0.0, 1.0, 60)
    s, rate, acceleration, jerk = clock(ramp * u).T
    np.testing.assert_allclose(s, ramp * u**4 * (2.5 - 3.0 * u + u**2), atol=1e-15)
    np.testing.assert_allclose(rate, u**3 * (10.0 - 15.0 * u + 6.0 * u**2), atol=1e-14)
    np.testing.assert_allclose(ramp * acceleration, 30.0 * (u * (1.0 - u)) ** 2, atol=1e-13)
    # Jerk, too, is zero at both ends, so that no effort has a kink.
    np.testing.assert_allclose(jerk[[0, -1]], 0.0, atol=1e-12)
    np.testing.assert_array_equal(clock(10.0), [8.5, 1.0, 0.0, 0.0])
    assert ramped_time(10.0, 0.0) == 10.0
