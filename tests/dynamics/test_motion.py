"""One step of the motion: its order, its manifold, its energy."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.motion import rk4_step
from rpctl.robot.description import Array

TAU = np.array([2.0, 3.0, 1.0, -1.0])
NU = np.array([0.8, 1.5, -0.4, 0.3])


def run(robot: Robot, steps: int, duration: float = 1.0) -> tuple[Array, Array, float]:
    dynamics = ReducedDynamics(robot)
    positions = {"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6}
    q, nu, work = robot.configuration(1.0, 2.0, 0.5, positions), NU, 0.0
    for _ in range(steps):
        q, nu, done = rk4_step(dynamics, q, nu, TAU, duration / steps)
        work += done
    return q, nu, work


def test_the_order_is_four(paper: Robot) -> None:
    exact = run(paper, 640)

    def errors(steps: int) -> Array:
        reached = run(paper, steps)
        return np.array([np.abs(reached[k] - exact[k]).max() for k in range(3)])

    for coarse, fine in ((10, 20), (20, 40)):
        orders = np.log2(errors(coarse) / errors(fine))
        assert (orders > 3.7).all(), orders


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
