"""Drives of four fixed wheels: textbook kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from tests.robots import SET_A, four_wheels

LX, LY = 0.45, SET_A["b"]  # half wheelbase and half track, m


def wheel_rates(robot: Robot, nu: Array) -> Array:
    dynamics, q = ReducedDynamics(robot), robot.configuration()
    rates = dynamics.actuation(q).T @ nu
    return rates[:4] * [1.0, -1.0, 1.0, 1.0]  # one wheel's axis points the other way


def test_mecanum_wheels_turn_as_a_textbook_says(tmp_path: Path) -> None:
    """φ̇ r = vx ∓ vy ∓ (lx + ly) ω, about the middle of the wheels."""
    robot = four_wheels(tmp_path, "mecanum")
    assert robot.quasi_velocities == ("vx", "vy", "omega", "arm_joint")
    vx, vy, omega = 0.4, -0.3, 0.7
    middle = vy - omega * LX  # the root link is ahead of the middle
    expected = [
        vx - middle - (LX + LY) * omega,
        vx + middle + (LX + LY) * omega,
        vx + middle - (LX + LY) * omega,
        vx - middle + (LX + LY) * omega,
    ]
    found = wheel_rates(robot, np.array([vx, vy, omega, 0.0]))
    np.testing.assert_allclose(found * SET_A["r"], expected, atol=1e-12)


def test_skid_steer_wheels_turn_with_their_side(tmp_path: Path) -> None:
    robot = four_wheels(tmp_path, "skid-steer")
    assert robot.drive.point == pytest.approx((-LX, 0.0))
    v, omega = 0.4, 0.7
    left, right = v - LY * omega, v + LY * omega
    found = wheel_rates(robot, np.array([v, omega, 0.0]))
    np.testing.assert_allclose(found * SET_A["r"], [left, right, left, right], atol=1e-12)
    # Its centre does not slide sideways, the root link ahead of it swings.
    S = ReducedDynamics(robot).basis(robot.configuration())
    np.testing.assert_allclose((S @ [v, omega, 0.0])[:3], [v, omega * LX, omega], atol=1e-12)
