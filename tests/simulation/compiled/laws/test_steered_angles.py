"""Angles of steered wheels in symbols against Python's, with a trail, in bends of any radius."""

from __future__ import annotations

from dataclasses import replace

import casadi
import numpy as np
import pytest

from rpctl import Robot
from rpctl.drive.steering import steer
from rpctl.simulation.compiled.laws.steering import steered_angles


@pytest.mark.parametrize("trail", [0.0, 0.04, -0.3])
def test_angles_and_their_derivatives(
    tricycle: Robot, trail: float, rng: np.random.Generator
) -> None:
    """A bend tighter than the trail has no steady angle; a place that stands still keeps its."""
    (swivel,) = tricycle.drive.steered
    drive = replace(tricycle.drive, swivels=(replace(swivel, trail=trail),))
    twist, once, twice = (casadi.SX.sym(name, 3) for name in ("twist", "once", "twice"))
    direction = twist, once, twice
    found = [casadi.vertcat(*angle) for angle in steered_angles(drive, direction)]
    function = casadi.Function("angles", list(direction), found)
    x, y = swivel.pivot
    tight = 0
    for k in range(60):
        rows = rng.normal(size=(3, 3))
        if k % 3 == 1:  # about a place near the pivot, to either side of it
            rows[0, :2] = rows[0, 2] * (np.array([y, -x]) + 0.1 * rng.normal(size=2))
        if k % 20 == 3:
            rows[0] = rows[0, 2] * np.array([y, -x, 1.0])
        wanted = steer(drive, rows)[:, 0]
        tight += bool(trail) and wanted[1] == wanted[2] == 0.0
        angle = function(*rows).full().ravel()
        size = 1.0 + np.abs(wanted).max()
        np.testing.assert_allclose(angle / size, wanted / size, rtol=0.0, atol=1e-9)
    assert tight or abs(trail) < 0.1
