"""What looks like a wheel and is none, and passive joints of wheels, held at rest."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.drive.leftovers import lock_option
from rpctl.errors import Finding
from tests import urdf
from tests.drive.drive_cases import TRANSMISSION, Files, body, xml
from tests.drive.test_parallel_wheels import plugin, with_plugin
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


def tilted(axis: str = "0 0.9848 0.1736") -> Parts:
    parts = base()
    parts.wheel("front_wheel", "base", "0.5 0 0.1", axis=axis)
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
        (tilted(), '"front_wheel" has an axle 10° off horizontal', ("level its <axis>",)),
        (tilted("1 1 1"), '"front_wheel" has an axle 35° off horizontal', ("level its <axis>",)),
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
    assert refusal.startswith(f"{files.folder / 'robot.urdf'}:1: the differential drive ignores")
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
    assert "or give --drive fixed for an arm" in refusal


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
    assert told.message == (
        '"turn" turns a steering wheel, which rpctl freezes; --free lets it turn'
    )
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


SIDES = (("left", 0.3), ("right", -0.3))
STRUT = urdf.limit(-0.02, 0.02, 100, 1)


def infos(robot: Robot) -> list[Finding]:
    return [f for f in robot.findings if "suspension" in f.message or "rollers" in f.message]


def struts(limit: str = STRUT, axis: str = "0 0 1", height: float = 0.1) -> Parts:
    """Return a base whose two wheels hang on a strut each."""
    parts = body()
    for side, y in SIDES:
        parts.link(f"{side}_arm", 0.5)
        ends = ("base", f"{side}_arm")
        parts.joint(f"{side}_spring", "prismatic", ends, f"0 {y} {height}", axis, limit)
        parts.wheel(f"{side}_roll", f"{side}_arm", "0 0 0")
    return parts


def on_rocker(limit: str, axis: str = "1 0 0", name: str = "wheel", carried: str = "") -> Parts:
    """Return a base with wheels behind, and two in front on a rocker, as Ridgeback's."""
    parts = body()
    rear_axle(parts, x=-0.3)
    parts.link("rocker", 0.5)
    ends = ("base", "rocker")
    parts.xml.append(urdf.joint("front_rocker", "revolute", ends, "0.3 0 0.1", axis, limit))
    for side, y in SIDES:
        parts.wheel(f"front_{side}_{name}", "rocker", f"0 {y} 0")
    if carried:
        parts.link("mast", 0.5)
        ends = ("rocker", "mast")
        parts.xml.append(urdf.joint("mast_joint", "revolute", ends, "0 0 0.5", "0 0 1", carried))
    return parts


def test_struts_are_held_at_rest_and_told(files: Files) -> None:
    robot = files.load(struts(), strict=True)
    assert robot.drive.type == "differential"
    assert robot.quasi_velocities == ("v", "omega")
    assert dict(robot.locked) == {"left_spring": 0.0, "right_spring": 0.0}
    left, right = infos(robot)
    assert (left.severity, left.line) == ("info", 1)
    assert left.message.startswith('"left_spring" is a passive suspension of left_roll; ')
    assert "at rest (0 m), --lock left_spring=POSITION" in left.message
    assert right.message.startswith('"right_spring"')


def test_rest_is_the_position_inside_the_limits_that_is_nearest_to_zero(files: Files) -> None:
    """The wheels' axles are 0.03 m below the joints there, so the ground is, too."""
    robot = files.load(struts(urdf.limit(-0.06, -0.03, 100, 1), height=0.13))
    assert set(robot.locked.values()) == {-0.03}
    assert robot.drive.ground == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("limit", "axis"),
    [
        (urdf.limit(-0.3, 0.3, 100, 1), "0 0 1"),  # 0.6 m for wheels of 0.1 m: a lift
        (STRUT, "1 0 0"),  # a slide along the ground
    ],
)
def test_slides_that_are_no_struts_are_asked_about(files: Files, limit: str, axis: str) -> None:
    refusal = files.refusal(struts(limit, axis))
    assert "--lock '*_spring'" in refusal
    assert files.load(struts(limit, axis), lock=["*_spring"]).drive.type == "differential"


def test_a_rocker_across_is_held_and_its_wheels_are_the_drives(files: Files) -> None:
    """Of four mecanum wheels, two on the rocker: none is left for an arm."""
    parts = on_rocker(urdf.limit(-0.087, 0.087, 9, 9), name="mecanum")
    robot = files.load(parts, strict=True)
    assert (robot.drive.type, len(robot.drive.wheels)) == ("mecanum", 4)
    assert robot.end_effector is None
    (told,) = infos(robot)
    assert told.message.startswith(
        '"front_rocker" is a passive suspension of front_left_mecanum, front_right_mecanum; '
    )
    assert "at rest (0 rad)" in told.message
    S = ReducedDynamics(robot).basis(robot.configuration())
    assert np.ptp([abs(S[robot.velocity_index(w.joint), 0]) for w in robot.drive.wheels]) < 1e-12


WIDE = urdf.limit(-1.2, 1.2, 40, 6)


@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0"])
@pytest.mark.parametrize("name", ["wheel", "roll"])
def test_a_rocker_of_wide_travel_is_asked_about(files: Files, axis: str, name: str) -> None:
    """It may as well be an arm with wheels: nothing says that nobody drives it."""
    refusal = files.refusal(on_rocker(WIDE, axis, name))
    assert f'"front_left_{name}", "front_right_{name}" hangs on "front_rocker"' in refusal
    assert "\n  --lock front_rocker " in refusal
    assert f"\n  --lock '*_{name}' " in refusal
    assert f"\n  --free '*_{name}' " in refusal
    held = files.load(on_rocker(WIDE, axis, name), lock=["front_rocker"])
    assert len(held.drive.wheels) == 4
    part = files.load(on_rocker(WIDE, axis, name), lock=[f"front_*_{name}"])
    assert (part.drive.type, part.joint_names) == ("differential", ("front_rocker",))
    arm = files.load(on_rocker(WIDE, axis, name), free=[f"front_*_{name}"])
    assert len(arm.joint_names) == 3


MOTORS = "".join(
    TRANSMISSION.format(name)
    for name in ("front_left_wheel", "front_right_wheel", "rear_left", "rear_right")
)


@pytest.mark.parametrize(
    "evidence",
    [
        WIDE + '<dynamics damping="50"/>',
        WIDE + "</joint>" + MOTORS + '<joint name="_">',
        WIDE + '</joint><gazebo reference="front_rocker"><springStiffness>9</springStiffness>'
        '</gazebo><joint name="_">',
    ],
    ids=["damping", "motors elsewhere", "spring"],
)
def test_what_shows_that_a_rocker_is_passive(files: Files, evidence: str) -> None:
    text = xml(on_rocker(WIDE))
    held = text.replace(WIDE, evidence).replace('<joint name="_"></joint>', "")
    assert files.load(held).locked == {"front_rocker": 0.0}


def test_rockers_that_mimic_each_other_stand_as_their_mimic_has_it(files: Files) -> None:
    """The first rests at 0.02 rad, the nearest to 0 in its limits; the other at −0.02 + 0.01."""
    parts = body()
    for side, y in SIDES:
        parts.link(f"{side}_rocker_link", 0.5)
        tied = '<mimic joint="left_rocker" multiplier="-1" offset="0.01"/>' * (side == "right")
        limit = urdf.limit(0.02, 0.2, 9, 9) if not tied else urdf.limit(-0.2, 0.2, 9, 9)
        ends = ("base", f"{side}_rocker_link")
        joint = urdf.joint(f"{side}_rocker", "revolute", ends, f"0 {y} 0.1", "0 1 0", limit + tied)
        parts.xml.append(joint)
        for place, x in (("front", 0.1), ("rear", -0.1)):
            parts.wheel(f"{place}_{side}", f"{side}_rocker_link", f"{x} 0 0")
    robot = files.load(parts)
    assert robot.locked == pytest.approx({"left_rocker": 0.02, "right_rocker": -0.01})
    assert (robot.drive.type, len(robot.drive.wheels)) == ("skid-steer", 4)


def test_a_suspension_that_is_to_move_is_refused(files: Files) -> None:
    """--free takes a joint out of what is held; the planar model has no place for it then."""
    refusal = files.refusal(struts(), free=["left_spring"])
    assert "--lock left_spring" in refusal


def test_an_arm_has_no_suspension(files: Files) -> None:
    assert files.load(struts(), "fixed").locked == {}


def with_rollers(angle: float) -> str:
    """Return four wheels with eight rollers each on them, at an angle (rad) to their axles."""
    parts = body()
    for place, x in (("front", 0.25), ("rear", -0.25)):
        for side, y in SIDES:
            name = f"{place}_{side}"
            parts.wheel(name, "base", f"{x} {y} 0.1", r=0.08)
            rim = f"{name}_link"
            if place == "rear":  # rollers on a link that is fixed to the wheel's
                rim = f"{name}_rim"
                parts.link(rim, 0.1)
                parts.joint(f"{name}_bolts", "fixed", (f"{name}_link", rim), "0 0 0", "0 0 1")
            hand = 1.0 if name in ("front_left", "rear_right") else -1.0
            for k in range(8):
                turn = 2.0 * np.pi * k / 8
                out = np.array([-np.sin(turn), 0.0, -np.cos(turn)])
                around = np.array([np.cos(turn), 0.0, -np.sin(turn)])
                axis = np.cos(angle) * np.array([0.0, 1.0, 0.0]) - hand * np.sin(angle) * around
                place_text, axis_text = (" ".join(map(str, v)) for v in (0.085 * out, axis))
                parts.link(f"{name}_barrel_{k}", 0.05, urdf.shape('sphere radius="0.015"'))
                ends = (rim, f"{name}_barrel_{k}")
                parts.joint(f"{name}_spin_{k}", "continuous", ends, place_text, axis_text)
    return xml(parts)


def test_rollers_are_held_and_tell_mecanum_wheels(files: Files) -> None:
    robot = files.load(with_rollers(np.pi / 4), strict=True)
    assert robot.drive.type == "mecanum"
    assert robot.dof == 3
    assert len(robot.locked) == 32
    (told,) = infos(robot)
    assert told.message.startswith("32 rollers of front_left, front_right, rear_left, rear_right")
    assert "are at an angle to its axle" in robot.drive.evidence[0]
    assert [wheel.radius for wheel in robot.drive.wheels] == pytest.approx([0.1] * 4)
    assert {wheel.source for wheel in robot.drive.wheels} == {"its rollers"}
    assert rpctl.verify(robot, samples=1).passed
    named = files.load(xml(body_of_four("mecanum")))
    for wheel, other in zip(robot.drive.wheels, named.drive.wheels, strict=True):
        assert wheel.direction == pytest.approx(other.direction)


@pytest.mark.parametrize(("count", "rollers"), [(3, True), (2, False)])
def test_three_joints_on_a_wheel_are_rollers(files: Files, count: int, rollers: bool) -> None:
    parts = body()
    rear_axle(parts)
    for k in range(count):
        parts.link(f"part_{k}", 0.05, urdf.shape('sphere radius="0.01"'))
        ends = ("rear_left_link", f"part_{k}")
        parts.joint(f"joint_{k}", "continuous", ends, f"{0.09 - 0.05 * k} 0 0", "0 1 0")
    robot = files.load(parts, free=[] if rollers else ["rear_left"])
    assert len(robot.locked) == (count if rollers else 0)


def body_of_four(name: str) -> Parts:
    parts = body()
    for place, x in (("front", 0.25), ("rear", -0.25)):
        for side, y in SIDES:
            parts.wheel(f"{place}_{side}_{name}", "base", f"{x} {y} 0.1")
    return parts


def test_rollers_with_transmissions_are_held(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    for k in range(3):
        parts.link(f"part_{k}", 0.05, urdf.shape('sphere radius="0.01"'))
        ends = ("rear_left_link", f"part_{k}")
        parts.joint(f"joint_{k}", "continuous", ends, f"{0.09 - 0.05 * k} 0 0", "0 1 0")
        parts.xml.append(TRANSMISSION.format(f"joint_{k}"))
    parts.xml += [TRANSMISSION.format(name) for name in ("rear_left", "rear_right")]
    robot = files.load(parts)
    assert {*robot.locked} == {"joint_0", "joint_1", "joint_2"}
    assert robot.quasi_velocities == ("v", "omega")


def test_a_wheel_on_a_fork_of_a_level_axis_is_no_roller(files: Files) -> None:
    """Forks are round, too, and stand as high as their wheels; the wheels' names tell."""
    parts = body()
    for side, y in SIDES:
        parts.wheel(f"fork_{side}", "base", f"0 {y} 0.1")
        parts.wheel(f"wheel_{side}", f"fork_{side}_link", "0 0 -0.05", r=0.05)
    refusal_text = files.refusal(parts)
    assert '"wheel_left" hangs on "fork_left", which can move' in refusal_text
    assert "--lock 'fork_*'" in refusal_text


@pytest.mark.parametrize("legs", [2, 4])
def test_wheels_at_the_ends_of_legs_are_no_arms(files: Files, legs: int) -> None:
    """No name says wheel; what is held is named, and the robot stands on its wheels then."""
    parts = body(z=0.5)
    places = [(0.25, 0.3), (0.25, -0.3), (-0.25, 0.3), (-0.25, -0.3)][:legs]
    for k, (x, y) in enumerate(places):
        parts.link(f"shank_{k}", 1.0)
        parts.joint(f"knee_{k}", "revolute", ("base", f"shank_{k}"), f"{x} {y} 0.35", "0 1 0")
        parts.wheel(f"foot_{k}", f"shank_{k}", "0 0 -0.25")
    refusal_text = files.refusal(parts)
    assert "hang on joints that can move; hold these: --lock 'knee_*'" in refusal_text
    robot = files.load(parts, lock={"knee_*": 0.0})
    assert robot.drive.type == ("differential" if legs == 2 else "skid-steer")
    assert files.load(parts, "fixed").drive.type == "fixed"


def test_one_round_thing_at_the_end_of_an_arm_is_no_wheel(files: Files) -> None:
    parts = body(z=0.5)
    parts.link("shank", 1.0)
    parts.joint("knee", "revolute", ("base", "shank"), "0.25 0 0.35", "0 1 0")
    parts.wheel("foot", "shank", "0 0 -0.25")
    assert files.load(parts).drive.type == "fixed"


@pytest.mark.parametrize("told", ["transmission", "plugin"])
def test_casters_without_a_swivel_slide_like_balls(files: Files, told: str) -> None:
    """Beside wheels that have motors; P stays on the axle of these."""
    parts = base()
    for side, y in SIDES:
        parts.wheel(f"caster_{side}", "base", f"-0.4 {y} 0.1")
    inside = "<left_joint>rear_left</left_joint><right_joint>rear_right</right_joint>"
    if told == "transmission":
        parts.xml += [TRANSMISSION.format(name) for name in ("rear_left", "rear_right")]
        inside = ""
    robot = files.load(with_plugin(parts, plugin("libgazebo_ros_diff_drive.so", inside)))
    assert robot.drive.type == "differential"
    driven = {w.joint for w in robot.drive.wheels if w.driven}
    assert driven == {"rear_left", "rear_right"}
    assert {w.joint for w in robot.drive.wheels if w.slides} == {"caster_left", "caster_right"}
    assert rpctl.verify(robot, samples=3).passed


def test_a_swivel_that_carries_all_wheels_is_held(files: Files) -> None:
    parts = body(z=0.5)
    parts.swivel("hip", "0 0 0.4", "revolute")
    for side, y in SIDES:
        parts.wheel(f"wheel_{side}", "hip_fork", f"0 {y} -0.3")
    refusal_text = files.refusal(parts)
    assert "hip carries all wheels and so steers none: --lock hip" in refusal_text
    assert files.load(parts, lock={"hip": 0.0}).drive.type == "differential"


def test_wheels_5_mm_above_the_ground_and_with_limits_of_many_turns_are_wheels(
    files: Files,
) -> None:
    """Files write 0.0425 and 0.0375 m, whose difference is a bit more than 0.005."""
    parts = base()
    for side, y in SIDES:
        tyre = urdf.shape('cylinder radius="0.0375" length="0.04"', rpy=(np.pi / 2, 0, 0))
        parts.link(f"front_{side}_link", 1.0, tyre)
        ends, limit = ("base", f"front_{side}_link"), urdf.limit(-1000, 1000, 9, 9)
        parts.xml.append(
            urdf.joint(f"front_{side}", "revolute", ends, f"0.5 {y} 0.0425", "0 1 0", limit)
        )
    robot = files.load(parts, "skid-steer")
    assert len(robot.drive.wheels) == 4
    assert robot.quasi_velocities == ("v", "omega")


@pytest.mark.parametrize("z", [0.05, 0.6])
def test_a_head_that_swivels_is_no_caster(files: Files, z: float) -> None:
    parts = base()
    parts.link("head", 1.0, urdf.shape('sphere radius="0.05"'))
    parts.joint("head_swivel", "continuous", ("base", "head"), f"-0.3 0 {z}", "0 0 1")
    if z < 0.1:
        assert "is called a caster, but its wheel does not turn" in files.refusal(parts)
    else:
        assert files.load(parts).quasi_velocities == ("v", "omega", "head_swivel")


def test_wheels_that_are_steered_and_do_not_roll_are_asked_about(files: Files) -> None:
    """Taken for an arm's, they would slide on the ground as nothing does."""
    parts = base()
    for side, y in SIDES:
        tyre = urdf.shape('cylinder radius="0.1" length="0.04"', rpy=(np.pi / 2, 0, 0))
        parts.link(f"front_{side}_tyre", 1.0, tyre)
        ends = ("base", f"front_{side}_tyre")
        parts.joint(f"front_{side}", "revolute", ends, f"0.5 {y} 0.1", "0 0 1")
    refusal_text = files.refusal(parts)
    assert '"front_left", "front_right" steers a wheel that does not roll' in refusal_text
    assert 'joint about its axle between "front_left"' in refusal_text
    assert "--lock" not in refusal_text


@pytest.mark.parametrize("towed", [False, True])
def test_all_that_holds_a_wheel_is_named_at_once(files: Files, towed: bool) -> None:
    """A wheel on a slide, a turn and its steering: what hangs wheels itself is no such turn."""
    parts = base()
    parts.link("turn_link", 1.0)
    parts.joint("turn", "revolute", ("base", "turn_link"), "-0.5 0 0.2", "0 0 1")
    parts.link("slide_link", 1.0)
    parts.joint("slide", "prismatic", ("turn_link", "slide_link"), "0 0 0", "1 0 0", STRUT)
    parts.link("fork", 0.5)
    parts.joint("steer", "continuous", ("slide_link", "fork"), "-0.5 0 0", "0 0 1")
    parts.wheel("third", "fork", "-0.1 0 -0.1")
    if towed:
        parts.wheel("cart_left", "turn_link", "-0.3 0.3 -0.1")
        parts.wheel("cart_right", "turn_link", "-0.3 -0.3 -0.1")
    refusal = files.refusal(parts)
    assert ("--lock turn --lock slide" in refusal) is not towed
    assert "--lock slide" in refusal
    held = files.load(parts, lock=["slide"] if towed else ["slide", "turn"]).drive
    assert held.swivels[-1].role == "caster"
