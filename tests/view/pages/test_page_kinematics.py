"""The page's own kinematics beside Pinocchio's, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.reference.planned.arm import Arm
from rpctl.view.pages.robot_page import robot_page
from tests.view.chromium import opened
from tests.view.samples import write_gripper

ROBOTS = (pytest.param("tiago", marks=pytest.mark.slow), "ur5", "gripper", "balancer")
SAMPLES, SEED = 6, 3
Base = tuple[float, float, float]


@pytest.fixture(scope="module", params=ROBOTS)
def shown(
    request: pytest.FixtureRequest, browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Robot, Any]]:
    folder = tmp_path_factory.mktemp(request.param)
    robot = rpctl.load(write_gripper(folder) if request.param == "gripper" else request.param)
    page = folder / "page.html"
    page.write_text(robot_page(robot), encoding="utf-8")
    with opened(browser, page.as_uri()) as opened_page:
        yield robot, opened_page


def draw(robot: Robot, rng: np.random.Generator) -> tuple[Base, list[float], Array]:
    """Return a random base pose and positions of all joints, mimics following, and q."""
    x, y, heading = rng.uniform(-2.0, 2.0, 3).tolist()
    base = x, y, heading
    positions = dict.fromkeys(robot.moving_joint_names, 0.0)
    for name in positions:
        joint = robot.description.joint[name]
        low, high = max(joint.lower, -2.5), min(joint.upper, 2.5)
        positions[name] = float(rng.uniform(low, high))
    for joint in robot.mimics:
        assert joint.mimic is not None
        positions[joint.name] = joint.mimic.multiplier * positions[joint.mimic.joint]
        positions[joint.name] += joint.mimic.offset
    return base, list(positions.values()), robot.configuration(*base, joints=positions)


def matrix(pose: Any) -> Array:
    """Return a pose of the page as a matrix (4, 4)."""
    full = np.eye(4)
    full[:3, :3], full[:3, 3] = np.reshape(pose["R"], (3, 3)), pose["p"]
    return full


def test_poses_and_jacobian_are_pinocchios(shown: tuple[Robot, Any]) -> None:
    robot, page = shown
    rng, data = np.random.default_rng(SEED), robot.model.createData()
    frame = robot.model.getFrameId(str(robot.end_effector), pin.FrameType.BODY)
    for _ in range(SAMPLES):
        base, values, q = draw(robot, rng)
        found = page.evaluate(
            "([base, values]) => { const k = rpctl.kinematics; return { joints: "
            "k.joints(base, values), hand: k.hand(base, values), arm: k.arm, "
            "columns: k.jacobian(base, values).columns }; }",
            [base, values],
        )
        pin.forwardKinematics(robot.model, data, q)
        for j, pose in enumerate(found["joints"], 2):
            assert np.abs(matrix(pose) - data.oMi[j].homogeneous).max() < 1e-9
        wanted = robot.end_effector_pose(data, q).homogeneous
        assert np.abs(matrix(found["hand"]) - wanted).max() < 1e-9
        whole = pin.computeFrameJacobian(
            robot.model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        names = [robot.moving_joint_names[i] for i in found["arm"]]
        arm = Arm(robot)
        assert set(names) == {robot.joint_names[i] for i in arm.joints}
        for name, column in zip(names, found["columns"], strict=True):
            expected = whole[:, robot.velocity_index(name)].copy()
            for other in robot.mimics:
                if other.mimic is not None and other.mimic.joint == name:
                    expected += other.mimic.multiplier * whole[:, robot.velocity_index(other.name)]
            assert np.abs(expected - column).max() < 1e-9, name


def reach(page: Any, base: Base, values: list[float], target: Array) -> list[float]:
    answer: list[float] = page.evaluate(
        "([base, values, target]) => rpctl.kinematics.reach(base, values, target)",
        [base, values, target.tolist()],
    )
    return answer


def check_within(robot: Robot, values: list[float], before: list[float]) -> None:
    """Assert that a posture keeps the limits, its mimics follow, and only the arm has moved."""
    positions = dict(zip(robot.moving_joint_names, values, strict=True))
    for joint in robot.joints:
        assert joint.lower <= positions[joint.name] <= joint.upper, joint.name
    for joint in robot.mimics:
        assert joint.mimic is not None
        led = joint.mimic.multiplier * positions[joint.mimic.joint] + joint.mimic.offset
        assert positions[joint.name] == pytest.approx(led)
    arm = {*robot.joint_names, *(joint.name for joint in robot.mimics)}
    for name, old in zip(robot.moving_joint_names, before, strict=True):
        assert name in arm or positions[name] == old


def test_hand_reaches_what_it_can_within_limits(shown: tuple[Robot, Any]) -> None:
    """Targets that some posture has: one next to it starts there, and gets to them."""
    robot, page = shown
    rng, data = np.random.default_rng(SEED), robot.model.createData()
    for _ in range(SAMPLES):
        base, values, q = draw(robot, rng)
        target = robot.end_effector_pose(data, q).translation
        limits = [robot.description.joint[name] for name in robot.moving_joint_names]
        near = [
            float(np.clip(value + rng.uniform(-0.15, 0.15), joint.lower, joint.upper))
            for joint, value in zip(limits, values, strict=True)
        ]
        found = reach(page, base, near, target)
        check_within(robot, found, near)
        q = robot.configuration(
            *base, joints=dict(zip(robot.moving_joint_names, found, strict=True))
        )
        assert np.linalg.norm(robot.end_effector_pose(data, q).translation - target) < 1e-6
