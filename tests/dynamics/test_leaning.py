"""Wheels that lean: Whipple's bicycle as published, and what keeps wheels on the ground."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.dynamics.leaning import LeaningProjector
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import LeaningDynamics
from rpctl.errors import SingularBasisError
from rpctl.files import toml
from tests.dynamics.whipple import (
    BENCHMARK,
    GRAVITY,
    PUBLISHED,
    LinearBicycle,
    linear_equations,
    urdf,
)
from tests.grids import cells
from tests.leaning import OWN, leaning
from tests.robots import write

BICYCLES = toml.read(
    Path(__file__).with_name("bicycles.toml"), lambda data, _: data, "a table of bicycles"
)


def found(robot: rpctl.Robot, speed: float) -> LinearBicycle:
    """Return M, v C1, g K0 + v² K2 of lean and steering going straight, and what they do to v."""
    dynamics, q, nu = ReducedDynamics(robot), robot.configuration(), np.array([speed, 0.0, 0.0])
    A, _ = rpctl.linearize(robot, q, nu, np.zeros(2))
    M, along = dynamics.inertia(q), dynamics.basis(q)
    K = -M @ A[robot.nv :, : robot.nv] @ along
    C = -M @ A[robot.nv :, robot.nv :]
    return LinearBicycle(M[1:, 1:], C[1:, 1:], K[1:, 1:], K[:1, 1:])


def off(one: Array, other: Array) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize("name", cells(["benchmark", *BICYCLES], ("benchmark", "rigid")))
def test_the_linear_equations_of_a_bicycle_as_published(tmp_path: Path, name: str) -> None:
    parameters = BENCHMARK if name == "benchmark" else BICYCLES[name]
    robot = rpctl.load(write(tmp_path, urdf(parameters)))
    assert robot.drive.type == "leaning-bicycle" and robot.model.joints[1].nv == 6
    wanted, standing = linear_equations(parameters), found(robot, 0.0)
    assert off(standing.M, wanted.M) < 1e-12
    assert off(standing.K0, GRAVITY * wanted.K0) < 1e-12
    for speed in (1.0, 5.0, -2.0):
        rolling = found(robot, speed)
        assert off(rolling.C1, speed * wanted.C1) < 1e-12
        assert off(rolling.K0 - standing.K0, speed**2 * wanted.K2) < 1e-12
        assert np.abs(rolling.K2).max() < 1e-9  # lean and steering change no speed


def test_the_published_entries_of_the_benchmark() -> None:
    for ours, theirs in zip(linear_equations(BENCHMARK), PUBLISHED, strict=True):
        assert np.abs(ours - theirs).max() < 1e-13


def test_the_eigenvalues_of_the_benchmark() -> None:
    """Meijaard et al., Table 2, at 5 m/s; the bicycle is stable by itself there."""
    robot = leaning("whipple")
    M, C, K, _ = found(robot, 5.0)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    values = sorted(np.linalg.eigvals(A), key=lambda each: (each.real, each.imag))
    wanted = [-14.07838969279822, -0.77534188219585 - 4.46486771378823j]
    wanted += [-0.77534188219585 + 4.46486771378823j, -0.32286642900409]
    assert np.abs(np.array(values) - wanted).max() < 1e-9


@pytest.mark.parametrize("name", OWN)
def test_rows_rates_and_speeds_by_differences(name: str) -> None:
    robot = leaning(name)
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(3)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    at = dynamics.at(q)
    assert np.abs(at.A @ at.S).max() < 1e-13
    assert np.abs(at.W @ at.S - np.eye(robot.dof)).max() < 1e-12

    def along(time: float) -> Array:
        moved = pin.integrate(robot.model, q, time * (at.S @ nu))
        x, y, theta = robot.base_pose(moved)
        return np.array([x, y, theta, robot.tilt(moved), *dynamics.basis(moved) @ nu])

    x, y, theta, tilt, *change = (along(1e-6) - along(-1e-6)) / 2e-6
    heading = robot.base_pose(q)[2]
    ahead = np.cos(heading) * x + np.sin(heading) * y
    beside = np.cos(heading) * y - np.sin(heading) * x
    assert np.allclose([ahead, beside, theta], dynamics.twist(q, nu), atol=1e-6)
    names = robot.quasi_velocities
    first = names.index("roll_rate" if "roll_rate" in names else "pitch_rate")
    assert np.allclose([ahead, tilt], nu[[0, first]], atol=1e-6)
    assert np.allclose(change, dynamics.basis_drift(q, nu), atol=1e-5 * np.abs(change).max())


@pytest.mark.parametrize("name", OWN)
def test_wheels_stay_on_the_ground(name: str) -> None:
    robot = leaning(name)
    dynamics, projector = ReducedDynamics(robot), LeaningProjector(robot)
    q, nu = robot.random_configuration(np.random.default_rng(1)), np.full(robot.dof, 0.2)
    assert np.abs(projector.heights(q)).max() < 1e-13
    for _ in range(20):
        q = dynamics.integrate(q, dynamics.basis(q) @ nu * 0.02)
        assert np.abs(projector.heights(q)).max() < 1e-13


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_bicycle_that_steers_across_is_singular(tilt: float) -> None:
    """The front wheel's way turns across the rear wheel's near 90°: det [A; W] vanishes there."""
    robot = leaning("whipple")
    projector = LeaningProjector(robot)

    def at(angle: float) -> Array:
        return robot.configuration(joints={"steering_joint": angle}, tilt=tilt)

    def determinant(angle: float) -> float:
        return float(np.linalg.det(projector.equations(at(angle))))

    angle = brentq(determinant, 1.4, 1.8, xtol=1e-15, rtol=1e-15)
    assert angle == pytest.approx(np.pi / 2, abs=0.1)
    with pytest.raises(SingularBasisError, match=rf"steering_joint at {angle:.3g}"):
        ReducedDynamics(robot).at(at(angle))
    for near in (angle - 0.02, angle + 0.02):
        assert np.isfinite(ReducedDynamics(robot).basis(at(near))).all()


@pytest.mark.parametrize("name", ["balancer", "wheel_legs"])
def test_a_pair_of_wheels_that_lies_on_its_side_is_singular(name: str) -> None:
    """With the axle upright no lowest point is left; pitch and legs alone are singular nowhere."""
    robot = leaning(name)
    q, rng = robot.configuration(), np.random.default_rng(5)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0)).coeffs()
    with pytest.raises(
        SingularBasisError,
        match=r"the axle of wheel_left_joint 90° off "
        r"horizontal",
    ):
        ReducedDynamics(robot).forward(q, np.zeros(robot.dof), np.zeros(len(robot.actuators)))
    names = robot.joint_names
    for tilt in (-3.0, -np.pi / 2, 0.0, np.pi / 2):
        folded = np.tile(rng.choice([-np.pi, -np.pi / 2, 0.0, np.pi / 2], 2), 2)
        posture = dict(zip(names, folded[: len(names)].tolist(), strict=True))
        equations = LeaningProjector(robot).equations(
            robot.configuration(joints=posture, tilt=tilt)
        )
        assert np.linalg.cond(equations) < 200.0


def test_a_torus_touches_below_its_section() -> None:
    """A ball is a torus of one radius: wherever it leans, its lowest point is below its centre."""
    robot = leaning("whipple")
    axle = robot.axles[1]._replace(tyre=0.3)
    assert axle.lowest(1.0, 0.6, np.sqrt) == pytest.approx(0.7)
    disc = axle._replace(tyre=0.0)
    assert disc.lowest(1.0, 0.6, np.sqrt) == pytest.approx(1.0 - 0.3 * 0.8)


@pytest.mark.parametrize("name", OWN)
def test_a_step_is_of_order_four_and_keeps_wheels_on_the_ground(name: str) -> None:
    """Half the step leaves a sixteenth of the error; without SE(3)'s bracket it left a quarter."""
    robot, rng = leaning(name), np.random.default_rng(3)
    dynamics, tau = ReducedDynamics(robot), np.zeros(len(robot.actuators))
    q0, nu0 = robot.random_configuration(rng), 0.5 * rng.normal(size=robot.dof)

    def end(steps: int) -> Array:
        q, nu = q0, nu0
        for _ in range(steps):
            q, nu, *_ = rk4_step(dynamics, q, nu, tau, 0.16 / steps)
        assert np.abs(LeaningProjector(robot).heights(q)).max() < 1e-13
        return np.concatenate([pin.difference(robot.model, q0, q), nu])

    finest = end(128)
    coarse, fine = (np.abs(end(steps) - finest).max() for steps in (16, 32))
    assert 11.0 < coarse / fine < 22.0


@pytest.mark.parametrize("name", OWN)
def test_the_ground_carries_the_weight_of_what_stands(name: str) -> None:
    robot = leaning(name)
    dynamics, still = ReducedDynamics(robot), np.zeros(robot.dof)
    q = robot.configuration_at(np.array([0.4, -0.3, 2.0]), robot.home)
    tau = np.linalg.pinv(dynamics.actuation(q)) @ dynamics.bias(q, still)
    at, (force, _) = dynamics.at(q), dynamics.reaction(q, still, tau)
    found = at.multipliers @ force
    assert off(at.A.T @ found, force) < 1e-12
    assert found[-2:].sum() == pytest.approx(9.81 * robot.mass, rel=1e-9)  # the heights' rows
    assert found[-2:].min() > 0.0


@pytest.mark.parametrize("name", OWN)
def test_machine_code_moves_a_robot_as_pinocchio_does(name: str) -> None:
    """A step and a way, of which a step that is pushed by nothing and S tell."""
    robot, rng = leaning(name), np.random.default_rng(2)
    dynamics = ReducedDynamics(robot)
    assert isinstance(dynamics, LeaningDynamics)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    tau, dt = rng.normal(size=len(robot.actuators)), 0.02
    found = rk4_step(dynamics, q, nu, tau, dt)
    wanted = rk4_step(dynamics, q, nu, tau, dt, lambda _: np.zeros(robot.dof))
    for one, other in zip(found, wanted, strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    place, force, B, _ = dynamics.required(q, dt * nu, nu, nu)
    wanted_place = dynamics.integrate(q, dynamics.basis(q) @ (dt * nu))
    assert np.abs(place - wanted_place).max() < 1e-12
    assert force == pytest.approx(dynamics.inverse(place, nu, nu), abs=1e-9)
    assert pytest.approx(dynamics.actuation(place), abs=1e-12) == B


@pytest.mark.parametrize(("name", "radius"), [("balancer", 0.1), ("whipple", 0.3)])
def test_a_robot_that_lies_on_its_side_is_somewhere(name: str, radius: float) -> None:
    """Rolled by a right angle about the ground's x axis, its axle is at y = −r; the rim below it
    a little before, at y = 0. A controller answers, too.
    """
    robot, q = leaning(name), leaning(name).configuration()
    controller = rpctl.Controller(robot, "circle", period=0.01)
    for side, (short, y) in product((1.0, -1.0), ((0.0, -radius), (1e-9, 0.0))):
        roll = side * (0.5 * np.pi - short)
        q[3:7] = [np.sin(0.5 * roll), 0.0, 0.0, np.cos(0.5 * roll)]
        assert robot.base_pose(q)[:2] == pytest.approx([0.0, side * y], abs=1e-3)
        assert np.isfinite(robot.seen(q)).all()
        controller.reset()
        assert np.isfinite(controller.step(0.0, q, np.zeros(robot.dof)).efforts).all()
