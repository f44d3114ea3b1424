"""The exported controller on stand-ins of ROS: what topics, interfaces and faults make of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rpctl import Robot
from rpctl.derive.ros2_control import export_ros2_control
from tests.derive.ros2_control.builds import PLAIN, SANITIZED, Driven, driven

pytestmark = pytest.mark.slow  # it compiles a controller, 20 s

ROOT = "odom base_link"
AT_REST = "states" + 6 * " 0"
PERIOD = 0.002
HORIZON = 11.0 * 0.051 / 0.8  # s, h at this period
FORWARD, TURNING, ACCELERATION, SLIDE, SLIDE_RATE = 3, 5, 6, 19, 21  # of a reference


class Answer(NamedTuple):
    """What an update ends with."""

    done: bool
    status: int
    commands: Sequence[float]  # wheels, revolute and prismatic joint
    reference: Sequence[float]


@pytest.fixture(scope="module")
def controller(paper: Robot, tmp_path_factory: pytest.TempPathFactory) -> Driven:
    folder = tmp_path_factory.mktemp("ros") / "package"
    export_ros2_control(paper, folder)
    return driven(paper, folder, SANITIZED, "driver", PERIOD)


def answers(controller: Driven, *lines: str, before: str = "") -> tuple[list[Answer], str]:
    """Return what it answers to each ``update`` and ``show`` after it was activated."""
    start = [*before.splitlines(), "configure", "activate", AT_REST]
    said, complaints = controller.obey([*start, *lines])
    assert said[:2] == ["1", "1"]
    rows = [[float(word) for word in line.split()] for line in said[2:]]
    rows = [row for row in rows if len(row) > 1]
    return [Answer(row[0] == 1, int(row[1]), row[2:6], row[6:]) for row in rows], complaints


def here(t: float, x: float = 0.0) -> str:
    return f"odometry {t} {ROOT} {x} 0 0 0 0 0"


def test_at_rest_without_reference_it_stands(controller: Driven) -> None:
    (blind, placed), _ = answers(controller, "update 1 .002", here(1), "update 1 .002")
    assert (blind.status, placed.status) == (1, 0)
    assert blind.commands == placed.commands == [0, 0, 0, 0]
    assert np.isnan(placed.reference[:3]).all()


def test_a_twist_is_followed_within_its_accelerations(controller: Driven) -> None:
    """The first period's 2 mm/s at 1 m/s²: ν̇* = 1 + .002/h + .002/h1, h = .7 s, h1 = .15 s.

    At θ1 = 0 the slide of 2 kg needs 2 ν̇*, and the wheels share M_v ν̇* r.
    """
    lines = [here(1), "twist 1 .5 0 0", "update 1 .002", "update 1.51 .002"]
    (first, late), _ = answers(controller, *lines)
    rate = 1 + 0.002 / HORIZON + 0.002 / 0.15
    mass = 30 + 2 + 4 + 2 + 2 * 0.005 / 0.15**2
    wheel = mass * rate * 0.15 / 2
    np.testing.assert_allclose(first.commands, [wheel, wheel, 0, 2 * rate], rtol=1e-12, atol=1e-12)
    assert first.reference[FORWARD] == 0.5
    assert late.reference[FORWARD] == 0.0  # older than twist_timeout


def test_a_path_with_times_is_smooth_in_time(controller: Driven) -> None:
    """x = 0, 1, 2 at 2, 3, 4 s, at rest at both ends: 1.5 m/s in the middle."""
    poses = "2 0 0 0 3 1 0 0 4 2 0 0"
    lines = [f"path odom 3 {poses}", *(f"update {t} .002" for t in (1.5, 2.5, 3, 4.5))]
    (before, between, middle, after), _ = answers(controller, *lines)
    assert before.reference[:4] == [0, 0, 0, 0]
    np.testing.assert_allclose(between.reference[:4], [0.3125, 0, 0, 1.125])
    assert between.reference[ACCELERATION] == pytest.approx(1.5)
    np.testing.assert_allclose(middle.reference[:4], [1, 0, 0, 1.5])
    assert after.reference[:4] == [2, 0, 0, 0]


def test_a_path_through_points_of_a_cubic_is_the_cubic(controller: Driven) -> None:
    """x = 3 s² − 2 s³, s = (t − 2)/4, at rest at both ends; its points lie unevenly in time."""
    poses = "2 0 0 0 3 .15625 0 0 5 .84375 0 0 6 1 0 0"
    lines = [f"path odom 4 {poses}", *(f"update {t} .002" for t in (2.5, 4, 5.5))]
    found, _ = answers(controller, *lines)
    for answer, s in zip(found, (0.125, 0.5, 0.875), strict=True):
        x, rate, acceleration = s**2 * (3 - 2 * s), 6 * s * (1 - s) / 4, (6 - 12 * s) / 16
        got = [answer.reference[k] for k in (0, FORWARD, ACCELERATION)]
        np.testing.assert_allclose(got, [x, rate, acceleration], atol=1e-12)


def test_a_path_without_times_goes_at_the_speeds_of_its_parameters(controller: Driven) -> None:
    """1 m at .5 m/s, from now; then a turn through π by the short way, 2π − 6 rad at .5 rad/s."""
    lines = ["update 10 .002", "path odom 2 0 0 0 0 0 1 0 0", "update 11 .002"]
    lines += ["path odom 2 0 0 0 3 0 0 0 -3", "update 11.28 .002", "update 12 .002"]
    (_, half, turning, turned), _ = answers(controller, *lines)
    np.testing.assert_allclose(half.reference[:4], [0.5, 0, 0, 0.75])
    assert turning.reference[TURNING] > 0
    assert turned.reference[2] == pytest.approx(2 * math.pi - 3)


def test_the_later_one_of_path_and_twist_counts_and_an_empty_path_stops(controller: Driven) -> None:
    path = "path odom 2 0 0 0 0 0 1 0 0"
    lines = [here(1), path, "twist 1 .2 0 0", "update 1 .002", path, "update 1 .002"]
    (twist, placed, stop), _ = answers(controller, *lines, "path odom 0", "update 1 .002")
    assert twist.reference[FORWARD] == 0.2
    assert math.isnan(twist.reference[0])
    assert placed.reference[0] == 0.0
    assert math.isnan(stop.reference[0])
    assert stop.reference[FORWARD] == 0.0


def test_between_two_poses_the_base_moves_on(controller: Driven) -> None:
    """50 ms at 1 m/s and 2 rad/s along an arc: as if the odometry had told it now."""

    def efforts(odometry: str) -> Sequence[float]:
        lines = ["chained 1", odometry, "reference .5 .2 .3" + 21 * " 0", "update 1.45 .002"]
        (answer,), _ = answers(controller, *lines, before="parameter limits 1e3 1e3 1e3 1e3")
        return answer.commands

    half, length = 0.05, 0.05 * math.sin(0.05) / 0.05
    x, y = 0.4 + length * math.cos(0.2 + half), 0.1 + length * math.sin(0.2 + half)
    moved = efforts(f"odometry 1.4 {ROOT} .4 .1 .2 1 0 2")
    np.testing.assert_allclose(moved, efforts(f"odometry 1.45 {ROOT} {x!r} {y!r} .3 1 0 2"))
    assert abs(moved[0] - efforts(f"odometry 1.45 {ROOT} .4 .1 .2 1 0 2")[0]) > 0.1


def test_without_odometry_it_brakes_from_its_own_speed(controller: Driven) -> None:
    """At .6 m/s, 4 rad/s of the wheels, ν̇* = −1 − .002/h − .002/h1, whatever the path asks."""
    path, moving = "path odom 2 1 0 0 0 3 2 0 0", "states 0 0 4 4 0 0"
    lines = [path, f"odometry 1.9 {ROOT} 0 0 0 .6 0 0", moving, "update 2 .002", "update 2.1 .002"]
    (tracks, brakes), _ = answers(controller, *lines)
    assert (tracks.status, brakes.status) == (0, 1)
    assert tracks.commands[0] > 0
    rate = -1 - 0.002 / HORIZON - 0.002 / 0.15
    assert brakes.commands[3] == pytest.approx(2 * rate)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("odometry 1 map base_link 0 0 0 0 0 0", "odometry from map to base_link is not used"),
        ("odometry 1 odom base 0 0 0 0 0 0", "odometry from odom to base is not used"),
        (f"odometry 1 {ROOT} nan 0 0 0 0 0", "odometry that is not finite is not used"),
    ],
)
def test_odometry_of_other_frames_is_refused(controller: Driven, line: str, complaint: str) -> None:
    (answer,), complaints = answers(controller, line, "update 1 .002")
    assert answer.status == 1
    assert complaint in complaints


def test_a_path_in_another_frame_is_refused(controller: Driven) -> None:
    (answer,), said = answers(controller, "path map 1 1 0 0 0", "update 1 .002")
    assert math.isnan(answer.reference[0])
    assert "a path in frame map is not used: parameter frame says odom" in said


def test_a_joint_goal_is_reached_smoothly_and_others_stay(controller: Driven) -> None:
    """From 0 to .3 m in 2 s, at rest at both ends; the other joint stays where it was asked to."""
    lines = [here(1), "update 1 .002", "trajectory 0 1 arm_prismatic_joint 1 2 1 .3 0 0"]
    (_, half, end), _ = answers(controller, *lines, "update 2 .002", "update 3.5 .002")
    np.testing.assert_allclose(half.reference[18:], [0, 0.15, 0, 0.225, 0, 0], atol=1e-12)
    np.testing.assert_allclose(end.reference[18:], [0, 0.3, 0, 0, 0, 0], atol=1e-12)


def test_a_new_trajectory_begins_where_the_arm_is_asked_to_be(controller: Driven) -> None:
    lines = [here(1), "update 1 .002", "trajectory 0 1 arm_prismatic_joint 1 2 1 .3 0 0"]
    lines += ["update 2 .002", "trajectory 0 1 arm_prismatic_joint 1 2 1 .15 0 0", "update 2 .002"]
    (_, before, after), _ = answers(controller, *lines)
    for k in (SLIDE, SLIDE_RATE):
        assert after.reference[k] == pytest.approx(before.reference[k], abs=1e-12)


def test_a_trajectory_with_accelerations_is_of_fifth_order(controller: Driven) -> None:
    """Half way of a quintic of rest: 15/8 of the mean rate; joints stand in another order."""
    names, zeros = "2 arm_prismatic_joint arm_revolute_joint", "2 0 0"
    point = f"2 2 .3 -.6 {zeros} {zeros}"
    lines = [here(1), "update 1 .002", f"trajectory 0 {names} 1 {point}", "update 2 .002"]
    (_, half), _ = answers(controller, *lines)
    rates = [-0.3 * 15 / 8, 0.15 * 15 / 8]
    np.testing.assert_allclose(half.reference[18:], [-0.3, 0.15, *rates, 0, 0], atol=1e-12)


def test_a_trajectory_with_rates_passes_at_them(controller: Driven) -> None:
    names, point = "1 arm_prismatic_joint", "1 1 .1 1 .2 0"
    lines = [here(1), "update 1 .002", f"trajectory 0 {names} 2 {point} 2 1 .3 1 0 0"]
    (_, passing), _ = answers(controller, *lines, "update 2 .002")
    assert passing.reference[SLIDE] == pytest.approx(0.1)
    assert passing.reference[SLIDE_RATE] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("1 gripper 1 2 1 .3 0 0", "it has no joint gripper"),
        ("1 arm_prismatic_joint 1 2 0 0 0", "each point needs a finite position"),
        ("1 arm_prismatic_joint 1 2 1 nan 0 0", "each point needs a finite position"),
        ("1 arm_prismatic_joint 2 2 1 .3 0 0 2 1 .4 0 0", "times of points have to increase"),
    ],
)
def test_trajectories_that_cannot_be_followed_are_refused(
    controller: Driven, words: str, complaint: str
) -> None:
    lines = [here(1), "update 1 .002", f"trajectory 0 {words}", "update 1.002 .002"]
    (_, answer), complaints = answers(controller, *lines)
    assert f"a joint trajectory is not used: {complaint}" in complaints
    assert np.isnan(answer.reference[18:20]).all()


def test_bad_samples_hold_and_then_fail(controller: Driven) -> None:
    """The last commands go on for stale_after, .1 s; then there are zeros, and an error."""
    bad = "states nan 0 0 0 0 0"
    lines = [here(1), "twist 1 .5 0 0", "update 1 .002", bad, "update 1.002 .002"]
    lines += ["update 1.1 .098", "update 1.102 .002", AT_REST, here(1.104), "update 1.104 .002"]
    (good, held, still, failed, again), _ = answers(controller, *lines)
    assert good.commands[0] > 0
    assert held.commands == still.commands == good.commands
    assert [each.status for each in (held, still, failed, again)] == [2, 2, 3, 0]
    assert failed.commands == [0, 0, 0, 0]
    assert [each.done for each in (held, failed, again)] == [True, False, True]


def test_a_rate_that_is_missing_is_estimated_unless_it_has_to_be_measured(
    controller: Driven,
) -> None:
    """A wheel's or a joint's; one that is infinite is a fault."""
    lines = [here(1), "update 1 .002"]
    for state in ("0 0 nan 0 0 0", "0 0 0 0 nan 0", "0 0 inf 0 0 0"):
        lines += [f"states {state}", "update 1.002 .002"]
    found, _ = answers(controller, *lines)
    assert [each.status for each in found] == [0, 0, 0, 2]
    found, _ = answers(controller, *lines, before="parameter rates = measured")
    assert [each.status for each in found] == [0, 2, 2, 2]


def test_hardware_without_rates_moves_and_goes_on_where_odometry_is_lost(
    controller: Driven, paper: Robot
) -> None:
    """At .2 m/s, that its poses tell; 60 ms after the last pose it brakes at 1 m/s² from there.

    Wheels have 1/(M_v r/2) of their effort: the model moves the estimate on, and no pose that
    stands still is taken for a robot that does.
    """
    positions = "states" + len(paper.joint_names) * " 0"
    before = "parameter rates = estimated\nparameter odometry_timeout .001"
    lines = ["configure", "activate", "interfaces", positions]
    for k in range(200):
        t = 1 + 0.002 * k
        lines += [f"odometry {t} {ROOT} {0.2 * (t - 1)} 0 0 .2 0 0", f"twist {t} .2 0 0"]
        lines += [f"update {t} .002"]
    lines += [f"update {t + 0.002 * k} .002" for k in range(1, 31)]
    said, _ = controller.obey([*before.splitlines(), *lines])
    assert said[3].split() == [f"{name}/position" for name in paper.joint_names]
    rows = [[float(word) for word in line.split()] for line in said[6:]]
    assert [row[1] for row in rows] == [0] * 200 + [1] * 30
    mass = 30 + 2 + 4 + 2 + 2 * 0.005 / 0.15**2
    braking = -mass * 0.15 / 2
    assert rows[199][2] == pytest.approx(0.0, abs=0.3)
    assert np.array([row[2] for row in rows[201:]]) == pytest.approx(braking, rel=0.3)


def test_behind_a_delay_topics_are_read_ahead(controller: Driven) -> None:
    """By 50 ms: a path with times, and one that begins when it is heard of."""
    poses, told = "2 0 0 0 3 1 0 0 4 2 0 0", "parameter delay .05"
    lines = [f"path odom 3 {poses}", "update 2.45 .002", "path odom 2 0 0 0 0 0 1 0 0"]
    (ahead, begins), _ = answers(controller, *lines, "update 2.45 .002", before=told)
    np.testing.assert_allclose(ahead.reference[:4], [0.3125, 0, 0, 1.125])
    assert begins.reference[0] == 0.0


def test_in_chained_mode_interfaces_are_the_reference(controller: Driven) -> None:
    """A reference 65 mm ahead asks x/h and its rate; topics are not heard."""
    ahead = "reference .065 0 0" + 15 * " 0" + 6 * " 0"
    lines = ["chained 1", here(1), "update 1 .002", "twist 1 .5 0 0", ahead, "update 1 .002"]
    (unset, placed), _ = answers(controller, *lines)
    assert unset.commands == [0, 0, 0, 0]
    assert placed.reference[0] == 0.065
    distance = 0.3 * math.tanh(0.065 / 0.3)  # the leash
    rate = distance / HORIZON / 0.15
    assert placed.commands[3] == pytest.approx(2 * rate, rel=1e-9)


def test_efforts_stay_within_the_limits_of_the_parameters(controller: Driven) -> None:
    lines = ["chained 1", here(1), "reference 3 0 0" + 21 * " 0", "update 1 .002"]
    (free,), _ = answers(controller, *lines)
    (bound,), _ = answers(controller, *lines, before="parameter limits 5 6 60 1.5")
    assert free.commands[0] > 6
    assert bound.commands[:2] == [5, 6]
    assert bound.commands[3] == 1.5


def test_parameters_that_do_not_fit_are_refused(controller: Driven) -> None:
    for line, complaint in (
        ("parameter limits 5 6 60", "parameter limits: give 4 number(s) above 0"),
        ("parameter limits 5 6 60 0", "parameter limits: give 4 number(s) above 0"),
        ("parameter path_speed -1", "parameter path_speed: give 1 number(s) above 0"),
        ("parameter delay -0.001", "parameter delay: give a time from 0 to 2.0 s"),
        ("parameter delay nan", "parameter delay: give a time from 0 to 2.0 s"),
        ("parameter rates = guessed", "parameter rates: give automatic, measured or estimated"),
    ):
        said, complaints = controller.obey([line, "configure"])
        assert said == ["0"]
        assert complaint in complaints


def test_deactivated_it_leaves_zeros(controller: Driven) -> None:
    lines = [here(1), "twist 1 .5 0 0", "update 1 .002", "deactivate", "show"]
    (driving, left), _ = answers(controller, *lines)
    assert driving.commands[0] > 0
    assert left.commands == [0, 0, 0, 0]


def test_its_interfaces_have_the_joints_names(controller: Driven, paper: Robot) -> None:
    said, _ = controller.obey(["configure", "activate", "interfaces"])
    commands, states, reference, exported = (line.split() for line in said[2:])
    arm = paper.joint_names
    assert commands == [f"{name}/effort" for name in paper.actuators]
    assert states == [
        *(f"{name}/position" for name in arm),
        *(f"{name}/velocity" for name in paper.actuators),
    ]
    assert len(reference) == 18 + 3 * len(arm)
    assert reference[3] == "paper_controller/forward/velocity"
    assert reference[-1] == f"paper_controller/{arm[-1]}/acceleration"
    assert exported == ["paper_controller/tracking/status"]


def test_p_may_lie_beside_the_root_link(mixed_chain: Robot, tmp_path: Path) -> None:
    """A path is the root link's, a reference P's; a twist without a place asks for no other one."""
    package = tmp_path / "package"
    export_ros2_control(mixed_chain, package)
    controller = driven(mixed_chain, package, PLAIN, "driver", PERIOD)
    place, twist = (0.3, -0.2, 0.7), [0.1, 0.0, 0.2]
    where = mixed_chain.base_pose(mixed_chain.configuration(*place))
    assert np.abs(where - place).max() > 0.05
    told = (*place, *(mixed_chain.root_velocity @ twist).tolist())
    still = (len(mixed_chain.joint_names) + len(mixed_chain.actuators)) * " 0"
    odometry = f"odometry 1 odom {mixed_chain.description.root} {words(told)}"
    count, rest = 2 + len(mixed_chain.actuators), [0.0] * (12 + 3 * len(mixed_chain.joints))

    def row(*lines: str) -> list[float]:
        start = ["configure", "activate", f"states{still}", odometry]
        said, _ = controller.obey([*start, *lines, "update 1 .002"])
        return [float(word) for word in said[-1].split()]

    by_path = row(f"path odom 1 1 {words(place)}")
    np.testing.assert_allclose(by_path[count:][:3], where, atol=1e-12)
    at_rest = row("chained 1", f"reference {words([*where, 0, 0, 0, *rest])}")
    np.testing.assert_allclose(by_path[:count], at_rest[:count], atol=1e-9)
    unplaced = row("twist 1 .1 .3 .2")  # not to its left: it cannot
    moving = row("chained 1", f"reference {words([*where, *twist, *rest])}")
    np.testing.assert_allclose(unplaced[:count], moving[:count], atol=1e-9)


def words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
