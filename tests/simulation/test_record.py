"""The log of a run: forces of the ground at the true efforts, and what else a row says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Plant, Run, track
from tests.robots import SET_A, ball, platform, write

PERIOD = 0.002
G = 9.81


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The platform with a ball 0.6 m ahead, and a hidden 4 N·m that drives its left wheel."""
    folder: Path = tmp_path_factory.mktemp("pushed")
    robot = rpctl.load(write(folder, platform(SET_A, extra=ball(0.6))))
    plant = Plant(tau_bias={"left_joint": 4.0})
    return track(robot, "line", 0.02, (0.1, 0.0, 0.0), control_period=PERIOD, plant=plant)


def test_forces_of_the_ground_move_the_robot(pushed: Run) -> None:
    """Newton from rest: Σ F = m v̇, with what pushes besides the controller; v̇ from the motion."""
    acceleration = pushed.nu[1] / PERIOD
    mass = SET_A["m_c"] + 2 * SET_A["m_w"]
    assert pushed.wheel_force[0].sum() == pytest.approx(mass * acceleration[0], rel=1e-3)
    # Euler about P's vertical: b (F_R − F_L) and the axle's force d behind the centre of mass.
    d, m_c, I_c, I_d, b = (SET_A[key] for key in ("d", "m_c", "I_c", "I_d", "b"))
    inertia = I_c + m_c * d**2 + 2 * (I_d + SET_A["m_w"] * b**2)
    left, right = pushed.wheel_force[0]
    assert b * (right - left) == pytest.approx(inertia * acceleration[1], rel=1e-3)
    assert pushed.axle_force[0].sum() == pytest.approx(m_c * d * acceleration[1], rel=1e-3)


def test_a_wheels_force_is_its_effort_less_what_spins_it(pushed: Run) -> None:
    """F r = τ + bias − I_s φ̈."""
    r, I_s = SET_A["r"], SET_A["I_s"]
    spin = pushed.rates[1] / PERIOD
    expected = (pushed.tau[0] + [4.0, 0.0] - I_s * spin) / r
    np.testing.assert_allclose(pushed.wheel_force[0], expected, rtol=1e-3)


def test_loads_are_those_of_the_true_acceleration(pushed: Run) -> None:
    """The ball bears (m_c d g − Σ m z v̇)/0.6: the moment about the axle's contact line."""
    m_c, m_w, d = SET_A["m_c"], SET_A["m_w"], SET_A["d"]
    forward = pushed.nu[1, 0] / PERIOD
    heights = m_c * 0.2 + 2 * m_w * SET_A["r"]
    spin = SET_A["I_s"] * pushed.rates[1].sum() / PERIOD
    expected = (m_c * d * G - heights * forward - spin) / 0.6
    assert pushed.contact_load[0, 2] == pytest.approx(expected, rel=1e-4)
    assert pushed.contact_load[0].sum() == pytest.approx((m_c + 2 * m_w) * G)
