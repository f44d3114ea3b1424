"""The home posture: given, of an SRDF, or chosen so that the arm can work from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.errors import DescriptionError, RpctlError
from rpctl.robot.posture import judge
from tests import urdf
from tests.grids import cells
from tests.robot.arms import AXES, BEND, arm, limb, load, write
from tests.robot.test_grippers import SLIDES
from tests.robots import SET_A, platform

SRDF = """<?xml version="1.0"?>
<robot name="arm">
  <virtual_joint name="world" type="planar" parent_frame="odom" child_link="base"/>
  <group_state name="home" group="lower">
    <joint name="rod_1_joint" value="0.4"/>
    <joint name="world" value="0 0 0"/>
  </group_state>
  <group_state name="home" group="upper">
    <joint name="rod_2_joint" value="-0.5"/>
    <joint name="l_joint" value="0.02"/>
    <joint name="elbow_joint" value="1.0"/>
  </group_state>
  <group_state name="stowed" group="upper"><joint name="rod_2_joint" value="1"/></group_state>
</robot>
"""


def at_home(robot: Robot) -> dict[str, float]:
    """Return the home posture by joint."""
    return dict(zip(robot.joint_names, robot.home.tolist(), strict=True))


def told(robot: Robot, word: str) -> list[str]:
    """Return the messages that hold a word."""
    return [finding.message for finding in robot.findings if word in finding.message]


def manipulability(robot: Robot, positions: Array, rows: int = 6) -> float:
    """Return the product of the largest singular values of the hand's Jacobian."""
    return float(np.prod(singular_values(robot, positions)[:rows]))


def singular_values(robot: Robot, positions: Array) -> Array:
    """Return the singular values of the hand's Jacobian, by differences; a radian is 0.3 m."""
    data, step = robot.model.createData(), 1e-6
    columns = []
    for index in range(len(positions)):
        poses = []
        for sign in (1.0, -1.0):
            moved = positions.copy()
            moved[index] += sign * step
            q = robot.configuration_at(np.zeros(3), moved)
            poses.append(robot.end_effector_pose(data, q).homogeneous)
        turn = poses[0][:3, :3] @ poses[1][:3, :3].T
        spin = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        columns.append(np.concatenate([poses[0][:3, 3] - poses[1][:3, 3], 0.3 * spin]) / (2 * step))
    return np.asarray(np.linalg.svd(np.array(columns).T, compute_uv=False), dtype=float)


def test_a_given_joint_is_at_home_and_the_others_as_ever(tmp_path: Path) -> None:
    path = write(tmp_path, arm())
    plain = at_home(rpctl.load(path, drive="fixed"))
    for home in ({"rod_2_joint": 0.7}, "rod_2_joint=0.7", ["rod_2_joint=0.1", "rod_2_joint = 0.7"]):
        robot = rpctl.load(path, drive="fixed", home=home)
        assert at_home(robot) == {**plain, "rod_2_joint": 0.7}
    several = rpctl.load(path, drive="fixed", home="rod_1_joint=-1,rod_3_joint=0.25")
    assert several.home[[0, 2]].tolist() == [-1.0, 0.25]


@pytest.mark.parametrize(
    ("home", "message"),
    [
        ("rod_2_joint=3", r"home of rod_2_joint is 3, outside its limits; give -2.5 to 2.5 rad"),
        ("rod_2_joint=nan", r"home of rod_2_joint is nan; give a number"),
        ("rod_2_joint=far", r"'far' is not a number; write NAME=0.1"),
        ("rod_2_joint", r"give NAME=POSITION, auto, zero, or a state of an SRDF"),
        ("l_joint=0.01", r"home of l_joint: this joint is frozen at 0; --free l_joint"),
        ({"rod_2_joint": "0.1"}, r"home of rod_2_joint is '0.1'; give a number"),
    ],
)
def test_a_home_that_cannot_be_is_refused(home: object, message: str, tmp_path: Path) -> None:
    path = write(tmp_path, arm(), *SLIDES)
    with pytest.raises(RpctlError, match=message):
        rpctl.load(path, drive="fixed", home=home)  # type: ignore[arg-type]  # as users do


def with_srdf(folder: Path, text: str = SRDF) -> tuple[Path, Path]:
    """Write an arm with a gripper and its SRDF; return the files."""
    srdf = folder / "arm.srdf"
    srdf.write_text(text, encoding="utf-8")
    return write(folder, arm(), *SLIDES), srdf


def test_states_of_an_srdf_are_joined_and_strange_joints_told(tmp_path: Path) -> None:
    path, srdf = with_srdf(tmp_path)
    robot = rpctl.load(path, drive="fixed", home=f"{srdf}:home")
    assert robot.home[:2].tolist() == [0.4, -0.5]
    (strange,) = told(robot, "does not have")
    assert strange.endswith(": elbow_joint (line 11)")
    (still,) = told(robot, "keep their positions")
    assert still.endswith(": l_joint")
    with pytest.raises(DescriptionError, match="elbow_joint"):
        rpctl.load(path, drive="fixed", home=f"{srdf}:home", strict=True)
    later = rpctl.load(path, drive="fixed", home=[f"{srdf}:home", "rod_1_joint=0.1"])
    assert later.home[:2].tolist() == [0.1, -0.5]


@pytest.mark.parametrize(
    ("old", "new", "state", "message"),
    [
        ("", "", "hom", r"arm.srdf:2: error: .* \"hom\"; its states are home, stowed"),
        ("", "", "", r"its states are home, stowed"),
        ('value="-0.5"', 'value="x"', "home", r"arm.srdf:9: error: <joint value=\"x\"> is not a"),
        ('value="-0.5"', "", "home", r"arm.srdf:9: error: <joint> has no attribute \"value\""),
        ('name="elbow_joint"', "", "home", r"arm.srdf:11: error: <joint> of a group state with"),
        ("elbow", "rod_1", "home", r"arm.srdf:11: error: .* at 1 here and at 0.4 at line 5"),
        ("</robot>", "", "home", r"truncated"),
        ("<robot", "<!DOCTYPE robot [<!ENTITY a 'b'>]><robot", "home", r":2: error: a DOCTYPE"),
        ("</robot>", '<link name="base"/></robot>', "home", r"this is a URDF; give the SRDF"),
        ("group_state", "state", "home", r"there is no group state \"home\"; it has no group "
                                         r"states"),
    ],
)  # fmt: skip
def test_faults_of_an_srdf_have_a_line(
    old: str, new: str, state: str, message: str, tmp_path: Path
) -> None:
    path, srdf = with_srdf(tmp_path, SRDF.replace(old, new) if old else SRDF)
    with pytest.raises(DescriptionError, match=message):
        rpctl.load(path, drive="fixed", home=f"{srdf}:{state}")
    with pytest.raises(DescriptionError, match=r"none.srdf: error: No such file or directory"):
        rpctl.load(path, drive="fixed", home=f"{tmp_path}/none.srdf:home")


def test_an_srdf_may_be_xacro_with_arguments_of_the_robot_s(tmp_path: Path) -> None:
    """The robot's file has an argument more than its SRDF; both have the arm's name."""
    head = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    names = '<xacro:arg name="rod" default="none"/>'
    state = '<group_state name="up" group="g"><joint name="$(arg rod)_2_joint" value="0.75"/>'
    srdf = tmp_path / "arm.srdf.xacro"
    srdf.write_text(f"{head}{names}{state}</group_state></robot>", encoding="utf-8")
    path = tmp_path / "arm.urdf.xacro"
    more = f'{head}{names}<xacro:arg name="mass" default="1"/>'
    text = write(tmp_path, arm()).read_text(encoding="utf-8").replace('<robot name="arm">', more)
    path.write_text(text, encoding="utf-8")
    arguments = {"rod": "rod", "mass": "2"}
    robot = rpctl.load(path, "fixed", xacro_args=arguments, home=f"{srdf}:up")
    assert at_home(robot)["rod_2_joint"] == 0.75


def six_axis(folder: Path, *more: str) -> Path:
    """Write a base on two wheels with an arm whose wrist is singular and stretched at zero."""
    text = platform(
        SET_A,
        extra="\n".join([arm("", ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")), *more]),
    )
    path = folder / "mobile.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_arm_that_can_work_at_zero_stays_there(tmp_path: Path) -> None:
    axes = ("0 0 1", "0 0 1", "1 0 0")  # nowhere of less than half of its best manipulability
    robot = load(
        tmp_path, limb("lift", "base", "0 0 1", urdf.limit(0, 1, 9, 1)), arm("", axes, "lift")
    )
    straight = rpctl.load(robot.source, drive="fixed", home="zero")
    assert at_home(straight)["lift_joint"] == 0.3
    bent = rpctl.load(robot.source, drive="fixed", home="rod_2_joint=1.2")
    assert not told(bent, "at home")
    assert not told(rpctl.load("paper"), "home")


def test_a_stretched_arm_takes_a_posture_and_tells(tmp_path: Path) -> None:
    path = six_axis(tmp_path)
    robot, straight = rpctl.load(path), rpctl.load(path, home="zero")
    assert straight.home.tolist() == [0.0] * 6
    assert not told(straight, "home")
    (message,) = told(robot, "rpctl chose the home posture")
    assert "the arm to palm is stretched or near singular (0.0% of its best" in message
    assert "--home zero" in message
    assert manipulability(straight, straight.home) < 1e-9
    assert manipulability(robot, robot.home) > 1e-4
    given = rpctl.load(path, home=dict.fromkeys(robot.joint_names, 0.0))
    assert given.home.tolist() == [0.0] * 6
    assert told(given, "at home, the arm to palm is stretched or near singular")
    assert at_home(rpctl.load(path)) == at_home(robot)
    assert at_home(rpctl.load(path, home="auto")) == at_home(robot)


@pytest.mark.parametrize(("effort", "holds"), [(1000, False), (12, True)])
def test_a_chosen_posture_is_one_that_the_joints_hold(
    effort: float, holds: bool, tmp_path: Path
) -> None:
    """Two rods of 1 kg and 1 m in an upright plane; what is left of 12 N m is for other branches.

    At q₁, q₂ below the level the first joint holds m g l (1.5 cos q₁ + 0.5 cos(q₁ + q₂)).
    """
    limit, rod = urdf.limit(-2.5, 2.5, effort, 2), (1.0, 1.0)
    parts = [
        limb("rod_1", "base", "0 1 0", limit, "revolute", "0 0 1.5", rod),
        limb("rod_2", "rod_1", "0 1 0", limit, "revolute", "1 0 0", rod),
    ]
    q1, q2 = rpctl.load(write(tmp_path, *parts), drive="fixed", home="auto").home
    moment = 9.81 * (1.5 * np.cos(q1) + 0.5 * np.cos(q1 + q2))
    assert bool(abs(moment) < 0.81 * 12.0) is holds


def lowest(robot: Robot) -> float:
    """Return the height of the lowest end of the rods over the ground, m."""
    q, data = robot.configuration_at(np.zeros(3), robot.home), robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    heights = []
    for name in ("turn", "rod", *(f"rod_{k}" for k in range(1, 7))):
        if not robot.model.existFrame(name, pin.FrameType.BODY):
            continue
        pose = data.oMf[robot.model.getFrameId(name, pin.FrameType.BODY)]
        length = 0.6 if name == "rod" else 0.3
        heights += [pose.act(np.array([x, 0.0, 0.0]))[2] for x in (0.0, length)]
    return min(heights) - robot.drive.ground


@pytest.mark.parametrize("seed", cells(range(4), (1,)))
def test_chosen_postures_of_random_arms(seed: int, tmp_path: Path) -> None:
    """Inside the limits, above the ground, and far from singular where zero may be anything."""
    rng = np.random.default_rng(seed)
    axes = [AXES[0], AXES[1], *(AXES[k] for k in rng.integers(0, 6, 4))]
    text = arm("", axes)
    for _ in axes:
        low, high = -rng.uniform(0.3, 2.8), rng.uniform(0.3, 2.8)
        text = text.replace(BEND, urdf.limit(low, high, 50, 2), 1)
    path = tmp_path / "random.urdf"
    path.write_text(platform(SET_A, extra=text), encoding="utf-8")
    robot, straight = rpctl.load(path, home="auto"), rpctl.load(path, home="zero")
    for joint, position in zip(robot.joints, robot.home, strict=True):
        margin = 0.1 * (joint.upper - joint.lower)
        assert joint.lower + margin < position < joint.upper - margin, seed
    drawn = np.array([singular_values(robot, _draw(robot, rng)) for _ in range(50)])
    rank = int((drawn > 1e-6 * drawn[:, :1]).sum(axis=1).max())  # of some, two axes are one
    zero, auto = (manipulability(robot, each.home, rank) for each in (straight, robot))
    best = drawn[:, :rank].prod(axis=1).max()
    assert auto > 0.2 * best, seed
    usual = rpctl.load(path)
    assert manipulability(usual, usual.home, rank) > (
        zero if told(usual, "rpctl chose the home posture") else 0.05 * best
    )
    assert lowest(robot) > 0.02, seed


def _draw(robot: Robot, rng: np.random.Generator) -> Array:
    return np.array([rng.uniform(joint.lower, joint.upper) for joint in robot.joints])


@pytest.mark.parametrize(("elbow", "weak"), [(5.0, True), (6.0, False), (-5.0, True)])
def test_an_arm_is_near_singular_below_a_tenth_of_its_best(
    elbow: float, weak: bool, tmp_path: Path
) -> None:
    """Two rods of l = 10 m that turn about parallel axes: l √(l² sin² elbow + m²) with m = 0.3 m
    a radian, at best l √(l² + m²): a tenth is at 5.47°.
    """
    rod = (1.0, 10.0)
    parts = [
        limb("rod_1", "base", "0 0 1", BEND, "revolute", "0 0 0.3", rod),
        limb("rod_2", "rod_1", "0 0 1", BEND, "revolute", "10 0 0", rod),
        urdf.link("palm", urdf.inertial(0.1, (1e-3, 1e-3, 1e-3))),
        urdf.joint("palm_joint", "fixed", ("rod_2", "palm"), "10 0 0"),
    ]
    reasons = judge(load(tmp_path, *parts), np.radians([40.0, elbow]))
    assert bool(reasons) is weak
    if weak:
        assert "near singular (9.2% of its best manipulability)" in reasons[0]
