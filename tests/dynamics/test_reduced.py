"""The reduced dynamics: against closed forms, published numbers, and themselves."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.errors import ActuationError
from tests import closed_form
from tests.robots import SET_A, SET_B, platform, write

ROUNDING = 1e-12  # relative to the largest entry; 1e-15 is what is seen
PRINTED = 5e-10  # the design prints nine decimals


def test_the_printed_numbers_of_the_paper_robot(paper: Robot) -> None:
    dynamics = ReducedDynamics(paper)
    positions = {"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6}
    q, nu = paper.configuration(1.0, -2.0, 0.4, joints=positions), np.array([0.8, 0.5, -0.4, 0.3])
    M, h = dynamics.inertia(q), dynamics.bias(q, nu)
    printed = {
        (0, 0): 38.444444444, (0, 1): -1.159591837, (0, 2): -1.159591837, (0, 3): 1.529684375,
        (1, 1): 21.235686375, (1, 2): 1.015343187, (1, 3): 0.257687075,
        (2, 2): 0.74, (2, 3): 0.0, (3, 3): 2.0,
    }  # fmt: skip
    for (row, column), value in printed.items():
        assert M[row, column] == pytest.approx(value, abs=PRINTED)
        assert M[column, row] == pytest.approx(value, abs=PRINTED)
    expected = [2.641073282, -4.752702996, -0.656665967, -0.430889931]
    np.testing.assert_allclose(-h, expected, atol=PRINTED)
    nu_dot = dynamics.forward(q, nu, np.array([2.0, 3.0, 1.0, -1.0]))  # left before right
    expected = [1.060716590, -0.014540282, 2.146075282, -1.524852341]
    np.testing.assert_allclose(nu_dot, expected, atol=PRINTED)


speed = st.floats(-3.0, 3.0)


@settings(max_examples=40, deadline=None)
@given(st.floats(-2.6, 2.6), st.floats(0.35, 0.95), st.tuples(speed, speed, speed, speed))
def test_the_closed_form_of_the_paper_robot(
    paper: Robot, theta1: float, eta: float, speeds: tuple[float, ...]
) -> None:
    robot, dynamics, nu = paper, ReducedDynamics(paper), np.array(speeds)
    positions = {"arm_revolute_joint": theta1, "arm_prismatic_joint": eta}
    q = robot.configuration(0.3, 0.1, -1.0, joints=positions)
    M, h = closed_form.inertia(theta1, eta), closed_form.bias(theta1, eta, nu)
    np.testing.assert_allclose(dynamics.inertia(q), M, atol=ROUNDING * np.abs(M).max())
    np.testing.assert_allclose(dynamics.bias(q, nu), h, atol=ROUNDING * max(1, np.abs(h).max()))
    np.testing.assert_allclose(dynamics.actuation(q), closed_form.actuation(), atol=ROUNDING)


def test_published_platform_a_in_wheel_space(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    b, r = SET_A["b"], SET_A["r"]
    to_speeds = np.array([[r / 2, r / 2], [r / (2 * b), -r / (2 * b)]])  # of (φ̇R, φ̇L)
    M = to_speeds.T @ ReducedDynamics(robot).inertia(robot.configuration()) @ to_speeds
    np.testing.assert_allclose(M, [[0.37955, -0.01455], [-0.01455, 0.37955]], atol=5e-6)


def test_published_platform_b(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_B)))
    M = ReducedDynamics(robot).inertia(robot.configuration())
    np.testing.assert_allclose(np.diag(M), [16.743767, 0.141141], atol=5e-7)
    assert M[0, 1] == pytest.approx(0.0, abs=1e-14)


def test_forward_undoes_inverse(robot: Robot, rng: np.random.Generator) -> None:
    dynamics = ReducedDynamics(robot)
    for _ in range(20):
        q, nu, nu_dot = (
            robot.random_configuration(rng), rng.normal(size=robot.dof), rng.normal(size=robot.dof)
        )  # fmt: skip
        tau = dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot))
        limit = max(1e-10, 10 * np.finfo(float).eps * np.linalg.cond(dynamics.inertia(q)))
        np.testing.assert_allclose(dynamics.forward(q, nu, tau), nu_dot, atol=limit * 3)


def test_results_are_the_callers_own(paper: Robot) -> None:
    """A later call must not change what an earlier one returned."""
    dynamics = ReducedDynamics(paper)
    q, other = (paper.configuration(joints={"arm_revolute_joint": a}) for a in (0.0, 1.0))
    nu, tau = np.ones(4), np.ones(4)
    first = dynamics.forward(q, nu, tau), dynamics.inertia(q), dynamics.bias(q, nu)
    kept = [array.copy() for array in first]
    dynamics.forward(other, 2 * nu, tau), dynamics.inertia(other), dynamics.bias(other, 2 * nu)
    for array, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(array, copy)
    with pytest.raises(ValueError, match="read-only"):
        dynamics.basis(q)[0, 0] = 2.0


def test_a_third_driven_wheel_shares_the_effort(tmp_path: Path) -> None:
    """With more actuators than speeds, τ is the least one relative to the limits."""
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    left, right = robot.drive.wheels
    doubled = dataclasses.replace(robot.drive, wheels=(left, right, left))
    wide = dataclasses.replace(robot, drive=doubled)
    dynamics = ReducedDynamics(wide)
    q, force = wide.configuration(), np.array([3.0, -1.0])
    tau = dynamics.efforts(q, force)
    np.testing.assert_allclose(dynamics.actuation(q) @ tau, force)
    assert tau[0] == pytest.approx(tau[2])


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_only_the_limits_proportions_matter(paper: Robot, scale: float) -> None:
    """B τ = F has one answer here, in whatever units the limits are large or small."""
    q, force = paper.configuration(), np.array([3.0, -1.0, 0.5, 2.0])
    tau = ReducedDynamics(rpctl.scale_limits(paper, effort=scale)).efforts(q, force)
    np.testing.assert_allclose(tau, ReducedDynamics(paper).efforts(q, force), rtol=1e-9)
    np.testing.assert_allclose(closed_form.actuation() @ tau, force, rtol=1e-9)


def test_what_nothing_drives_is_named(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    left, right = robot.drive.wheels
    one_wheel = dataclasses.replace(
        robot.drive, wheels=(left, dataclasses.replace(right, driven=False))
    )
    dynamics = ReducedDynamics(dataclasses.replace(robot, drive=one_wheel))
    with pytest.raises(ActuationError, match="no actuator drives v, omega of platform"):
        dynamics.efforts(robot.configuration(), np.ones(2))
