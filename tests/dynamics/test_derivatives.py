"""Derivatives of the reduced dynamics: central differences, paper and pencil, and a motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.derivatives import LinearDynamics, linearize
from rpctl.dynamics.motion import rk4_step
from rpctl.robot.losses import Losses
from tests import random_vehicles
from tests.grids import cells
from tests.random_robots import random_robot
from tests.robots import SET_A, four_wheels, platform, write
from tests.vehicles import KINDS, vehicle

STEP = 1e-5  # of central differences; their own error is about 1e-9
TOLERANCE = 1e-6  # relative to the largest entry
DRIVES = [*KINDS, "skid-steer", "mecanum"]
LOSSY = ["car-like", "mecanum", "powered"]  # with losses and rotors: what holds with holds without
LOADED = ["casters", "car-like", "tricycle", "bicycle", "steered", "powered"]
VEHICLES = [(kind, seed) for seed in range(6) for kind in LOADED]


def made(kind: str, folder: Path) -> Robot:
    if kind in ("skid-steer", "mecanum"):
        return four_wheels(folder, kind)
    return rpctl.load(write(folder, vehicle(kind)))


def lossy(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with damping and smooth friction in every joint, and rotors behind gears."""
    model = robot.model.copy()
    size = np.append(np.zeros(3), rng.uniform(0.5, 1.5, robot.nv - 3))
    model.armature = 0.1 * size
    losses = Losses(0.3 * size, 0.7 * size, 0.5 * np.ones(robot.nv))
    return replace(robot, model=model, losses=losses)


def slopes(function: Callable[[Array], Array], size: int) -> Array:
    """Central differences of a function of a vector, by its entries."""
    rows = [(function(STEP * e) - function(-STEP * e)) / (2.0 * STEP) for e in np.eye(size)]
    return np.array(rows).T


def assert_near(found: Array, truth: Array, what: str) -> None:
    assert np.isfinite(truth).all(), what
    size = max(1.0, float(np.abs(truth).max(initial=0.0)))
    np.testing.assert_allclose(found, truth, rtol=0, atol=TOLERANCE * size, err_msg=what)


def check(robot: Robot, rng: np.random.Generator, states: int = 2) -> None:
    """By central differences of Pinocchio's reduced dynamics; the bracket is tested by a motion."""
    dynamics, linear = ReducedDynamics(robot), LinearDynamics(robot)
    sizes = robot.nv, robot.dof, len(robot.actuators)
    for _ in range(states):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = 5.0 * rng.normal(size=sizes[2])
        A, B = linear(q, nu, tau)
        vx, vy, turn = (dynamics.basis(q) @ nu)[:3]
        A[:2, :3] -= [[0.0, turn, -vy], [-turn, 0.0, vx]]
        rates = partial(rates_beside, dynamics, q, nu, tau)
        assert_near(np.hstack([A, B]), slopes(rates, sum(sizes)), "A, B")


def rates_beside(dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, x: Array) -> Array:
    """Return v and the derivatives of ν beside a state, x = (δ, δν, δτ)."""
    delta, ahead, more = np.split(x, np.cumsum([dynamics.robot.nv, len(nu)]))
    beside = pin.integrate(dynamics.robot.model, q, delta)
    nu_dot = dynamics.forward(beside, nu + ahead, tau + more)
    return np.append(dynamics.basis(beside) @ (nu + ahead), nu_dot)


@pytest.mark.parametrize("kind", cells(DRIVES, {*DRIVES} - {*LOSSY, "steered", "parallel"}))
def test_central_differences_agree(kind: str, tmp_path: Path, rng: np.random.Generator) -> None:
    check(made(kind, tmp_path), rng)


@pytest.mark.parametrize("kind", LOSSY)
def test_losses_and_rotors_count(kind: str, tmp_path: Path, rng: np.random.Generator) -> None:
    check(lossy(made(kind, tmp_path), rng), rng)


@pytest.mark.parametrize("seed", cells(range(8), (0,), (1,)))
def test_of_random_robots(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([5, seed])
    check(rpctl.load(write(tmp_path, random_robot(rng))), rng)


@pytest.mark.parametrize(("kind", "seed"), cells(VEHICLES, {("steered", 0)}))
def test_of_random_vehicles(kind: str, seed: int, tmp_path: Path, rng: np.random.Generator) -> None:
    check(rpctl.load(write(tmp_path, random_vehicles.vehicle(kind, seed)[0])), rng)


def test_of_a_whole_mobile_manipulator(tiago: Robot, rng: np.random.Generator) -> None:
    check(tiago, rng, 1)


def test_of_the_platform_by_paper_and_pencil(tmp_path: Path) -> None:
    """Its h is (−d w², d v w) times its mass beside the wheels'; M is diagonal in (v, ω)."""
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    v, w = 0.8, 0.5
    A, B = linearize(robot, robot.configuration(1.0, 2.0, 0.7), np.array([v, w]), np.zeros(2))
    m_v = SET_A["m_c"] + 2 * SET_A["m_w"] + 2 * SET_A["I_s"] / SET_A["r"] ** 2
    m_w = SET_A["I_c"] + SET_A["m_c"] * SET_A["d"] ** 2 + 2 * SET_A["I_d"]
    m_w += 2 * SET_A["b"] ** 2 * (SET_A["m_w"] + SET_A["I_s"] / SET_A["r"] ** 2)
    s = SET_A["m_c"] * SET_A["d"]
    expected = np.array([[0.0, 2 * s * w / m_v], [-s * w / m_w, -s * v / m_w]])
    np.testing.assert_allclose(A[-2:, -2:], expected, atol=1e-12)
    r, b = SET_A["r"], SET_A["b"]
    left, right = (robot.actuators.index(f"{side}_joint") for side in ("left", "right"))
    np.testing.assert_allclose(B[-2:, right], [1 / (r * m_v), b / (r * m_w)], atol=1e-12)
    np.testing.assert_allclose(B[-2:, left], [1 / (r * m_v), -b / (r * m_w)], atol=1e-12)
    # The base's own axes turn with it: ẋ1 = δv + ω x2, ẋ2 = v x3 − ω x1, ẋ3 = δω.
    np.testing.assert_allclose(
        A[:3, :3], np.array([[0.0, w, 0.0], [-w, 0.0, v], [0.0, 0.0, 0.0]]), atol=1e-12
    )
    np.testing.assert_allclose(A[:3, -2:], [[1, 0], [0, 0], [0, 1]], atol=1e-12)


@pytest.mark.parametrize("kind", ["car-like", "powered"])
def test_a_motion_beside_another_is_where_the_linear_model_puts_it(
    kind: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Both move for 2 ms; the distance between them has no error of first order."""
    robot, time, small = made(kind, tmp_path), 2e-3, 1e-5
    dynamics = ReducedDynamics(robot)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    tau, x = rng.normal(size=len(robot.actuators)), rng.normal(size=robot.nv + robot.dof)
    middle = rk4_step(dynamics, q, nu, tau, 0.5 * time)
    A, _ = linearize(robot, middle.q, middle.nu, tau)
    here = rk4_step(dynamics, q, nu, tau, time)
    beside = [
        rk4_step(dynamics, pin.integrate(robot.model, q, h * x[: robot.nv]), nu + h * x[robot.nv :],
                 tau, time) for h in (small, -small)
    ]  # fmt: skip
    tangents = [np.append(_distance(robot, here.q, step.q), step.nu - here.nu) for step in beside]
    moved = (tangents[0] - tangents[1]) / (2.0 * small)
    change = moved - x
    expected = expm(time * A) @ x - x
    assert np.linalg.norm(change - expected) < 1e-4 * np.linalg.norm(expected)


def _distance(robot: Robot, q: Array, other: Array) -> Array:
    """The tangent from one configuration to one near it, to second order."""
    cos, sin = q[2], q[3]
    dx, dy = other[0] - q[0], other[1] - q[1]
    turn = math.atan2(cos * other[3] - sin * other[2], cos * other[2] + sin * other[3])
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    half = 0.5 * turn
    base = [x + half * y, y - half * x, turn]
    joints = (
        math.remainder(e.read(other) - e.read(q), 2 * math.pi) for e in robot.entries.values()
    )
    return np.array([*base, *joints])
