"""S(q) where it is not constant: a platform that drags a swivel caster along."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.rolling import basis, selection
from rpctl.errors import SingularBasisError
from tests.robots import SET_A, free_caster, platform, write


@pytest.fixture
def caster(tmp_path: Path) -> Robot:
    """A platform whose third wheel swivels: its two rates follow from v and ω."""
    return rpctl.load(write(tmp_path, platform(SET_A, extra=free_caster())))


def state(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    q = robot.random_configuration(rng)
    return q, rng.normal(size=robot.dof)


def test_basis_solves_constraints_and_selection(
    caster: Robot, robot: Robot, rng: np.random.Generator
) -> None:
    for one in (caster, robot):
        dynamics = ReducedDynamics(one)
        for _ in range(10):
            q, _ = state(one, rng)
            S = dynamics.basis(q)
            assert np.abs(dynamics.constraint(q) @ S).max() < 1e-13 * np.abs(S).max()
            np.testing.assert_allclose(
                selection(one, dynamics.rolling) @ S, np.eye(one.dof), atol=1e-13
            )


def test_a_caster_turns_as_a_textbook_says(caster: Robot) -> None:
    """A caster with trail c that stands at γ turns at γ̇ = −ω + (v_y cos γ − v_x sin γ)/c."""
    dynamics, trail = ReducedDynamics(caster), 0.06
    v, omega = 0.7, -0.4
    for gamma in (-2.0, 0.3, 1.1):
        q = caster.configuration(joints={"swivel": gamma})
        rate = (dynamics.basis(q) @ [v, omega])[caster.velocity_index("swivel")]
        vx, vy = v - omega * 0.02, omega * 0.5  # of the swivel axis
        expected = -omega + (-vx * math.sin(gamma) + vy * math.cos(gamma)) / trail
        assert rate == pytest.approx(expected)


def test_a_base_that_is_free_is_refused() -> None:
    A, W = np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    with pytest.raises(SingularBasisError, match="determine 2 of 3 velocities"):
        basis(A, W)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nearly_parallel_equations_are_refused(sign: float) -> None:
    """Of condition 4e10, whatever the signs of their entries; a thousandth of it is fine."""
    A, W = np.array([[1.0, sign]]), np.array([[sign, 1.0 + 1e-10]])
    with pytest.raises(SingularBasisError, match="determine no one motion"):
        basis(A, W)
    S = basis(A, np.array([[sign, 1.0 + 1e-7]]))
    np.testing.assert_allclose(S, [[-sign * 1e7], [1e7]], rtol=1e-6)


def test_rank_is_told_relative_to_the_largest_equation() -> None:
    """In other units of the constraints, what was determined is so no more."""
    A, W = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([[0.0, 1e-4]])
    np.testing.assert_allclose(basis(A, W), [[0.0], [1e4]])
    with pytest.raises(SingularBasisError, match="determine 1 of 2 velocities"):
        basis(1e6 * A, W)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_constraints_that_contradict_are_refused(sign: float) -> None:
    """One wheel holds the motion that is asked for, and another one the other."""
    A, W = np.array([[sign, 0.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    with pytest.raises(SingularBasisError, match="rolling constraints contradict each other"):
        basis(A, W)
