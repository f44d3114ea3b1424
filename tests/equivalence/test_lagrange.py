"""The Lagrange-multiplier path: its equations hold, and rank does not bother it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.equivalence.checks import constrained_motion, effort_columns, pinocchio_motion
from rpctl.equivalence.rolling_rows import FileRows
from rpctl.equivalence.tree import FLOATS, Tree


def doubled(robot: Robot) -> Robot:
    """Return a robot whose left wheel is listed twice: two rows of A say the same."""
    left, right = robot.drive.wheels
    drive = dataclasses.replace(robot.drive, wheels=(left, right, left))
    return dataclasses.replace(robot, drive=drive)


def rows_of(robot: Robot) -> FileRows:
    return FileRows(robot, Tree(robot, FLOATS))


@pytest.mark.parametrize("redundant", [False, True])
def test_it_solves_its_equations(robot: Robot, rng: np.random.Generator, redundant: bool) -> None:
    """M v̇ + b = B τ + Aᵀ λ and A v̇ = −Ȧ v, whatever the rank of A."""
    robot = doubled(robot) if redundant else robot
    dynamics, data = ReducedDynamics(robot), robot.model.createData()
    rolling = rows_of(robot)
    for _ in range(5):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        v, tau = dynamics.basis(q) @ nu, rng.normal(size=len(robot.actuators))
        motion = constrained_motion(robot, rolling, q, v, effort_columns(robot) @ tau)
        A, drift = rolling.at(q, v)
        assert np.linalg.matrix_rank(A) == len(A) - redundant
        slip = A @ motion.v_dot + drift
        assert np.abs(slip).max() < 1e-10 * max(1.0, np.abs(motion.v_dot).max())
        left = pin.rnea(robot.model, data, q, v, motion.v_dot)
        right = effort_columns(robot) @ tau + motion.force
        np.testing.assert_allclose(left, right, atol=1e-9 * np.abs(left).max())
        made = A.T @ np.linalg.lstsq(A.T, motion.force)[0]  # by the constraints, and nothing else
        np.testing.assert_allclose(made, motion.force, atol=1e-9 * np.abs(motion.force).max())


def test_pinocchio_agrees_where_rows_are_independent(
    robot: Robot, rng: np.random.Generator
) -> None:
    robot = doubled(robot)
    dynamics, rolling = ReducedDynamics(robot), rows_of(robot)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    v, tau = dynamics.basis(q) @ nu, rng.normal(size=len(robot.actuators))
    own, ours = (
        pinocchio_motion(robot, rolling, q, v, effort_columns(robot) @ tau),
        constrained_motion(robot, rolling, q, v, effort_columns(robot) @ tau).v_dot,
    )
    np.testing.assert_allclose(own, ours, atol=1e-9 * np.abs(ours).max())
