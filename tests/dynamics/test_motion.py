"""One step of the motion, its order and its energy; and speeds behind their commands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad, solve_ivp

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.motion import SERIES_RATIO, Stretch, follow, rk4_step, travel
from rpctl.dynamics.projection import Projector
from rpctl.robot.vary import without_losses

TAU = np.array([2.0, 3.0, 1.0, -1.0])
NU = np.array([0.8, 1.5, -0.4, 0.3])


def run(robot: Robot, steps: int, duration: float = 1.0) -> tuple[Array, Array, float]:
    dynamics = ReducedDynamics(robot)
    positions = {"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6}
    q, nu, work = robot.configuration(1.0, 2.0, 0.5, joints=positions), NU, 0.0
    for _ in range(steps):
        q, nu, done, _ = rk4_step(dynamics, q, nu, TAU, duration / steps)
        work += done
    return q, nu, work


def orders(robot: Robot) -> Array:
    """Return the observed orders (2, 3) of q, ν and work, halving the step twice."""
    exact = run(robot, 640)

    def errors(steps: int) -> Array:
        reached = run(robot, steps)
        return np.array([np.abs(reached[k] - exact[k]).max() for k in range(3)])

    return np.log2([errors(n) / errors(2 * n) for n in (10, 20)])


def test_the_order_is_four(paper: Robot) -> None:
    assert (orders(paper) > 3.7).all()


def test_the_group_correction_is_what_makes_it_so(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Projector, "dexpinv", staticmethod(lambda slide, v: v))
    assert (orders(paper)[:, 0] < 2.5).all()


def test_a_short_step_goes_where_the_speeds_point(robot: Robot, rng: np.random.Generator) -> None:
    dynamics, step = ReducedDynamics(without_losses(robot)), 1e-6
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, np.ones(robot.dof)))
    moved = rk4_step(dynamics, q, nu, tau, step)
    slope = pin.difference(robot.model, q, moved.q) / step
    np.testing.assert_allclose(slope, dynamics.basis(q) @ nu, atol=1e-4)
    np.testing.assert_allclose((moved.nu - nu) / step, 1.0, rtol=1e-3)


def test_the_heading_stays_on_the_circle(paper: Robot) -> None:
    q, _, _ = run(paper, 2000, 20.0)
    assert np.hypot(q[2], q[3]) == pytest.approx(1.0, abs=1e-12)


def test_energy_changes_by_the_work(paper: Robot) -> None:
    dynamics = ReducedDynamics(paper)
    positions = {"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6}
    start = dynamics.energy(paper.configuration(1.0, 2.0, 0.5, joints=positions), NU)
    q, nu, work = run(paper, 500)
    assert dynamics.energy(q, nu) - start == pytest.approx(work, rel=1e-9)
    assert abs(work) > 1.0


@pytest.mark.parametrize(("name", "free"), [("paper", 3), ("balancer", 6)])
def test_the_correction_is_the_rate_of_the_logarithm(
    name: str, free: int, rng: np.random.Generator
) -> None:
    """d/dt log(exp(u) exp(t v)) at t = 0, up to terms of fourth order in u."""
    robot = rpctl.load(name)
    step, model, dynamics = 1e-5, robot.model, ReducedDynamics(robot)
    for _ in range(10):
        q = robot.random_configuration(rng)
        u, v = np.zeros(robot.nv), rng.normal(size=robot.nv)
        u[:free] = rng.uniform(-0.05, 0.05, free)
        ahead, behind = (
            pin.difference(model, q, pin.integrate(model, pin.integrate(model, q, u), s * v))
            for s in (step, -step)
        )
        rate = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(dynamics.dexpinv(u, v), rate, atol=1e-7)


LAG = np.array([0.1, 0.03, 0.0, 5.0])
COMMANDS = np.array([[1.0, -0.5, 0.3, 2.0], [0.2, 0.4, -0.6, -1.0], [0.0, 0.1, 0.2, 0.5]])
DURATIONS = np.array([0.02, 0.05, 0.01])


def speed(t: float, channel: int, nu: Any) -> float:
    """Return ν of a channel at a time: what the equation says, stretch by stretch."""
    for command, duration in zip(COMMANDS[:, channel], DURATIONS, strict=True):
        passed = min(t, duration)
        if LAG[channel]:
            nu = command + (nu - command) * math.exp(-passed / LAG[channel])
        elif passed > 0.0:
            nu = command
        t -= duration
        if t <= 0.0:
            break
    return float(nu)


def test_speeds_follow_their_commands() -> None:
    start = np.array([0.3, 0.2, -0.1, 1.0])
    after, _ = follow(start, COMMANDS, DURATIONS, LAG)
    exact = [speed(DURATIONS.sum(), k, start[k]) for k in range(4)]
    np.testing.assert_allclose(after, exact, rtol=1e-14)


def test_stretches_keep_integral_and_moment() -> None:
    start = np.array([0.3, 0.2, -0.1, 1.0])
    _, stretches = follow(start, COMMANDS, DURATIONS, LAG)
    ends = np.cumsum([stretch.duration for stretch in stretches])
    np.testing.assert_allclose(ends, np.cumsum(DURATIONS))
    for (duration, mean, change), end in zip(stretches, ends, strict=True):
        begin = end - duration
        kinks = np.cumsum(DURATIONS)
        inside = kinks[(kinks > begin) & (kinks < end)]
        for k in range(4):
            kept = {"points": inside} if len(inside) else {}
            total = quad(lambda t, k=k: speed(t, k, start[k]), begin, end, **kept)[0]
            middle = begin + 0.5 * duration
            moment = quad(
                lambda t, k=k, m=middle: (t - m) * speed(t, k, start[k]), begin, end, **kept
            )[0]
            assert mean[k] * duration == pytest.approx(total, abs=1e-12)
            assert change[k] * duration**2 / 12.0 == pytest.approx(moment, abs=1e-12)


def test_the_series_for_long_lags_continues_the_formula() -> None:
    ratios = SERIES_RATIO * np.array([1.0 - 1e-6, 1.0 + 1e-6])
    lags = 0.01 / ratios
    _, ((_, mean, change),) = follow(np.zeros(2), np.ones((1, 2)), np.array([0.01]), lags)
    ramp = 0.5 * 0.01 / lags
    np.testing.assert_allclose(mean, ramp, rtol=1e-3)
    np.testing.assert_allclose(change, 2.0 * ramp, rtol=1e-3)
    np.testing.assert_allclose(change[1] / change[0], 1.0 + 2e-6, atol=5e-7)


def test_steady_speeds_drive_a_circle(paper: Robot) -> None:
    dynamics, v, omega, dt = ReducedDynamics(paper), 0.8, 1.5, 0.7
    q = paper.configuration_at(np.array([1.0, 2.0, 0.4]), paper.home)
    nu = np.array([v, omega, 0.2, 0.1])
    reached = travel(dynamics, q, Stretch(dt, nu, np.zeros(4)))
    radius, turned = v / omega, 0.4 + omega * dt
    x = 1.0 + radius * (math.sin(turned) - math.sin(0.4))
    y = 2.0 - radius * (math.cos(turned) - math.cos(0.4))
    np.testing.assert_allclose(paper.base_pose(reached), [x, y, turned], atol=1e-13)
    np.testing.assert_allclose(paper.joint_positions(reached), paper.home + dt * nu[2:], atol=1e-13)


@pytest.mark.parametrize("name", ["paper", "tricycle"])
def test_the_order_of_travel_is_four(name: str) -> None:
    """Along speeds that change, for a basis that is constant and for one that is not."""
    robot = rpctl.load(name)
    dynamics, dt = ReducedDynamics(robot), 0.4
    q = robot.configuration_at(np.array([1.0, 2.0, 0.4]), robot.home)
    mean, change = np.full(robot.dof, 0.6), np.linspace(1.0, -0.8, robot.dof)

    def reached(parts: int) -> Array:
        place = q
        for k in range(parts):
            middle = mean + ((k + 0.5) / parts - 0.5) * change
            place = travel(dynamics, place, Stretch(dt / parts, middle, change / parts))
        return place

    def rate(t: float, place: Array) -> Array:
        v = dynamics.basis(place) @ (mean + (t / dt - 0.5) * change)
        found = np.zeros(robot.nq)
        cos, sin = place[2], place[3]
        found[:2] = cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]
        found[2:4] = -sin * v[2], cos * v[2]
        for joint in robot.moving_joint_names:
            entry, omega = robot.entries[joint], v[robot.velocity_index(joint)]
            index = entry.index
            if entry.is_pair:
                found[index : index + 2] = -place[index + 1] * omega, place[index] * omega
            else:
                found[index] = omega
        return found

    exact = solve_ivp(rate, (0.0, dt), q, rtol=1e-12, atol=1e-13).y[:, -1]
    errors = [np.abs(reached(parts) - exact).max() for parts in (1, 2, 4)]
    assert errors[2] < 1e-6
    assert np.log2(errors[0] / errors[1]) > 3.6 and np.log2(errors[1] / errors[2]) > 3.6
