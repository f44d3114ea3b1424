"""Waypoints: a smooth curve through them, no sharper and no faster than allowed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import DescriptionError, RpctlError
from rpctl.reference.limits import Limits, wheel_rates
from rpctl.reference.load import load_reference
from rpctl.reference.path_reference import TimedPath, along
from rpctl.reference.planned.curve import Waypoint, curve_through
from rpctl.reference.planned.waypoints import SLALOM, along_waypoints
from rpctl.reference.splines import basis, basis_at, clamped_knots

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
    twist = along(path, np.linspace(0.0, end, 3000))[:, 0]
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


@pytest.fixture(scope="module", params=["tiago", "mecanum"])
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
