"""The rows of efforts and ground: what Pinocchio's dynamics make of a state, and differences."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.forces import KEPT_LOAD_SPLITS, ForceModel, Ground
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.settings import Bounds
from rpctl.dynamics.ground_reaction import GroundReaction, find_contacts, ground_reaction
from rpctl.robot.losses import Losses
from tests.differences import slopes
from tests.grids import cells
from tests.robots import four_wheels, write
from tests.vehicles import KINDS, vehicle

STEP = 1e-5  # of central differences; their own error is about 1e-9
TOLERANCE = 1e-6  # relative to the largest entry of a column
BOUNDS = Bounds(tip_margin=0.02, grip=0.9)
FACES = 8
DRIVES = [*KINDS, "skid-steer", "mecanum", "tiago", "swerve", "caster_drive"]
QUICK = {("car-like", True), ("powered", False)}
SLOW = {("tiago", True), ("swerve", True), ("trailers", True), ("mecanum", False), ("omni", True)}
GRID = [(kind, lossy) for kind in DRIVES for lossy in (False, True)]


def made(kind: str, lossy: bool, folder: Path, rng: np.random.Generator) -> Robot:
    if kind in ("skid-steer", "mecanum"):
        robot = four_wheels(folder, kind)
    else:
        robot = rpctl.load(write(folder, vehicle(kind)) if kind in KINDS else kind)
    size = np.append(np.zeros(3), rng.uniform(0.5, 1.5, robot.nv - 3))
    losses = Losses(0.3 * size, 0.7 * size, 0.5 * np.ones(robot.nv))
    return replace(robot, losses=losses if lossy else None)


def forces_of(robot: Robot) -> tuple[ReducedDynamics, ForceModel]:
    dynamics = ReducedDynamics(robot)
    return dynamics, ForceModel(Model(dynamics, 4, 0.05), find_contacts(dynamics), BOUNDS)


@pytest.mark.parametrize(("kind", "lossy"), cells(GRID, QUICK, SLOW))
def test_derivatives_are_differences(
    kind: str, lossy: bool, tmp_path: Path, rng: np.random.Generator
) -> None:
    robot = made(kind, lossy, tmp_path, rng)
    _, forces = forces_of(robot)
    dof, base = robot.dof, len(robot.drive.base_speeds)
    for _ in range(3):
        q, (nu, nu_dot) = robot.random_configuration(rng), 0.3 * rng.normal(size=(2, dof))
        forces.update(q)
        for rows, moving in ((forces.measured, dof), (forces.foreseen, base)):
            speeds = base if rows is forces.foreseen else 0

            def values(by: Array) -> Array:
                a, v = nu_dot.copy(), nu.copy()  # noqa: B023
                a[:moving], v[: len(by) - moving] = np.split(by, [moving])  # noqa: B023
                return rows(q, v, a)[:, 0]  # noqa: B023

            at = np.concatenate([nu_dot[:moving], nu[:speeds]])
            truth = slopes(values, at, STEP)
            size = np.maximum(1.0, np.abs(truth).max(axis=0, initial=0.0))
            error = np.abs(rows(q, nu, nu_dot)[:, 1:] - truth) / size
            assert error.max(initial=0.0) < TOLERANCE, error.max(axis=0)


def grounded(name: str) -> tuple[ReducedDynamics, ForceModel, Ground]:
    dynamics, forces = forces_of(rpctl.load(name))
    assert forces.ground is not None
    return dynamics, forces, forces.ground


def reaction(
    dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array
) -> tuple[Array, GroundReaction]:
    contacts = find_contacts(dynamics)
    assert contacts is not None
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot))
    return tau, ground_reaction(dynamics, contacts, q, nu, tau)


@pytest.mark.parametrize("name", ["paper", "tiago", "mecanum"])
def test_rows_are_those_of_the_dynamics(name: str, rng: np.random.Generator) -> None:
    """Efforts over their limits; the least row of the edges is the margin where load bears."""
    dynamics, forces, ground = grounded(name)
    robot = dynamics.robot
    nu, nu_dot = 0.3 * rng.normal(size=(2, robot.dof))
    joints = robot.home + 0.1 * rng.normal(size=len(robot.joints))
    q = robot.configuration_at(rng.normal(size=3), joints)
    tau, found = reaction(dynamics, q, nu, nu_dot)
    limits = 0.97 * robot.effort_limits
    share = (tau / limits)[np.isfinite(limits)]
    for rows in (forces.measured, forces.foreseen):
        values = rows(q, nu, nu_dot)[:, 0]
        both = np.concatenate([share - 1.0, -share - 1.0])
        np.testing.assert_allclose(values[: len(both)], both, atol=1e-9)
        tip = -values[len(both) : len(both) + ground.edges].max()
        expected = (found.tip_margin - 0.02) * found.force[2] / (robot.mass * 9.81)
        assert tip == pytest.approx(expected, abs=1e-9)


def test_contacts_that_let_go_and_take_hold_bound_both_ways() -> None:
    """Braking lifts TIAGo's rear casters: the grip of before binds on, beside that of now."""
    dynamics, forces, ground = grounded("tiago")
    robot, splits = dynamics.robot, deque[Array](maxlen=KEPT_LOAD_SPLITS)
    q, nu, grips = robot.configuration(), np.eye(robot.dof)[0] * 0.4, []
    for braking in (0.0, -1.5):
        rows = forces.measured(q, nu, braking * np.eye(robot.dof)[0], splits)[:, 0]
        grips.append(rows[forces.efforts + ground.edges :].reshape(KEPT_LOAD_SPLITS, -1))
    still, both = grips
    assert not np.array_equal(splits[1], splits[2])
    np.testing.assert_array_equal(still, np.tile(still[0], (KEPT_LOAD_SPLITS, 1)))
    np.testing.assert_array_equal(both[0], both[1])
    alone = forces.foreseen(q, nu, -1.5 * np.eye(robot.dof)[0])[forces.efforts + ground.edges :, 0]
    np.testing.assert_allclose(both[2], alone, atol=1e-12)
    assert np.abs(both[2] - both[1]).max() > 1e-3


def test_rows_of_the_grip_tell_slipping(rng: np.random.Generator) -> None:
    """Wherever a polygon's rows are kept the wheel keeps its share of the grip."""
    dynamics, forces, ground = grounded("paper")
    robot, said = dynamics.robot, set()
    for _ in range(300):
        scale = [[1.0, 1.0, 0.3, 0.1], [2.0, 2.0, 0.3, 0.1]]
        nu, nu_dot = rng.normal(size=(2, robot.dof)) * scale
        q = robot.configuration_at(np.zeros(3), robot.home)
        _, found = reaction(dynamics, q, nu, nu_dot)
        if found.load.min() <= 0.0:
            continue
        held = bool(forces.foreseen(q, nu, nu_dot)[forces.efforts + ground.edges :, 0].max() <= 0.0)
        said.add(held)
        # The polygon lies inside the circle, and touches it from within by 1 - cos(π/8).
        most = found.slip_ratio.max()
        assert most <= 0.9 if held else most >= 0.9 * np.cos(np.pi / FACES)
    assert said == {True, False}
