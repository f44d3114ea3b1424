"""The projection at q: what S, the drift, A and B must be, also near singular steering."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.rolling import (
    basis,
    constraint,
    contact_point,
    find_rolling,
    selection,
)
from rpctl.errors import SingularBasisError
from tests import random_vehicles
from tests.robots import SET_A, free_caster, platform, write
from tests.vehicles import vehicle

KINDS = ["casters", "car-like", "tied", "tricycle", "bicycle", "steered"]
SINGULAR = {  # steering angles at which the wheels leave no one motion, rad
    "bicycle": {"steer": np.pi / 2},
    "steered": {"fl_steer": np.pi / 2, "rl_steer": np.pi / 2},
    "twin": {"fl_steer": np.pi / 2, "rl_steer": np.pi / 2},
}
NEAR = (1e-1, 1e-3, 1e-5, 1e-7)  # rad off them
ROUNDING = 1e-13


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind), f"{kind}.urdf"))


States = list[tuple[str, Robot, Array, Array]]


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> States:
    """Random vehicles at random states, then some whose steering is nearly singular."""
    found, folder, rng = [], tmp_path_factory.mktemp("states"), np.random.default_rng(20210601)
    for kind in KINDS:
        for seed in range(2):
            robot = rpctl.load(write(folder, random_vehicles.vehicle(kind, seed)[0]))
            q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
            found.append((f"{kind} {seed}", robot, q, nu))
    for kind, angles in SINGULAR.items():
        robot = load(folder, kind)
        for off in NEAR:
            near = {name: angle + off * rng.uniform(0.5, 1.0) for name, angle in angles.items()}
            q = robot.configuration(0.2, -0.3, 0.5, joints=near)
            found.append((f"{kind} {off:g}", robot, q, rng.normal(size=robot.dof)))
    return found


def test_it_solves_the_equations_of_the_whole_tree(states: States) -> None:
    """[A; W] S = [0; I] and [A; W] Ṡν = −[Ȧv; 0], with all rows and all columns."""
    for name, robot, q, nu in states:
        dynamics = ReducedDynamics(robot)
        at, rolling = dynamics.at(q), dynamics.rolling
        A, W = constraint(rolling, q), selection(robot, rolling)
        size = np.abs(at.S).max()
        np.testing.assert_allclose(A @ at.S, 0.0, atol=ROUNDING * size, err_msg=name)
        np.testing.assert_allclose(W @ at.S, np.eye(robot.dof), atol=ROUNDING * size, err_msg=name)
        drift, turned = at.drift(nu), rolling.drift(rolling.turn(q), at.S @ nu)
        size = max(1.0, np.abs(drift).max(), np.abs(turned).max())
        np.testing.assert_allclose(A @ drift, -turned, atol=ROUNDING * size, err_msg=name)
        np.testing.assert_allclose(W @ drift, 0.0, atol=ROUNDING * size, err_msg=name)


def test_the_drift_is_the_rate_of_the_basis(states: States) -> None:
    """Along the motion, over a small part of the time in which it changes."""
    for name, robot, q, nu in states:
        dynamics = ReducedDynamics(robot)
        at = dynamics.at(q)
        v, drift = at.S @ nu, at.drift(nu)
        step = 5e-4 * min(1.0, float(np.abs(v).max() / np.abs(drift).max()))
        ahead, behind = (
            dynamics.basis(pin.integrate(robot.model, q, s * v)) @ nu for s in (step, -step)
        )
        rate = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(drift, rate, atol=1e-5 * np.abs(rate).max(), err_msg=name)


@pytest.mark.parametrize("kind", SINGULAR)
def test_at_the_singularity_the_angles_are_named(tmp_path: Path, kind: str) -> None:
    robot = load(tmp_path, kind)
    dynamics = ReducedDynamics(robot)
    q = robot.configuration(joints=SINGULAR[kind])
    for _ in range(2):  # a projection that failed is not kept
        with pytest.raises(SingularBasisError, match=r"determine the motion: .*steer at 90°"):
            dynamics.at(q)
    with pytest.raises(SingularBasisError, match="steer at nan°"):
        dynamics.at(np.full(robot.nq, np.nan))


def test_a_caster_without_a_trail_is_refused(tmp_path: Path) -> None:
    """Nothing turns it; that is said where the motion is asked for, with its joint."""
    robot = load(tmp_path, "casters")
    drive = robot.drive
    straight = (replace(drive.swivels[0], trail=0.0), *drive.swivels[1:])
    dynamics = ReducedDynamics(replace(robot, drive=replace(drive, swivels=straight)))
    with pytest.raises(SingularBasisError, match="determine the motion: caster_0 at 0°"):
        dynamics.at(robot.configuration())


def test_where_nothing_turns_it_is_the_same_everywhere(
    paper: Robot, rng: np.random.Generator
) -> None:
    dynamics = ReducedDynamics(paper)
    at = dynamics.at(paper.configuration())
    assert dynamics.constant
    assert dynamics.at(paper.random_configuration(rng)) is at
    np.testing.assert_array_equal(at.drift(rng.normal(size=4)), np.zeros(paper.nv))
    np.testing.assert_array_equal(at.A, dynamics.rolling.matrix.constant)


def test_casters_that_glide(tmp_path: Path, rng: np.random.Generator) -> None:
    """They and their wheels stand still, the ground holds nothing of them, all else is as it was.

    So nothing turns any more on a differential drive.
    """
    robot = load(tmp_path, "casters")
    casters = [swivel.joint for swivel in robot.drive.idle_casters]
    rolling, gliding = ReducedDynamics(robot), ReducedDynamics(robot, gliding=casters)
    assert gliding.constant
    assert not rolling.constant
    q = robot.random_configuration(rng)
    still = [s.joint for s in robot.drive.swivels]
    still += [wheel.joint for wheel in robot.drive.wheels if wheel.swivel is not None]
    index = [robot.velocity_index(name) for name in still]
    others = np.delete(np.arange(robot.nv), index)
    S = gliding.at(q).S
    np.testing.assert_array_equal(S[index], 0.0)
    np.testing.assert_allclose(S[others], rolling.at(q).S[others], atol=ROUNDING)
    force = rng.normal(size=robot.nv)
    held = list(gliding.rolling.gliding)
    assert len(held) == len(still)
    lambdas = gliding.at(q).multipliers @ force
    np.testing.assert_array_equal(lambdas[held], 0.0)
    rest = np.delete(np.arange(len(lambdas)), held)
    A = gliding.at(q).A[rest]
    np.testing.assert_allclose(lambdas[rest], np.linalg.pinv(A.T) @ force, atol=1e-9)


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
    with pytest.raises(SingularBasisError, match="determine the motion"):
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


def contact_velocities(robot: Robot, q: Array, v: Array) -> Array:
    """Return the velocity (n_wheels, 3) of the wheels' lowest material points, by differences.

    The point of the rim that touches the ground now is followed with its wheel over a short time.
    """
    step = 1e-6
    now, ahead, behind = (robot.model.createData() for _ in range(3))
    for data, time in ((now, 0.0), (ahead, step), (behind, -step)):
        pin.forwardKinematics(robot.model, data, pin.integrate(robot.model, q, time * v))
    velocities = []
    for wheel in robot.drive.wheels:
        joint = robot.model.getJointId(wheel.joint)
        centre = now.oMi[joint].act(wheel.offset * np.array(wheel.axis))
        rim = now.oMi[joint].actInv(centre - np.array([0.0, 0.0, wheel.radius]))
        velocities.append((ahead.oMi[joint].act(rim) - behind.oMi[joint].act(rim)) / (2 * step))
    return np.array(velocities)


def test_rows_are_the_contact_points_velocity(robot: Robot, rng: np.random.Generator) -> None:
    """One row a wheel, along the heading, and one that P does not move sideways."""
    rolling, step = find_rolling(robot), 1e-6
    for _ in range(10):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        *along, across = constraint(rolling, q) @ v
        heading = robot.base_pose(q)[2]
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        moved = contact_velocities(robot, q, v)
        np.testing.assert_allclose(along, moved @ forward, atol=1e-8)
        np.testing.assert_allclose(moved[:, 2], 0.0, atol=1e-8)
        ahead, behind = (
            robot.base_pose(pin.integrate(robot.model, q, s * v))[:2] for s in (step, -step)
        )
        left = np.array([-forward[1], forward[0]])
        assert across == pytest.approx((ahead - behind) @ left / (2 * step), abs=1e-7)


def test_the_drift_is_the_rows_rate(robot: Robot, rng: np.random.Generator) -> None:
    rolling, step = find_rolling(robot), 1e-6
    for _ in range(10):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        ahead, behind = (
            constraint(rolling, pin.integrate(robot.model, q, s * v)) for s in (step, -step)
        )
        rate = (ahead - behind) @ v / (2 * step)
        assert rolling.drift(rolling.turn(q), v) == pytest.approx(rate, abs=1e-7)


def test_wheels_touch_the_ground(robot: Robot, rng: np.random.Generator) -> None:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.random_configuration(rng))
    left, right = (contact_point(robot, data, w) for w in robot.drive.wheels)
    np.testing.assert_allclose([left[2], right[2]], robot.drive.ground, atol=1e-9)
    assert np.linalg.norm(left - right) == pytest.approx(robot.drive.track)
