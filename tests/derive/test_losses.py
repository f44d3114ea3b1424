"""Written equations have the losses that the robot has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.derive.closed_form import closed_form
from rpctl.derive.program import program
from rpctl.derive.write import c_source, derive, python_source
from tests.dynamics.test_losses import lossy
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle


@pytest.fixture
def cart(tmp_path: Path) -> Robot:
    return lossy(tmp_path, platform(SET_A))


def test_the_closed_form_has_them(cart: Robot, rng: np.random.Generator) -> None:
    form, dynamics = closed_form(cart), ReducedDynamics(cart)
    value = sp.lambdify(form.rates, form.losses, "numpy")
    for _ in range(5):
        nu = rng.normal(size=cart.dof)
        expected = dynamics.losses(cart.configuration(), nu)
        np.testing.assert_allclose(np.ravel(value(*nu)), expected, rtol=1e-12)
    text = derive(cart, "text")
    assert "M nu_dot + h = B tau + l" in text and "\n  l2 = " in text
    assert r"B \tau + \ell$" in derive(cart, "latex")
    assert r"\ell_{2} &= " in derive(cart, "latex")


def test_no_losses_are_not_written(tmp_path: Path) -> None:
    ideal = rpctl.load(write(tmp_path, platform(SET_A)))
    assert not any(closed_form(ideal).losses)
    assert "ell" not in derive(ideal, "latex").replace("ldelay", "")
    for source in (python_source(ideal), c_source(ideal)):
        assert "losses" not in source and "+ l)" not in source


def test_code_has_them(tmp_path: Path, rng: np.random.Generator) -> None:
    """Python run here; casters' angles go into ℓ. Rotors are in M."""
    robot = rpctl.load(lossy(tmp_path, vehicle("casters")).source, armature={"*": 0.2})
    names: dict[str, Any] = {}
    exec(python_source(robot), names)
    forward = next(each for name, each in names.items() if name.endswith("_forward"))
    losses = next(each for name, each in names.items() if name.endswith("_losses"))
    dynamics, positions = ReducedDynamics(robot), program(robot).positions
    for _ in range(3):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = rng.normal(size=len(robot.actuators))
        read = [robot.joint_position(q, name) for name in positions]
        np.testing.assert_allclose(losses(read, nu), dynamics.losses(q, nu), rtol=1e-11)
        truth: Array = dynamics.forward(q, nu, tau)
        np.testing.assert_allclose(forward(read, nu, tau), truth, atol=1e-11 * np.abs(truth).max())
