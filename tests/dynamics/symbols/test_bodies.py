"""The frames in which bodies are computed: they are the file's, moved along and about the axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import rpctl
from rpctl import Robot
from rpctl.dynamics.symbols.bodies import (
    euler_angles,
    moving_bodies,
    pose_of,
    rotation,
)
from rpctl.kernels.scalars import exact
from rpctl.robot.coordinates import ROOT_JOINT
from tests import random_vehicles
from tests.robots import write

ROUNDING = 1e-15


@pytest.mark.parametrize("lean", [0.0, 1e-16, 3e-16, 1e-15, 1e-12, 1e-7, 1e-3, 1.0])
@pytest.mark.parametrize("upside_down", [False, True])
def test_angles_of_axes_that_are_nearly_parallel(
    lean: float, upside_down: bool, rng: np.random.Generator
) -> None:
    for _ in range(10):
        tilt = Rotation.from_rotvec(lean * np.append(rng.normal(size=2), 0.0))
        turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        over = Rotation.from_rotvec([np.pi if upside_down else 0.0, 0.0, 0.0])
        R = (tilt * turn * over).as_matrix()
        angles = euler_angles(pose_of(R, rng.normal(size=3)))
        np.testing.assert_allclose(rotation(*map(exact, angles)), R, rtol=0, atol=ROUNDING)


def placed(robot: Robot) -> None:
    """Compare each body's pose at position 0 with Pinocchio's, and its axis."""
    bodies, data = moving_bodies(robot), robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    poses = [np.eye(4)]
    for body in bodies[1:]:
        poses.append(poses[body.parent] @ body.pose)
    reach = max(float(np.abs(pose[:3, 3]).max()) for pose in poses)
    for i, (body, pose) in enumerate(zip(bodies, poses, strict=True), start=ROOT_JOINT):
        truth = data.oMi[i].homogeneous @ body.frame
        np.testing.assert_allclose(pose, truth, rtol=0, atol=1e-14 * (1.0 + reach))
        if i > ROOT_JOINT:
            subspace = robot.model.joints[i].createData().S.ravel()
            axis = subspace[:3] if body.slides else subspace[3:]
            np.testing.assert_allclose(body.frame[:3, 2], axis, rtol=0, atol=ROUNDING)
            assert body.index == robot.velocity_index(body.joint)


def test_axes_that_are_nearly_parallel_send_no_origin_far_away(tmp_path: Path) -> None:
    """A wheel's fork leans by a millionth of a radian: the common point of both axes is far off."""
    robot = rpctl.load(write(tmp_path, random_vehicles.vehicle("tricycle", 101)[0]))
    placed(robot)
    assert max(np.abs(body.p).max() for body in moving_bodies(robot)) < 10.0


def test_the_next_body_is_reached_by_few_numbers(mixed_chain: Robot) -> None:
    """Behind a joint that turns, it takes a tilt and an origin without z."""
    bodies = moving_bodies(mixed_chain)
    for body in bodies[1:]:
        carrier = bodies[body.parent]
        if carrier.entry is not None and not (carrier.slides or body.slides):
            assert body.yaw == (1.0, 0.0) and abs(body.p[2]) < ROUNDING
        if body.slides:
            assert np.abs(body.p).max() < ROUNDING
