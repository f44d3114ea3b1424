"""References to a goal: they begin and end where they say, at rest, by ways that the drive has."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.cli.track import ConfigOptions, reference_label
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference.load import load_reference
from rpctl.reference.pose_goal import (
    PoseGoal,
    goal_of_words,
    legs_between,
    read_goal,
    seen_from,
    to_goal,
)
from rpctl.reference.sizing import Limits, steerable_radius

URDF = Path(__file__).parents[2] / "urdf"
START = np.array([0.4, -0.7, 2.5])
GOALS = {
    "differential": [(2.0, 0.0, 0.0), (-1.0, 0.2, 0.1), (0.5, -1.5, 3.0), (0.0, 0.0, -2.0)],
    "any": [(2.0, 0.0, 0.0), (-1.0, 0.2, 0.1), (0.5, -1.5, 3.0), (0.0, 0.0, -2.0)],
    "steered": [(2.5, 0.0, 0.0), (3.0, 1.0, 0.5), (-3.0, 1.0, -0.5)],
}
KINDS = {"paper": "differential", "mecanum": "any", "swerve": "any", "car": "steered",
         "bicycle": "steered"}  # fmt: skip
CASES = [(name, goal) for name, kind in KINDS.items() for goal in GOALS[kind]]


def placed(start: Array, goal: tuple[float, float, float]) -> Array:
    """Return a pose given in the axes of another one in the world."""
    x, y, turn = goal
    cos, sin = math.cos(start[2]), math.sin(start[2])
    return start + np.array([cos * x - sin * y, sin * x + cos * y, turn])


@pytest.mark.parametrize(("name", "goal"), CASES)
def test_base_gets_to_its_goal_and_the_twist_is_the_motion(
    name: str, goal: tuple[float, float, float]
) -> None:
    """Central differences of poses and twists, so that a wrong sign anywhere shows."""
    robot = rpctl.load(URDF / f"{name}.urdf")
    there = placed(START, goal)
    reference = to_goal(robot, PoseGoal(tuple(there)), START)
    begin, end = reference(0.0), reference(reference.duration)
    assert seen_from(START, begin.pose) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert seen_from(there, end.pose) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    for state in (begin, end, reference(reference.duration + 1.0)):
        assert np.abs([state.twist, state.twist_dot]).max() < 1e-9
    step, sideways = 1e-5, 0.0
    for t in np.linspace(0.0, reference.duration, 40)[1:-1]:
        before, state, after = reference(t - step), reference(t), reference(t + step)
        moved = np.array(seen_from(state.pose, after.pose)) - seen_from(state.pose, before.pose)
        assert moved / (2.0 * step) == pytest.approx(state.twist, abs=1e-6)
        change = (after.twist - before.twist) / (2.0 * step)
        assert change == pytest.approx(state.twist_dot, abs=1e-4)
        sideways = max(sideways, abs(state.twist[1]))
        if robot.drive.steered and robot.drive.has_axle:
            bend = abs(state.twist[2]) * steerable_radius(robot)
            assert bend <= abs(state.twist[0]) + 1e-9
    assert (sideways > 0.05) == (not robot.drive.has_axle and abs(goal[1]) > 0.1)


def test_a_robot_drives_backwards_only_where_that_spares_a_turn() -> None:
    """Straight back without turning; but to the side it turns and looks where it drives."""
    robot = rpctl.load("paper")
    speeds = []
    for goal in ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, math.pi)):
        legs = legs_between(robot, np.zeros(3), np.array(goal), Limits())
        speeds.append([path(0.0).direction[0, [0, 2]].tolist() for path, _ in legs])
    assert speeds[0] == [[-1.0, 0.0]]
    assert speeds[1] == [[1.0, 0.0]]
    assert speeds[2] == [[0.0, 1.0], [1.0, 0.0], [0.0, -1.0]]
    assert [leg[0] for leg in speeds[3] if leg[0]] == [1.0]


def test_wheels_steer_no_faster_than_is_comfortable() -> None:
    """All four, by differences of the angles along which their pivots move; one is nearly still."""
    robot = rpctl.load(URDF / "swerve.urdf")
    reference = to_goal(robot, PoseGoal((0.5, -0.5, 1.0)))
    times = np.linspace(0.02, 0.98, 400) * reference.duration
    fastest = []
    for swivel in robot.drive.swivels:
        x, y = swivel.pivot
        twists = np.array([reference(t).twist for t in times]) @ robot.root_velocity.T
        angles = np.unwrap(
            np.arctan2(twists[:, 1] + x * twists[:, 2], twists[:, 0] - y * twists[:, 2])
        )
        fastest.append(float(np.abs(np.gradient(angles, times)).max()))
    assert 0.3 < max(fastest) <= 0.5 * 1.02
    x, y = robot.drive.swivels[0].pivot  # halfway of the next one it stands still
    way = np.array([math.cos(0.75), math.sin(0.75)]) * 1.5
    about = [way[0] * y + way[1] * x, way[1] * y - way[0] * x]
    with pytest.raises(RpctlError, match="steer instantly"):
        to_goal(robot, PoseGoal((about[0], about[1], 1.5)))


def test_arm_goes_straight_to_its_goal_and_arrives_with_the_base(paper: Robot) -> None:
    posture = np.array([0.1, 0.2])
    goal = PoseGoal((2.0, 0.0, 0.0), {"arm_revolute_joint": 0.9})
    reference = to_goal(paper, goal, np.zeros(3), posture)
    ends = np.array([posture, [0.9, 0.2]])
    assert reference(0.0).joints == pytest.approx(ends[0])
    assert reference(reference.duration).joints == pytest.approx(ends[1])
    alone = to_goal(paper, PoseGoal(None, goal.joints), np.zeros(3), posture)
    assert alone.duration < reference.duration
    assert alone(alone.duration).pose == pytest.approx(np.zeros(3))
    step = 1e-5
    for motion in (alone, reference):
        late = motion(0.9 * motion.duration)
        assert 1e-6 < abs(late.joints - ends[1]).max() < 0.1  # not before, not after
        for t in np.linspace(0.1, 0.9, 7) * motion.duration:
            before, state, after = motion(t - step), motion(t), motion(t + step)
            rate = (after.joints - before.joints) / (2 * step)
            assert rate == pytest.approx(state.joint_rates, abs=1e-7)
            bend = (after.joint_rates - before.joint_rates) / (2 * step)
            assert bend == pytest.approx(state.joint_accelerations, abs=1e-5)


@pytest.mark.parametrize(
    ("robot", "goal", "message"),
    [
        ("car", PoseGoal((0.3, 1.0, 0.0)), r"does not get to \(0.3, 1\) m, 0 rad .* car-like"),
        ("ur5", PoseGoal((0.3, 1.0, 0.0)), "fixed base: give a goal for its arm only"),
        ("paper", PoseGoal((np.nan, 1.0, 0.0)), "finite numbers"),
        ("paper", PoseGoal((1e5, 1.0, 0.0)), "below 10000 m"),
        ("paper", PoseGoal(None, {"arm_revolute_joint": 99.0}), "99 is not within its limits"),
        ("paper", PoseGoal(None, {"arm_revolute_joint": np.nan}), "nan is not within its limits"),
        ("paper", PoseGoal(None, {"arm_revolut_joint": 0.1}), "did you mean arm_revolute_joint"),
    ],
)
def test_what_cannot_be_is_said(robot: str, goal: PoseGoal, message: str) -> None:
    loaded = rpctl.load(URDF / f"{robot}.urdf" if robot == "car" else robot)
    with pytest.raises(RpctlError, match=message):
        to_goal(loaded, goal)


def test_goal_is_read_as_it_is_written() -> None:
    goal = PoseGoal((1.5, -0.25, 3.0), {"lift": 0.1, "an arm's joint": -2.0})
    assert read_goal(str(goal)) == goal
    assert goal_of_words("1,2,0", ["a=1", "b=2"]) == "goal 1,2,0 a=1 b=2"
    assert goal_of_words(None, ["a=1"]) == "goal a=1"
    for bad in ("goal", "goal 1,2", "goal 1,2,3 4,5,6", "goal a=x", "goal 1,2,x"):
        with pytest.raises(RpctlError, match="write goal X,Y,THETA"):
            read_goal(bad)


def test_goal_is_a_reference_by_name(paper: Robot) -> None:
    reference = load_reference(paper, "goal 1,0,0 arm_revolute_joint=0.5")
    end = reference(1e3)
    assert end.pose == pytest.approx([1.0, 0.0, 0.0])
    assert end.joints[0] == pytest.approx(0.5)
    with pytest.raises(UnknownNameError, match="goal X,Y,THETA"):
        load_reference(paper, "nowhere")


def test_options_of_a_goal_are_its_reference() -> None:
    options = ConfigOptions(goal="-1,0.5,0", arm_goal=["lift=0.25"])
    assert options.read().run.reference == "goal -1,0.5,0 lift=0.25"
    assert ConfigOptions(arm_goal=["lift=0.25"]).read().run.reference == "goal lift=0.25"
    with pytest.raises(RpctlError, match="leave out --reference"):
        ConfigOptions(goal="1,0,0", named={"reference": "eight"}).read()
    labels = [reference_label(each) for each in ("goal 1,0.5,0 a=0.25", "eight", "a/my.path.toml")]
    assert labels == ["goal", "eight", "my.path"]
