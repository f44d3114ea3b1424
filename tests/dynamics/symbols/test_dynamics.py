"""The dynamics in symbols say what Pinocchio says, of every drive and of random robots."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, pi
from pathlib import Path

import casadi
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.symbols.basis import SINGULAR
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import ActuationError, SingularBasisError, UnknownNameError
from rpctl.robot import catalog
from rpctl.robot.vary import without_losses
from tests import random_vehicles, vehicles
from tests.dynamics.symbols.comparison import check
from tests.grids import cells
from tests.random_robots import WheeledRobot, robots
from tests.robots import SET_A, platform, write

OWN = [entry.name for entry in catalog.ENTRIES if entry.own and not entry.leans]
ROUNDING = 1e-13


@pytest.mark.parametrize("name", cells([*OWN, "tiago"], {"car"}, {"swerve"}))
def test_own_robots(name: str) -> None:
    check(SymbolicDynamics(rpctl.load(name)))


@pytest.mark.parametrize("kind", cells(vehicles.KINDS, (), {"twin"}))
def test_vehicles(kind: str, tmp_path: Path) -> None:
    check(SymbolicDynamics(rpctl.load(write(tmp_path, vehicles.vehicle(kind)))))


@pytest.mark.parametrize("seed", cells(range(3), slow=(0,)))
@pytest.mark.parametrize("kind", random_vehicles.KINDS)
def test_random_vehicles(kind: str, seed: int, tmp_path: Path) -> None:
    text, _ = random_vehicles.vehicle(kind, 100 + seed)
    path = write(tmp_path, text)
    drive = None
    if kind in random_vehicles.DRIVE_FILES:
        drive = write(tmp_path, random_vehicles.DRIVE_FILES[kind], "drive.toml")
    check(SymbolicDynamics(rpctl.load(path, drive=drive)))


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(robots())
def test_random_robots(tmp_path_factory: pytest.TempPathFactory, built: WheeledRobot) -> None:
    """Any tree: slanted axes, mimics, massless links, joints on joints that slide."""
    folder = tmp_path_factory.mktemp("random")
    check(SymbolicDynamics(rpctl.load(write(folder, built.text))))


@pytest.mark.parametrize("name", ["bicycle", "car"])
def test_the_margin_vanishes_at_singular_steering(name: str) -> None:
    """Where the steered wheel's axle passes through P, the speed of P says nothing of the bend."""
    robot = rpctl.load(name)
    swivel = robot.drive.steered[0]
    dynamics, truth = SymbolicDynamics(robot), ReducedDynamics(robot)
    q = casadi.SX.sym("q", robot.nq)
    margin = casadi.Function("margin", [q], [dynamics.rank_margin(q)])
    x, y = np.subtract(swivel.pivot, robot.drive.point)
    across = swivel.sign * (atan2(y, x) + 0.5 * pi - swivel.heading)
    for turn in (-1.0, -0.3, 0.3, 1.0):
        posture = robot.configuration(joints={swivel.joint: across + turn})
        assert float(margin(posture)) > 1e-2
        truth.at(posture)
    posture = robot.configuration(joints={swivel.joint: across})
    assert float(margin(posture)) < 1e-3 * SINGULAR
    with pytest.raises(SingularBasisError):
        truth.at(posture)


@pytest.mark.parametrize("turn", [0.0, 1e-300, 1e-9, -0.3, 4.0])
def test_integrate_takes_any_turn(paper: Robot, turn: float) -> None:
    q, v = casadi.SX.sym("q", paper.nq), casadi.SX.sym("v", paper.nv)
    moved = casadi.Function("moved", [q, v], [SymbolicDynamics(paper).integrate(q, v)])
    start = paper.configuration(1.0, -2.0, 0.7)
    way = np.array([0.3, -0.2, turn, *np.linspace(-1.0, 2.0, paper.nv - 3)])
    found = moved(start, way).full().ravel()
    np.testing.assert_allclose(found, pin.integrate(paper.model, start, way), atol=1e-9)
    if turn == 0.0:
        cos, sin = start[2:4]
        ahead = [1.0 + 0.3 * cos + 0.2 * sin, -2.0 + 0.3 * sin - 0.2 * cos]
        np.testing.assert_allclose(found[:2], ahead, rtol=1e-15)


def test_losses_and_their_slopes(tiago: Robot, rng: np.random.Generator) -> None:
    assert tiago.losses is not None
    v = casadi.SX.sym("v", tiago.nv)
    dynamics = SymbolicDynamics(tiago)
    assert dynamics.lossy and not SymbolicDynamics(without_losses(tiago)).lossy
    methods = dynamics.loss_force, dynamics.loss_slope, dynamics.loss_secant
    function = casadi.Function("losses", [v], [method(v) for method in methods])
    for size in (0.0, 1e-3, 1.0):
        rates = size * rng.normal(size=tiago.nv)
        truth = tiago.losses.force(rates), tiago.losses.slope(rates), tiago.losses.secant(rates)
        for found, wanted in zip(function(rates), truth, strict=True):
            np.testing.assert_allclose(found.full().ravel(), wanted, rtol=ROUNDING, atol=1e-300)


def test_round_wheels_turn_without_being_asked_for_their_angle() -> None:
    robot = rpctl.load("car")
    q, nu = casadi.SX.sym("q", robot.nq), casadi.SX.sym("nu", robot.dof)
    forward = SymbolicDynamics(robot).forward(q, nu, casadi.SX.zeros(len(robot.actuators)))
    asked = casadi.which_depends(forward, q, 1, False)
    names = {name for name, entry in robot.entries.items() if asked[entry.index]}
    assert names == {*robot.joint_names, *(swivel.joint for swivel in robot.drive.swivels)}
    assert not any(asked[:4])  # nor for where the robot stands


def test_a_link_that_is_not_there(paper: Robot) -> None:
    with pytest.raises(UnknownNameError, match="hand"):
        SymbolicDynamics(paper).placement(casadi.SX.sym("q", paper.nq), "hand")


def test_undriven_quasi_velocities_are_named(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, vehicles.vehicle("bicycle")))
    swivels = tuple(replace(swivel, driven=False) for swivel in robot.drive.swivels)
    undriven = replace(robot, drive=replace(robot.drive, swivels=swivels))
    q, force = casadi.SX.sym("q", robot.nq), casadi.SX.sym("f", robot.dof)
    with pytest.raises(ActuationError, match="steer"):
        SymbolicDynamics(undriven).efforts(q, force)


def test_a_platform_whose_bias_is_rounding_alone(tmp_path: Path) -> None:
    balanced = platform({**SET_A, "d": 0.0})
    check(SymbolicDynamics(rpctl.load(write(tmp_path, balanced))), samples=1)
