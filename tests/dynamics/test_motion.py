"""One step of the motion: its order, its manifold, its energy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics import motion
from rpctl.dynamics.motion import rk4_step
from rpctl.robot.vary import without_losses

TAU = np.array([2.0, 3.0, 1.0, -1.0])
NU = np.array([0.8, 1.5, -0.4, 0.3])


def run(robot: Robot, steps: int, duration: float = 1.0) -> tuple[Array, Array, float]:
    dynamics = ReducedDynamics(robot)
    positions = {"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6}
    q, nu, work = robot.configuration(1.0, 2.0, 0.5, positions), NU, 0.0
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
    monkeypatch.setattr(motion, "dexpinv", lambda slide, v: v)
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
    start = dynamics.energy(paper.configuration(1.0, 2.0, 0.5, positions), NU)
    q, nu, work = run(paper, 500)
    assert dynamics.energy(q, nu) - start == pytest.approx(work, rel=1e-9)
    assert abs(work) > 1.0


def test_the_correction_is_the_rate_of_the_logarithm(
    paper: Robot, rng: np.random.Generator
) -> None:
    """d/dt log(exp(u) exp(t v)) at t = 0, up to terms of fourth order in u."""
    step, model = 1e-5, paper.model
    for _ in range(10):
        q = paper.random_configuration(rng)
        u, v = np.zeros(paper.nv), rng.normal(size=paper.nv)
        u[:3] = rng.uniform(-0.05, 0.05, 3)
        ahead, behind = (
            pin.difference(model, q, pin.integrate(model, pin.integrate(model, q, u), s * v))
            for s in (step, -step)
        )
        rate = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(motion.dexpinv(u, v), rate, atol=1e-7)
