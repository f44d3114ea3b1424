"""Waypoints and end-effector paths: met by a base that does not slide, as fast as allowed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, summarize
from rpctl.errors import DescriptionError, RpctlError
from rpctl.reference.load import SLALOM, along_goal, along_waypoints, load_reference
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.paths import basis, basis_at, clamped_knots
from rpctl.reference.planned.arm import Arm
from rpctl.reference.planned.curve import Goal, Waypoint, curve_through, polyline
from rpctl.reference.planned.reach import END_EFFECTOR_TOLERANCE, plan_reach
from rpctl.reference.planned.reach_problem import DrivingBase
from rpctl.reference.sizing import Limits, robot_length, wheel_rates
from tests.grids import cells

POINTS = [Waypoint(*row) for row in SLALOM]


def test_the_curve_meets_waypoints_and_headings() -> None:
    points = [Waypoint(0, 0, 0.3), Waypoint(2, 1), Waypoint(3, -1, -1.0), Waypoint(5, 0, 0.0)]
    path, end = curve_through(points)
    poses = np.array([path(s).pose for s in np.linspace(0.0, end, 4001)])
    for point in points:
        nearest = int(np.hypot(poses[:, 0] - point.x, poses[:, 1] - point.y).argmin())
        assert math.hypot(poses[nearest, 0] - point.x, poses[nearest, 1] - point.y) < 2e-3
        if point.heading is not None:
            assert poses[nearest, 2] == pytest.approx(point.heading, abs=5e-3)


@pytest.mark.parametrize("radius", [0.3, 0.45])
def test_the_curve_is_no_sharper_than_allowed(radius: float) -> None:
    path, end = curve_through(POINTS, radius)
    twist = path(np.linspace(0.0, end, 3000)).twist[:, 0]
    assert twist[:, 0].min() > 0.1
    assert not twist[:, 1].any()
    assert np.abs(twist[:, 2] / twist[:, 0]).max() < 1.01 / radius


def test_two_waypoints_make_a_straight_line() -> None:
    path, end = curve_through([Waypoint(0, 0), Waypoint(3, 4)])
    assert end == 5.0
    np.testing.assert_allclose(path(2.5).pose, [1.5, 2.0, math.atan2(4, 3)], atol=1e-9)


@pytest.mark.parametrize(
    ("points", "radius", "told"),
    [
        ([(0, 0)], 0, "1 waypoints; give two or more"),
        ([(0, 0), (1, 0), (1, 0), (2, 0)], 0, "waypoint 3 repeats waypoint 2"),
        ([(0, 0), (1, 0), (0.1, 0.01)], 0, "waypoint 2 turns the path back by 179 degrees"),
        ([(0, 0), (1, 0), (1, 1)], 5.0, "waypoint [13]: near it the path bends with a radius of"),
    ],
)
def test_what_no_curve_can_pass_is_told(
    points: list[tuple[float, float]], radius: float, told: str
) -> None:
    with pytest.raises(RpctlError, match=told):
        curve_through([Waypoint(*point) for point in points], radius)


@pytest.fixture(scope="module", params=["paper", "mecanum"])
def driven(request: pytest.FixtureRequest) -> tuple[Robot, TimedPath]:
    robot = rpctl.load(request.param)
    return robot, along_waypoints(robot, POINTS, Limits())


def test_limits_are_kept_and_used(driven: tuple[Robot, TimedPath]) -> None:
    robot, reference = driven
    limits = Limits()
    states = [reference(t) for t in np.linspace(0.0, reference.duration, 1500)]
    twist = np.array([state.twist for state in states])
    change = np.array([state.twist_dot for state in states])
    shares = {
        "speed": np.abs(twist[:, 0]) / limits.speed,
        "acceleration": np.abs(change[:, 0]) / limits.acceleration,
        "turning": np.abs(twist[:, 2]) / limits.turning_speed,
        "turning acceleration": np.abs(change[:, 2]) / limits.turning_acceleration,
        "lateral": np.abs(twist[:, 0] * twist[:, 2]) / limits.lateral_acceleration,
    }
    for row, wheel in zip(wheel_rates(robot), robot.drive.wheels, strict=True):
        shares[wheel.joint] = np.abs(twist @ row) / robot.description.joint[wheel.joint].velocity
    for name, share in shares.items():
        assert share.max() <= 1.0, name
    most = np.max(list(shares.values()), axis=0)
    assert np.median(most) > 0.8  # it dawdles nowhere


def test_a_fixed_base_goes_nowhere() -> None:
    with pytest.raises(RpctlError, match="panda has a fixed base"):
        load_reference(rpctl.load("panda"), "waypoints")


FAULTS = {
    "waypoints = [[0, 0]]": "1 waypoints; give two or more",
    "waypoints = 3": "waypoints: is 3; give some numbers",
    "waypoints = [[0, 0], [1]]": r"waypoints are \[x, y\] or \[x, y, heading\]",
    "waypoints = [[0, 0], [1, nan]]": r"waypoints\[2\]\[2\]: is nan; give a finite number",
    "waypoints = [[0, 0], [1e9, 0]]": "farther than 10000 m; use metres",
    "waypoints = [[0, 0], [1, true]]": "waypoints: is True; give a number",
    "waypoints = [[0, 0], [0, 0]]": "waypoint 2 repeats waypoint 1",
    "end_effector = [[0, 0], [1, 0]]": r"end_effector: is \[0, 0\]; give 3 numbers",
    "speed = 2": "setting 'speed' is not known(.|\n)*give either waypoints",
    "waypoints = [[0, 0], [1, 0]]\n[limits]\nspeed = -1": "speed is -1; give a positive number",
    "waypoints = [[0, 0], [1, 0]]\n[limits]\nsped = 1": "setting 'sped' is not known; did you mean",
    "waypoints = [[0, 0], [1, 0]]\ncorner = 0": "corner is 0; give metres, more than 0",
    "end_effector = [[1, 0, 1], [1.1, 0, 1]]": "points 1 and 2 are 0.1 m apart",
    "end_effector = [[1, 0, 1]]": "1 points; give two or more",
    "end_effector = [[1, 0, 1], [1, 0, 1]]": "point 2 repeats point 1",
}


@pytest.mark.parametrize("text", FAULTS)
def test_bad_path_files_are_told(text: str, tmp_path: Path, paper: Robot) -> None:
    path = tmp_path / "path.toml"
    path.write_text(text)
    with pytest.raises(DescriptionError, match=f"path.toml(:[123])?: error: (.|\n)*{FAULTS[text]}"):
        load_reference(paper, str(path))


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_sparse_basis_is_the_dense_one(order: int) -> None:
    rng = np.random.default_rng(order)
    knots = clamped_knots(np.cumsum(rng.uniform(0.1, 2.0, 12)))
    points = np.concatenate([knots[5:-5], rng.uniform(knots[0], knots[-1], 20)])
    dense = basis(knots).derivative(order)(points) if order else basis(knots)(points)
    np.testing.assert_allclose(basis_at(knots, points, order).toarray(), dense, atol=1e-9)


def test_a_path_of_days_is_refused(tmp_path: Path, paper: Robot) -> None:
    path = tmp_path / "path.toml"
    path.write_text("waypoints = [[0, 0], [9999, 0]]\n[limits]\nspeed = 0.1")
    with pytest.raises(DescriptionError, match=r"takes 1e\+05 s at these limits, and 86400 s are"):
        load_reference(paper, str(path))


ROBOTS = ["tiago", "paper", "mixed_chain", "mecanum", "skid_steer", "panda"]


def off(goal: Goal, points: np.ndarray) -> float:
    """Return the largest distance of points (K, 3) from a goal's path, m."""
    path = goal.position(np.linspace(goal.start, goal.end, 20001))
    return max(float(np.linalg.norm(path - point, axis=1).min()) for point in points)


@pytest.fixture(scope="module", params=cells(ROBOTS, ("panda",), ("tiago",)))
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


@pytest.mark.slow
@pytest.mark.parametrize("side", [2])
def test_a_turning_radius_is_kept(tiago: Robot, side: float) -> None:
    goal = polyline([[0.8, 0, 0.8], [3, 0, 0.8], [3, side, 0.8]], 0.15)
    radius = 0.9
    path, _ = plan_reach(tiago, goal, Limits(turning_radius=radius))
    twist = path(np.linspace(goal.start, goal.end, 500)).twist[:, 0]
    assert twist[:, 0].min() > 0.0
    assert np.abs(twist[:, 2] / twist[:, 0]).max() <= 1.0 / radius
    assert np.abs(twist[:, 2] / twist[:, 0]).max() > 0.5 / radius


@pytest.mark.slow
def test_the_base_stays_where_the_arm_alone_reaches(tiago: Robot) -> None:
    reference = along_goal(tiago, polyline([[5, 5, 0.8], [5, 5.3, 0.9]], 0.1), Limits())
    poses = np.array([reference(t).pose for t in np.linspace(0, reference.duration, 20)])
    assert np.ptp(poses, axis=0).max() < 1e-14  # a polynomial of one value rounds
    assert 0.2 < math.hypot(5 - poses[0, 0], 5 - poses[0, 1]) < 1.2


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["mixed_chain", "mecanum"])
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
    run = rpctl.track(tiago, "ee-square", duration=8.0)  # round its first corner
    figures = summarize(run)
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
