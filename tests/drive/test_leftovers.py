"""What looks like a wheel and is none of the drive's: an error that names what would settle it."""

from __future__ import annotations

import pytest

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.drive.leftovers import lock_option
from tests import urdf
from tests.drive.drive_cases import Files, body, xml
from tests.robots import write
from tests.vehicles import Parts, rear_axle


def base() -> Parts:
    parts = body()
    rear_axle(parts)
    return parts


def two_swivels() -> Parts:
    parts = base()
    parts.swivel("outer", "0.5 0 0.2", "continuous")
    parts.link("inner_fork", 0.2)
    parts.joint("inner", "continuous", ("outer_fork", "inner_fork"), "0 0 0", "0 0 1")
    parts.wheel("third", "inner_fork", "0 0 -0.1")
    return parts


def tilted() -> Parts:
    parts = base()
    parts.wheel("front_wheel", "base", "0.5 0 0.1", axis="0 0.9848 0.1736")
    return parts


def limited() -> Parts:
    parts = base()
    parts.link("front_wheel_link", 1.0, urdf.shape('sphere radius="0.1"'))
    parts.joint("front_wheel", "revolute", ("base", "front_wheel_link"), "0.5 0 0.1", "0 1 0")
    return parts


def moving() -> Parts:
    parts = base()
    parts.wheel("front_wheel", "base", "0.5 0 0.1")
    parts.link("flap", 0.1)
    parts.joint("flap_joint", "revolute", ("front_wheel_link", "flap"), "0 0.1 0", "0 1 0")
    return parts


def high() -> Parts:
    parts = base()
    parts.wheel("front_wheel", "base", "0.5 0 0.3")
    return parts


def idle_caster() -> Parts:
    parts = base()
    parts.swivel("front_caster", "0.5 0 0.1", "continuous")
    return parts


@pytest.mark.parametrize(
    ("parts", "why", "ways"),
    [
        (two_swivels(), '"third" swivels about 2 upright axes', ("--lock outer", "--lock third")),
        (tilted(), '"front_wheel" has an axle 10° off the level', ("level its <axis>",)),
        (limited(), '"front_wheel" has limits', ('make it "continuous"', "--lock front_wheel")),
        (moving(), '"front_wheel" moves other joints, "flap_joint"', ("--lock flap_joint",)),
        (high(), '"front_wheel" ends 200 mm above the ground', ("--free front_wheel",)),
        (idle_caster(), '"front_caster" is called a caster', ("--lock front_caster",)),
    ],
)
def test_a_wheel_that_is_left_out_is_an_error(
    files: Files, parts: Parts, why: str, ways: tuple[str, ...]
) -> None:
    refusal = files.refusal(parts)
    assert refusal.startswith(f"{files.folder / 'robot.urdf'}:1: the differential drive leaves out")
    assert why in refusal
    for way in ways:
        assert f"\n  {way}" in refusal


def test_a_robot_whose_wheels_are_all_left_out_is_no_arm(files: Files) -> None:
    """A legged robot on wheels whose file gives them the range 0: names tell, no height does."""
    parts = body()
    for side, y in (("left", 0.2), ("right", -0.2)):
        parts.link(f"{side}_leg", 1.0)
        parts.joint(f"{side}_hip", "revolute", ("base", f"{side}_leg"), f"0 {y} 0", "0 1 0")
        parts.link(f"{side}_wheel_link", 1.0)
        place = (f"{side}_leg", f"{side}_wheel_link")
        parts.joint(f"{side}_wheel", "revolute", place, "0 0 -0.4", "0 1 0")
    refusal = files.refusal(parts)
    assert '"left_wheel" has limits; make it "continuous"' in refusal
    assert "or say --drive fixed for an arm" in refusal


@pytest.mark.parametrize("parts", [two_swivels(), tilted(), limited(), moving(), high()])
def test_each_way_out_settles_it(files: Files, parts: Parts) -> None:
    """The commands of the message load the robot, and no wheel is an arm's joint unless free."""
    text, refusal = xml(parts), files.refusal(parts)
    for line in refusal.splitlines()[1:]:
        flag, _, name = line.split("  (")[0].strip().partition(" ")
        if flag in ("--lock", "--free"):
            key = flag.removeprefix("--")
            robot = (
                files.load(text, lock=[name]) if key == "lock" else files.load(text, free=[name])
            )
            assert len(robot.drive.wheels) >= 2
            wheel = refusal.split('"')[1]
            assert (wheel in robot.joint_names) == (key == "free")


@pytest.mark.parametrize("axis", ["0.96 0 0.28", "1 0 0"])
def test_a_steering_wheel_is_held(files: Files, axis: str) -> None:
    """It moves none of the robot's wheels, and is no arm; one near the ground is a wheel."""
    parts = base()
    parts.wheel("turn", "base", "0.5 0 0.9", axis=axis)
    text = xml(parts).replace("turn_link", "steering_wheel")
    robot = files.load(text, strict=True)
    assert (robot.joint_names, dict(robot.locked)) == ((), {"turn": 0.0})
    (told,) = (f for f in robot.findings if "steering wheel" in f.message)
    assert told.message == '"turn" turns a steering wheel, which is held; --free lets it turn'
    assert files.load(text, free=["turn"]).joint_names == ("turn",)
    low = text.replace("0.5 0 0.9", "0.5 0 0.19")
    assert '"turn"' in files.refusal(low)


PATTERNS = [
    (("caster_joint_fl", "caster_joint_br"), "--lock 'caster_joint_*'"),
    (("left_spring", "right_spring"), "--lock '*_spring'"),
    (("front_left_wheel", "front_right_wheel"), "--lock 'front_*_wheel'"),
    (("left_spring", "front_left_wheel"), "--lock left_spring --lock front_left_wheel"),
    (("rear_wheel",), "--lock rear_wheel"),
    (("a_r_passive_z", "a_l_passive_x", "a_l_passive_y"), "--lock '*passive*'"),
]


@pytest.mark.parametrize(("names", "option"), PATTERNS)
def test_one_pattern_names_the_joints_and_no_other(
    files: Files, names: tuple[str, ...], option: str
) -> None:
    parts = body()
    every = {name for names, _ in PATTERNS for name in names} | {"front_box", "a_box_z"}
    for name in sorted(every):
        parts.wheel(name, "base", "0 0 0.1")
    assert lock_option(FrozenTree(read(write(files.folder, xml(parts)))), names) == option
