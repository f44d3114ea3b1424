"""The law of tyres, and how fast contact points slip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from rpctl import Robot
from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.dynamics.rolling import contact_point, find_rolling
from rpctl.robot.load import load
from rpctl.simulation.plants.tyres import TyreLaw, contact_velocities
from tests import urdf
from tests.robots import SET_A, four_wheels, platform, write
from tests.vehicles import KINDS, vehicle

LAW = TyreLaw(friction=0.6, stiffness=20.0, creep_speed=0.01, rolling_resistance=0.02)


def draw(rng: np.random.Generator, count: int = 200) -> tuple[Array, Array]:
    """Return velocities (3, n) of contact points, from stuck to sliding, and rolling speeds."""
    velocity = rng.normal(size=(3, count)) * 10.0 ** rng.uniform(-5, 1, count)
    return velocity, LAW.rolling_speed(velocity[2])


def test_the_force_opposes_the_slip_and_stays_within_the_friction_circle(
    rng: np.random.Generator,
) -> None:
    velocity, rolling = draw(rng)
    force = LAW.grip(velocity, rolling).force
    size, speed = np.hypot(*force[:2]), np.hypot(*velocity[:2])
    assert (size <= LAW.friction * (1.0 + 1e-12)).all()
    np.testing.assert_allclose((force[:2] * velocity[:2]).sum(axis=0), size * speed, rtol=1e-12)
    assert (force[2] * velocity[2] >= 0.0).all()
    assert (np.abs(force[2]) <= LAW.rolling_resistance).all()


def test_the_force_is_that_of_the_brush() -> None:
    slip = np.array([0.0, 1e-6, 0.03, 0.0899999, 0.0900001, 5.0])  # 3 μ/C = .09
    rolling = np.full(6, 2.0)
    velocity = np.array([0.8 * slip * rolling, -0.6 * slip * rolling, np.zeros(6)])
    force = LAW.grip(velocity, rolling).force
    expected = [0.0, 20e-6, 0.6 * (1 - (2 / 3) ** 3), 0.6, 0.6, 0.6]
    np.testing.assert_allclose(force[0], 0.8 * np.array(expected), rtol=2e-5)
    np.testing.assert_allclose(force[1], -0.6 * np.array(expected), rtol=2e-5)


def test_slopes_are_the_derivatives_and_secants_are_no_less(rng: np.random.Generator) -> None:
    velocity, rolling = draw(rng)
    grip = LAW.grip(velocity, rolling)
    change = rng.normal(size=velocity.shape) * 1e-6 * np.abs(velocity).max(axis=0)
    ahead, behind = (LAW.grip(velocity + s * change, rolling).force for s in (1.0, -1.0))
    expected = np.einsum("ijn,jn->in", grip.slope, change)
    scale = np.abs(grip.secant * change).max(axis=0)
    np.testing.assert_allclose((0.5 * (ahead - behind) - expected) / scale, 0.0, atol=1e-5)
    for slope, secant in zip(np.moveaxis(grip.slope, 2, 0), grip.secant.T, strict=True):
        assert np.linalg.eigvalsh(np.diag(secant) - slope).min() >= -1e-12 * secant.max()
        assert np.linalg.eigvalsh(slope).min() >= -1e-12 * secant.max()
    np.testing.assert_allclose(grip.secant * velocity, grip.force, rtol=1e-12)


def material_velocity(robot: Robot, q: Array, v: Array, joint: str, contact: Array) -> Array:
    """Return the velocity (3,) of a wheel's material point at its contact, by Pinocchio."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v)
    index = robot.model.getJointId(joint)
    motion = pin.getVelocity(robot.model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return np.asarray(
        motion.linear + np.cross(motion.angular, contact - data.oMi[index].translation)
    )


def axle_and_contact(robot: Robot, q: Array, wheel: Wheel) -> tuple[Array, Array]:
    """Return a wheel's axle and its contact point in the world."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    placement = data.oMi[robot.model.getJointId(wheel.joint)]
    return placement.rotation @ np.array(wheel.axis), contact_point(robot, data, wheel)


@pytest.mark.parametrize("kind", [*KINDS, "skid-steer"])
def test_contact_points_move_as_those_of_the_tree(
    kind: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    robot = (
        four_wheels(tmp_path, kind)
        if kind == "skid-steer"
        else load(write(tmp_path, vehicle(kind)))
    )
    velocities = contact_velocities(robot, rolling := find_rolling(robot))
    for _ in range(3):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        along, left, spin = velocities.matrix.at(rolling.turn(q)).dot(v).reshape(3, -1)
        for i, wheel in enumerate(robot.drive.wheels):
            axle, contact = axle_and_contact(robot, q, wheel)
            speed = material_velocity(robot, q, v, wheel.joint, contact)
            forward = np.cross(axle, [0.0, 0.0, 1.0])
            rate = v[robot.velocity_index(wheel.joint)]
            sign = np.sign(spin[i] * -rate) or 1.0  # whether the axle points to the left
            assert abs(spin[i]) == pytest.approx(wheel.radius * abs(rate))
            assert along[i] == pytest.approx(sign * forward @ speed, abs=1e-9)
            expected = np.cross([0.0, 0.0, 1.0], sign * forward) @ speed
            one_way = robot.drive.type == "omni"
            assert left[i] == pytest.approx(0.0 if one_way else expected, abs=1e-9)


def test_mecanum_wheels_grip_along_the_roller_and_nowhere_else(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    robot = four_wheels(tmp_path, "mecanum")
    velocities = contact_velocities(robot, rolling := find_rolling(robot))
    q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
    slip, none, _ = velocities.matrix.at(rolling.turn(q)).dot(v).reshape(3, -1)
    np.testing.assert_array_equal(none, 0.0)
    for i, wheel in enumerate(robot.drive.wheels):
        _, contact = axle_and_contact(robot, q, wheel)
        roller = np.array([*wheel.direction, 0.0])
        root = np.array([[q[2], -q[3], 0.0], [q[3], q[2], 0.0], [0.0, 0.0, 1.0]])
        speed = material_velocity(robot, q, v, wheel.joint, contact)
        assert slip[i] == pytest.approx(roller @ root.T @ speed, abs=1e-9)
        np.testing.assert_allclose(velocities.along[:, i], wheel.direction, atol=1e-12)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_a_ball_has_no_grip_to_the_side_but_a_wheel_off_the_axle_has(
    shape: str, tmp_path: Path
) -> None:
    geometry = urdf.shape(
        'sphere radius="0.1"' if shape == "sphere" else 'cylinder radius="0.1" length="0.03"',
        rpy=urdf.ROUND,
    )
    third = urdf.link("third", urdf.inertial(0.5, (0.001, 0.001, 0.001)), geometry)
    hinge = urdf.joint("third_joint", "continuous", ("base", "third"), (0.5, 0, 0.1), (0, 1, 0))
    robot = load(write(tmp_path, platform(SET_A, extra=third + hinge)))
    wheel = robot.drive.wheels[2]
    assert wheel.joint == "third_joint"
    assert wheel.slides
    velocities = contact_velocities(robot, rolling := find_rolling(robot))
    q, v = robot.configuration(), np.zeros(robot.nv)
    v[2] = 2.0  # turns about the axle's middle, .5 m behind the third wheel
    _, left, _ = velocities.matrix.at(rolling.turn(q)).dot(v).reshape(3, -1)
    assert left[2] == pytest.approx(0.0 if shape == "sphere" else 1.0)
