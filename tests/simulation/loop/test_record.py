"""The log of a run: forces of the ground at the true efforts, and what else a row says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, Run, track
from rpctl.control.law import Efforts, Limit
from tests.robots import SET_A, ball, platform, write
from tests.vehicles import vehicle

PERIOD = 0.002
G = 9.81


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The platform with a ball 0.6 m ahead, and a hidden 4 N·m that drives its left wheel."""
    folder: Path = tmp_path_factory.mktemp("pushed")
    robot = rpctl.load(write(folder, platform(SET_A, extra=ball(0.6))))
    plant = Plant(tau_bias={"left_joint": 4.0})
    return track(
        robot,
        "line",
        duration=0.02,
        initial_error=(0.1, 0.0, 0.0),
        control_period=PERIOD,
        plant=plant,
    )


def test_forces_of_the_ground_move_the_robot(pushed: Run) -> None:
    """Newton from rest: Σ F = m v̇, with what pushes besides the controller; v̇ from the motion."""
    acceleration = pushed.nu[1] / PERIOD
    mass = SET_A["m_c"] + 2 * SET_A["m_w"]
    assert pushed.log.wheel_force[0].sum() == pytest.approx(mass * acceleration[0], rel=1e-3)
    # Euler about P's vertical: b (F_R − F_L) and the axle's force d behind the centre of mass.
    d, m_c, I_c, I_d, b = (SET_A[key] for key in ("d", "m_c", "I_c", "I_d", "b"))
    inertia = I_c + m_c * d**2 + 2 * (I_d + SET_A["m_w"] * b**2)
    left, right = pushed.log.wheel_force[0]
    assert b * (right - left) == pytest.approx(inertia * acceleration[1], rel=1e-3)
    assert pushed.log.axle_force[0].sum() == pytest.approx(m_c * d * acceleration[1], rel=1e-3)


def test_a_wheels_force_is_its_effort_less_what_spins_it(pushed: Run) -> None:
    """F r = τ + bias − I_s φ̈."""
    r, I_s = SET_A["r"], SET_A["I_s"]
    spin = pushed.log.rates[1] / PERIOD
    expected = (pushed.tau[0] + [4.0, 0.0] - I_s * spin) / r
    np.testing.assert_allclose(pushed.log.wheel_force[0], expected, rtol=1e-3)


def test_loads_are_those_of_the_true_acceleration(pushed: Run) -> None:
    """The ball bears (m_c d g − Σ m z v̇)/0.6: the moment about the axle's contact line."""
    m_c, m_w, d = SET_A["m_c"], SET_A["m_w"], SET_A["d"]
    forward = pushed.nu[1, 0] / PERIOD
    heights = m_c * 0.2 + 2 * m_w * SET_A["r"]
    spin = SET_A["I_s"] * pushed.log.rates[1].sum() / PERIOD
    expected = (m_c * d * G - heights * forward - spin) / 0.6
    assert pushed.log.contact_load[0, 2] == pytest.approx(expected, rel=1e-4)
    assert pushed.log.contact_load[0].sum() == pytest.approx((m_c + 2 * m_w) * G)


def test_limits_are_logged_when_they_bind(paper: Robot) -> None:
    """A row a sample, a column a limit, in the order in which they first bound."""
    slow, weak = Limit("arm_revolute_joint", "velocity"), Limit("wheel_left_joint", "effort")
    bound = iter([(), (slow,), (slow, weak), (weak,)])
    run = track(
        paper,
        "line",
        duration=3 * PERIOD,
        dynamic=lambda *_: Efforts(np.zeros(4), next(bound)),
        control_period=PERIOD,
    )
    assert run.log.bound_limits == (tuple(slow), tuple(weak))
    np.testing.assert_array_equal(run.log.active_limits, [[0, 0], [1, 0], [1, 1], [0, 1]])


@pytest.mark.slow
def test_casters_of_the_reference_trail_it(tmp_path: Path) -> None:
    """In a steady bend c ω = n·V: a trail c swings by what its pivot moves across its heading."""
    robot = rpctl.load(write(tmp_path, vehicle("casters")))
    run = track(
        robot, "circle", duration=10.0, control_period=0.05, plant_step=0.05, collisions=False
    )
    q = run.q_ref[-1]
    v, omega = run.log.nu_ref[-1, :2]
    assert omega > 0.1
    for name, x, y, c in (("caster_0", 0.4, 0.2, 0.06), ("caster_2", -0.3, 0.0, 0.07)):
        phi = -robot.joint_position(q, name)  # its axis points down
        V = np.array([v - omega * y, omega * x])
        assert V @ [-math.sin(phi), math.cos(phi)] == pytest.approx(c * omega, abs=1e-3)
        assert abs(phi) > 0.05


@pytest.mark.slow
def test_steering_starts_on_its_reference(tmp_path: Path) -> None:
    """tan δ = L/(R − w/2) of the left wheel on a circle to the left, from the first sample on."""
    robot = rpctl.load(write(tmp_path, vehicle("car-like")))
    run = track(
        robot, "circle", duration=8.0, control_period=0.05, plant_step=0.05, collisions=False
    )
    v, _, omega = ReducedDynamics(robot).twist(run.q_ref[-1], run.log.nu_ref[-1])
    expected = math.atan(0.7 / (v / omega - 0.25))
    assert run.log.steering[0, 0] == pytest.approx(expected)
    assert robot.joint_position(run.q_ref[0], "steer_left") == pytest.approx(expected)
