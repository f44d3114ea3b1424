"""End-effector paths: met to the millimetre, by a base that does not slide and keeps limits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, summarize
from rpctl.errors import RpctlError
from rpctl.reference.limits import Limits, wheel_rates
from rpctl.reference.load import load_reference
from rpctl.reference.path_reference import TimedPath, along
from rpctl.reference.planned.arm import Arm
from rpctl.reference.planned.curve import Goal, polyline
from rpctl.reference.planned.reach import END_EFFECTOR_TOLERANCE, plan_reach
from rpctl.reference.planned.reach_problem import DrivingBase
from rpctl.reference.planned.waypoints import along_goal
from rpctl.reference.sizing import robot_length
from rpctl.reference.splines import clamped_knots
from tests.grids import cells

ROBOTS = ["tiago", "paper", "mixed_chain", "mecanum", "skid_steer", "panda"]


def off(goal: Goal, points: np.ndarray) -> float:
    """Return the largest distance of points (K, 3) from a goal's path, m."""
    path = goal.position(np.linspace(goal.start, goal.end, 20001))
    return max(float(np.linalg.norm(path - point, axis=1).min()) for point in points)


@pytest.fixture(scope="module", params=cells(ROBOTS, ("tiago", "panda")))
def square(request: pytest.FixtureRequest) -> tuple[Robot, TimedPath]:
    robot = rpctl.load(request.param)
    reference = load_reference(robot, "ee-square")
    assert isinstance(reference, TimedPath)
    return robot, reference


def test_the_end_effector_draws_a_square(square: tuple[Robot, TimedPath]) -> None:
    robot, reference = square
    arm = Arm(robot)
    states = [reference(t) for t in np.linspace(0.0, reference.duration, 300)]
    points = np.array(
        [arm.end_effector_pose(s.pose, s.joints[arm.joints]).translation for s in states]
    )
    low, side = points.min(axis=0), float(np.ptp(points[:, 0]))
    assert np.ptp(points[:, 1]) == pytest.approx(side, abs=2 * END_EFFECTOR_TOLERANCE)
    assert np.ptp(points[:, 2]) < END_EFFECTOR_TOLERANCE
    corners = low + side * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
    assert (
        off(polyline(corners.tolist(), min(0.15, 0.25 * side)), points)
        < END_EFFECTOR_TOLERANCE + 1e-3
    )


def test_limits_are_kept_and_nothing_slides(square: tuple[Robot, TimedPath]) -> None:
    robot, reference = square
    limits, arm = Limits(), Arm(robot)
    rates, place = wheel_rates(robot), []
    for t in np.linspace(0.0, reference.duration, 800):
        state = reference(t)
        place.append(arm.end_effector_pose(state.pose, state.joints[arm.joints]).translation)
        assert math.hypot(*state.twist[:2]) <= limits.speed
        assert abs(state.twist[2]) <= limits.turning_speed
        assert np.abs(state.twist_dot[:2]).max() <= limits.acceleration
        for rate, wheel in zip(rates @ state.twist, robot.drive.wheels, strict=True):
            assert abs(rate) <= robot.description.joint[wheel.joint].velocity
        if robot.drive.has_axle:
            assert state.twist[1] == 0.0
        moved = zip(robot.joints, state.joints, state.joint_rates, strict=True)
        for joint, position, rate in moved:
            assert joint.lower <= position <= joint.upper
            assert abs(rate) <= joint.velocity
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) * 799 / reference.duration
    pace = math.sqrt(robot_length(robot)) * limits.end_effector_speed
    assert speed.max() <= 1.001 * pace
    if robot.drive.base_speeds:  # a fixed arm's square is too small to gather speed
        assert speed.max() > 0.9 * pace


@pytest.mark.parametrize("side", [2])
def test_a_turning_radius_is_kept(tiago: Robot, side: float) -> None:
    goal = polyline([[0.8, 0, 0.8], [3, 0, 0.8], [3, side, 0.8]], 0.15)
    radius = 0.9
    path, _ = plan_reach(tiago, goal, Limits(turning_radius=radius))
    twist = along(path, np.linspace(goal.start, goal.end, 500))[:, 0]
    assert twist[:, 0].min() > 0.0
    assert np.abs(twist[:, 2] / twist[:, 0]).max() <= 1.0 / radius
    assert np.abs(twist[:, 2] / twist[:, 0]).max() > 0.5 / radius


def test_the_base_stays_where_the_arm_alone_reaches(tiago: Robot) -> None:
    reference = along_goal(tiago, polyline([[5, 5, 0.8], [5, 5.3, 0.9]], 0.1), Limits())
    poses = np.array([reference(t).pose for t in np.linspace(0, reference.duration, 20)])
    assert not np.ptp(poses, axis=0).any()
    assert 0.2 < math.hypot(5 - poses[0, 0], 5 - poses[0, 1]) < 1.2


def test_out_of_reach_is_told_from_where_on_and_how_far(tiago: Robot) -> None:
    goal = polyline([[0.8, 0, 0.8], [2, 0, 0.8], [4, 0, 3.0]], 0.15)
    with pytest.raises(RpctlError, match=r"from (\d\.\d+) m .* by up to 1\.\d m at 4") as told:
        plan_reach(tiago, goal, Limits())
    assert "wrist_ft_tool_link" in str(told.value)


def test_an_arm_is_needed(tiago: Robot) -> None:
    import dataclasses

    bare = dataclasses.replace(tiago, end_effector=None)
    with pytest.raises(RpctlError, match="tiago has no arm"):
        load_reference(bare, "ee-square")


def test_base_motions_know_their_jacobian() -> None:
    s = np.linspace(0.0, 3.0, 31)
    knots = clamped_knots(np.linspace(0.0, 3.0, 6))
    for columns in ([0, 2], [0, 1, 2]):
        base = DrivingBase(s, knots, columns)
        z = np.random.default_rng(3).normal(size=base.size)
        _, jacobian = base.poses(z)
        for i in range(base.size):
            step = 1e-6 * np.eye(base.size)[i]
            change = (base.poses(z + step)[0] - base.poses(z - step)[0]) / 2e-6
            np.testing.assert_allclose(change, jacobian[:, :, i], atol=1e-7)
        path, poses = base.path(z), base.poses(z)[0]
        np.testing.assert_allclose([path(x).pose for x in s], poses, atol=1e-9)


@pytest.mark.parametrize("name", ["tiago", "mecanum"])
def test_jacobians_are_differences(name: str) -> None:
    arm = Arm(rpctl.load(name))
    rng = np.random.default_rng(5)
    pose, q = rng.normal(size=3), rng.uniform(arm.lower, arm.upper)
    _, base, joints = arm.jacobian(pose, q)
    for jacobian, at in ((base, 0), (joints, 1)):
        for i in range(jacobian.shape[1]):
            step = 1e-6 * np.eye(jacobian.shape[1])[i]
            ahead, behind = (
                arm.end_effector_pose(*((pose + d, q) if at == 0 else (pose, q + d))).translation
                for d in (step, -step)
            )
            np.testing.assert_allclose((ahead - behind) / 2e-6, jacobian[:3, i], atol=1e-7)


@pytest.mark.slow
def test_tiago_tracks_a_square_with_its_end_effector(tiago: Robot) -> None:
    run = rpctl.track(tiago, "ee-square")
    figures = summarize(run)
    assert run.t[-1] > 20.0
    assert (figures.rms_end_effector_error or np.inf) < 3e-4
    assert (figures.settled_end_effector_error or np.inf) < 1e-3
    assert not figures.limits_violated


def test_a_file_gives_points(tmp_path: Path, paper: Robot) -> None:
    path = tmp_path / "line.toml"
    path.write_text(
        "end_effector = [[1.2, 0, 0.7], [4, 0, 0.7]]\n[limits]\nend_effector_speed = 0.1"
    )
    reference = load_reference(paper, str(path))
    assert isinstance(reference, TimedPath)
    assert 28.0 < reference.duration < 31.0
    end = reference(100.0)
    arm = Arm(paper)
    np.testing.assert_allclose(
        arm.end_effector_pose(end.pose, end.joints).translation, [4, 0, 0.7], atol=1e-6
    )
