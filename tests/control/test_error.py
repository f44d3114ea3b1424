"""The tracking error and its rate."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.control.error import observe, tracking_error, wrap
from rpctl.reference.motion import reference_by_name


def test_the_error_is_seen_from_the_robot(tiago: Robot) -> None:
    state = reference_by_name(tiago, "eight")(0.0)
    state = state._replace(pose=np.array([1.0, 2.0, 0.3]))
    facing_left = tiago.configuration_at(np.array([1.0, 1.5, math.pi / 2]), tiago.home)
    e = tracking_error(tiago, state, facing_left)
    np.testing.assert_allclose(e[:3], [0.5, 0.0, 0.3 - math.pi / 2], atol=1e-15)
    assert not e[3:].any()


def test_angles_wrap() -> None:
    assert wrap(math.pi + 0.1) == pytest.approx(0.1 - math.pi)
    assert wrap(-math.pi - 0.1) == pytest.approx(math.pi - 0.1)
    assert wrap(math.pi) == math.pi
    assert wrap(20 * math.pi + 1.0) == pytest.approx(1.0)


def test_the_rate_is_the_errors_derivative(robot: Robot, rng: np.random.Generator) -> None:
    """Along an actual motion that has nothing to do with the reference."""
    reference, dynamics, step = reference_by_name(robot, "eight"), ReducedDynamics(robot), 1e-6
    for t in rng.uniform(1.0, 20.0, 10):
        nu = 0.5 * rng.normal(size=robot.dof)
        pose = reference(t).pose + rng.normal(size=3) * [0.3, 0.3, 0.5]
        q = robot.configuration_at(pose, robot.home)
        v = dynamics.basis(q) @ nu
        ahead, behind = (
            tracking_error(robot, reference(t + s), pin.integrate(robot.model, q, s * v))
            for s in (step, -step)
        )
        rate = observe(dynamics, reference(t), q, nu).e_dot
        np.testing.assert_allclose((ahead - behind) / (2 * step), rate, atol=1e-7)
