"""The rolling constraint: what it says of the wheels, and its drift."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rpctl import Robot
from rpctl.arrays import Array
from rpctl.dynamics.rolling import constraint, constraint_drift, contact_point, find_rolling


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
        assert constraint_drift(rolling, q, v) == pytest.approx(rate, abs=1e-7)


def test_wheels_touch_the_ground(robot: Robot, rng: np.random.Generator) -> None:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.random_configuration(rng))
    left, right = (contact_point(robot, data, w) for w in robot.drive.wheels)
    np.testing.assert_allclose([left[2], right[2]], robot.drive.ground, atol=1e-9)
    assert np.linalg.norm(left - right) == pytest.approx(robot.drive.track)
