"""Grippers are found by structure, frozen by default and told; arms are never taken for them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import rpctl
from rpctl import Robot
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.errors import UnknownNameError
from rpctl.robot.grippers import find_end_effector
from tests import urdf
from tests.robot.arms import AXES, BEND, GRASP, arm, body, limb, load, mimic
from tests.robots import SET_A, platform

RODS = ("rod_1_joint", "rod_2_joint", "rod_3_joint")
LEFT, RIGHT = "0 0.02 0", "0 -0.02 0"
CURL = urdf.limit(-0.1, 0.8, 5, 1)


def told(robot: Robot) -> str:
    """Return what is told of frozen joints."""
    return " ".join(f.message for f in robot.findings if "frozen" in f.message)


SLIDES = (limb("l", "palm", "0 1 0", xyz=LEFT), limb("r", "palm", "0 -1 0", xyz=RIGHT))
TURNED = (  # the other's frame is turned by half a turn: one axis in its own, opposite in the palm
    limb("l", "palm", "0 1 0", xyz=LEFT),
    body("r", 0.05) + urdf.joint("r_joint", "prismatic", ("palm", "r"), RIGHT, "0 1 0", GRASP,
                                 f"0 0 {math.pi}"),
)  # fmt: skip
ONE_AXIS = (  # both move along y; one opens up, the other down
    limb("l", "palm", "0 1 0", urdf.limit(0.0, 0.04, 20, 0.1), xyz=LEFT),
    limb("r", "palm", "0 1 0", urdf.limit(-0.04, 0.0, 20, 0.1), xyz=RIGHT),
)
KNUCKLES = (
    limb("l", "palm", "0 0 1", CURL, "revolute", LEFT),
    limb("l_tip", "l", "0 0 1", CURL, "revolute", "0.05 0 0"),
    limb("r", "palm", "0 0 -1", CURL, "revolute", RIGHT),
    limb("r_tip", "r", "0 0 -1", CURL, "revolute", "0.05 0 0"),
)
COUPLED = (  # as many a parallel gripper is written: one is driven, five follow, some for ever
    limb("driver", "palm", "0 0 1", CURL, "revolute", LEFT),
    limb("inner", "palm", "0 0 1", mimic("driver_joint"), "continuous", LEFT),
    limb("other", "palm", "0 0 1", CURL + mimic("driver_joint", -1.0), "revolute", RIGHT),
    limb("tip", "other", "0 0 1", mimic("driver_joint"), "continuous", "0.04 0 0"),
)
HAND = tuple(
    limb(f"d{k}{j}", f"d{k}{j - 1}" if j else "palm", "0 1 0", CURL, "revolute", f"0.03 {y} 0")
    for k, y in enumerate((-0.02, 0.0, 0.02))
    for j in range(3)
)
JAW = (limb("jaw", "palm", "0 0 1", CURL, "revolute", LEFT),)
SPINNING = (limb("gripper", "palm", "0 0 1", "", "continuous", LEFT),)
STRUCTURES = {
    "slides": (SLIDES, "mirror"),
    "turned": (TURNED, "mirror"),
    "one axis": (ONE_AXIS, "mirror"),
    "knuckles": (KNUCKLES, "mirror"),
    "coupled": (COUPLED, "mimic"),
    "hand": (HAND, "branches"),
    "jaw": (JAW, "by name"),
    "spinning": (SPINNING, "by name"),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_grippers_are_frozen_and_told(name: str, tmp_path: Path) -> None:
    parts, why = STRUCTURES[name]
    robot = load(tmp_path, arm(), *parts)
    assert robot.joint_names == RODS
    assert robot.end_effector == "palm"
    assert len(robot.locked) == sum(part.count("<joint ") for part in parts)
    assert why in told(robot)
    assert told(robot).count("frozen") == 1
    assert all(finding.severity != "warning" for finding in robot.findings)


@pytest.mark.parametrize("name", STRUCTURES)
def test_free_releases_them_and_the_end_effector_stays(name: str, tmp_path: Path) -> None:
    robot = load(tmp_path, arm(), *STRUCTURES[name][0], free=["*"])
    assert not robot.locked
    assert set(robot.joint_names) > set(RODS)
    assert robot.end_effector == "palm"
    assert not told(robot)


ARMS = {  # what looks like a gripper, and is none
    "two slides, one on the other": (limb("a", "base", "0 1 0"), limb("b", "a", "0 -1 0")),
    "slides on the base": (limb("a", "base", "0 1 0"), limb("b", "base", "0 -1 0")),
    "named, but all there is": (
        limb("finger_1", "base", "0 1 0", BEND, "revolute"),
        limb("finger_2", "finger_1", "0 1 0", BEND, "revolute", "0.1 0 0"),
    ),
    "two arms": (limb("torso", "base", "0 0 1"), arm("l_", base="torso"), arm("r_", base="torso")),
    "heavy": (
        arm(),
        limb("l", "palm", "0 1 0", size=(2.0, 0.05)),
        limb("r", "palm", "0 -1 0", size=(2.0, 0.05)),
    ),
    "long": (
        arm(),
        limb("l", "palm", "0 1 0", size=(0.1, 0.6)),
        limb("r", "palm", "0 -1 0", size=(0.1, 0.6)),
    ),
    "unlike": (arm(), limb("a", "palm", "0 1 0"), limb("b", "palm", "0 0 1")),
    "of other ranges": (
        arm(),
        limb("a", "palm", "0 1 0"),
        limb("b", "palm", "0 -1 0", urdf.limit(0.0, 0.08, 20, 0.1)),
    ),
    "two eyes": (
        arm(),
        limb("a", "palm", "0 0 1", urdf.limit(-0.5, 0.5, 5, 1), "revolute", LEFT),
        limb("b", "palm", "0 0 1", urdf.limit(-0.5, 0.5, 5, 1), "revolute", RIGHT),
    ),
    "a telescope": (
        arm(),
        limb("a", "palm", "1 0 0"),
        limb("b", "a", "1 0 0", GRASP + mimic("a_joint")),
    ),
    "the wrist of a gripper": (
        arm(),
        body("gripper", 0.1),
        urdf.joint("last_joint", "revolute", ("palm", "gripper"), "", "1 0 0", BEND),
    ),
    "a roll by name": (
        arm(),
        limb("gripper_roll", "palm", "1 0 0", BEND, "revolute"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_no_grippers(name: str, tmp_path: Path) -> None:
    robot = load(tmp_path, *ARMS[name])
    assert robot.locked == {}
    assert not told(robot)


def _mobile(folder: Path, *parts: str) -> Path:
    """Write a wheeled platform with an arm and what it holds."""
    text = platform(SET_A, extra="\n".join([arm(), *parts]))
    path = folder / "mobile.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_fingers_are_frozen_inside_their_limits_and_mimics_follow(tmp_path: Path) -> None:
    """0 is outside 0.3 to 0.8: 0.3 is nearest; the follower is at 2 · 0.3 + 0.1."""
    limit = urdf.limit(0.3, 0.8, 5, 1)
    follow = '<mimic joint="l_joint" multiplier="2" offset="0.1"/>'
    robot = load(
        tmp_path, arm(), limb("l", "palm", "0 0 1", limit, "revolute", LEFT),
        limb("r", "palm", "0 0 -1", urdf.limit(0, 2, 5, 1) + follow, "revolute", RIGHT),
    )  # fmt: skip
    assert robot.locked == {"l_joint": 0.3, "r_joint": pytest.approx(0.7)}


def test_a_finger_is_released_with_those_that_follow_it(tmp_path: Path) -> None:
    robot = load(tmp_path, arm(), *COUPLED, free=["other_*"])
    assert robot.joint_names == (*RODS, "driver_joint")
    assert {joint.name for joint in robot.mimics} == {"inner_joint", "other_joint", "tip_joint"}
    one = load(tmp_path, arm(), *SLIDES, free=["l_joint"])
    assert one.joint_names == (*RODS, "l_joint")
    assert set(one.locked) == {"r_joint"}
    with pytest.raises(UnknownNameError, match="joint to free 'claw_"):
        load(tmp_path, arm(), *SLIDES, free=["claw_*"])


def test_the_arm_of_most_joints_is_taken_and_others_are_told(tmp_path: Path) -> None:
    torso, left = limb("torso", "base", "0 0 1"), arm("l_", base="torso")
    longer = load(tmp_path, torso, left, arm("r_", AXES[:4], "torso"))
    assert longer.end_effector == "r_palm"
    (message,) = [f.message for f in longer.findings if "end effector" in f.message]
    assert message.count("l_palm") == 1
    assert "--end-effector" in message
    assert load(tmp_path, torso, left, arm("r_", base="torso")).end_effector == "l_palm"
    head = load(tmp_path, arm(), limb("pan", "base", "0 0 1", BEND, "revolute"))
    assert head.end_effector == "palm"
    assert not any("end effector" in finding.message for finding in head.findings)


def test_wheels_that_the_drive_leaves_out_are_no_end_effector(tmp_path: Path) -> None:
    """A third wheel by its name or at the others' height; with it, the rocker that holds it."""
    rocker = limb("rocker", "base", "0 1 0", BEND, "revolute", "0.4 0 0.1")
    ends = {}
    for name, height in (("front_wheel", 0.9), ("front", 0.05), ("flail", 0.9)):
        wheel = limb(name, "rocker", "0 1 0", "", "continuous", f"0.1 0 {height - 0.1}")
        path = tmp_path / f"{name}.urdf"
        path.write_text(platform(SET_A, extra=rocker + wheel), encoding="utf-8")
        tree = FrozenTree(read(path))
        drive = rpctl.load(_mobile(tmp_path)).drive
        joints = tuple(tree.description.joint[f"{each}_joint"] for each in ("rocker", name))
        ends[name] = find_end_effector(tree, drive, joints, ())[0]
    assert ends == {"front_wheel": None, "front": None, "flail": "flail"}


@pytest.mark.parametrize(
    ("name", "dof", "end", "frozen"),
    [
        ("panda", 7, "panda_hand", 2),
        ("pr2", 18, "r_gripper_palm_link", 12),
        ("baxter", 15, "right_gripper_base_link", 4),
        ("so100", 5, "gripper", 1),
        ("so101", 5, "gripper_link", 1),
        ("z1", 6, "gripperStator", 1),
        ("allegro", 16, "link_3.0_tip", 0),
        ("finger_edu", 3, "finger_tip_link", 0),
    ],
)
def test_grippers_of_the_catalogue(name: str, dof: int, end: str, frozen: int) -> None:
    robot = rpctl.load(name)
    assert (robot.dof, robot.end_effector, len(robot.locked)) == (dof, end, frozen)
