"""Wheels, swivels and drives as they are found in the wild, and what the user is told."""

from __future__ import annotations

import re
from math import atan2

import numpy as np
import pytest
import trimesh

import rpctl
from rpctl import ReducedDynamics
from tests import urdf
from tests.drive.drive_cases import (
    TRANSMISSION,
    Files,
    axles,
    body,
    meshed,
    rolling_speeds,
    tricycle,
    xml,
)
from tests.grids import cells
from tests.vehicles import KINDS, caster, rear_axle, vehicle


def test_drive_wheels_on_fixed_joints(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    refusal_text = files.refusal(xml(parts).replace('"continuous"', '"fixed"'))
    assert "wheels are held by fixed joints; make" in refusal_text
    for name in ("rear_left", "rear_right"):
        line = rf'"{name}" \(line \d+\) type="continuous" with <axis xyz="0 1 0"/>'
        assert re.search(line, refusal_text)


def test_fixed_wheels_of_meshes_are_known_by_their_names(files: Files) -> None:
    parts = body()
    meshed(parts, "left_wheel_joint", "0 0.3 0.1")
    meshed(parts, "right_wheel_joint", "0 -0.3 0.1")
    parts.link("mast", 1.0)
    parts.joint("mast_joint", "revolute", ("base", "mast"), "0 0 0.5", "0 0 1")
    refusal_text = files.refusal(xml(parts).replace('"continuous"', '"fixed"'))
    assert (
        'make "left_wheel_joint" (line 1) type="continuous" with its axle as <axis>' in refusal_text
    )


@pytest.mark.parametrize("cylinders", [True, False])
def test_the_default_axis(files: Files, cylinders: bool) -> None:
    """(1 0 0) is across the line that joins the wheels; what is told to write is found."""
    parts = body()
    rear_axle(parts)
    good = xml(parts)
    bad = re.sub(r'<axis xyz="0 -?1 0"/>', "", good)
    if not cylinders:
        bad = re.sub(r"<collision><origin rpy.*?</collision>", "", bad)
    refusal_text = files.refusal(bad)
    reason = (
        "turn across their cylinders' axles" if cylinders else "across the line that joins them"
    )
    assert reason in refusal_text
    axes = dict(re.findall(r'"(rear_\w+)"[^<]*<axis xyz="([^"]*)"/>', refusal_text))
    assert axes == {"rear_left": "0 1 0", "rear_right": "0 1 0"}
    assert files.load(good).drive.heading == pytest.approx(0.0)


def test_a_roller_on_a_lift_hangs_on_no_suspension(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.link("lift", 1.0)
    limits = '<limit lower="0" upper="0.3" effort="100" velocity="1"/>'
    parts.joint("lift_joint", "prismatic", ("base", "lift"), "0 0 0.5", "0 0 1", limits)
    parts.wheel("roller", "lift", "0 0 0.1", r=0.05)
    robot = files.load(parts, strict=True)
    assert robot.quasi_velocities == ("v", "omega", "lift_joint", "roller")


def test_one_wheel_is_none(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    refusal_text = files.refusal(xml(parts).replace('"continuous"', '"fixed"', 1))
    assert (
        '"rear_right": no other joint turns about a level axle: one alone is no wheel'
        in refusal_text
    )
    assert 'make "rear_left" (line 1) type="continuous"' in refusal_text


def test_meshes_that_are_not_there(files: Files) -> None:
    parts = body()
    meshed(parts, "left", "0 0.3 0.1")
    meshed(parts, "right", "0 -0.3 0.1")
    robot = files.load(parts)
    wheel, doubt = robot.drive.wheels[0], robot.drive.doubts[0]
    assert (wheel.radius, wheel.source) == (0.1, 'axle height over the root link "base"')
    assert doubt.startswith('no shape gives the size of wheel "left" (mesh "gone.stl"')
    assert "its radius, 0.1 m, is the axle height" in doubt
    bare = re.sub("<visual>.*?</visual>", "", xml(parts))
    assert "error: no shape gives the size of wheel" in files.refusal(bare, strict=True)
    sized = 'type = "differential"\n' + "".join(
        f'[[wheel]]\njoint = "{side}"\nradius = 0.09\n' for side in ("left", "right")
    )
    assert files.load(bare, sized, strict=True).drive.wheels[0].source == "drive file"


def test_a_mesh_that_is_not_round_about_its_axis(files: Files) -> None:
    """Of four wheels with the default axis those of a side share a line: only the mesh tells."""
    lying = np.eye(4)[[0, 2, 1, 3]] * [[1.0], [-1.0], [1.0], [1.0]]  # turns z to −y
    disc = trimesh.creation.cylinder(radius=0.1, height=0.04, transform=lying)
    disc.export(files.folder / "disc.stl")
    parts = body()
    for x, y in ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)):
        meshed(parts, f"wheel_{x}_{y}", f"{x} {y} 0.1")
    text = xml(parts).replace("gone.stl", "disc.stl")
    assert files.load(text, "skid-steer").drive.doubts == ()
    doubts = files.load(text.replace('<axis xyz="0 1 0"/>', ""), "skid-steer").drive.doubts
    assert len(doubts) == 4
    assert (
        "is 0.04 m by 0.2 m across its axis, so it is not a wheel: correct the <axis>" in doubts[0]
    )


def test_a_root_high_above_the_ground(files: Files) -> None:
    parts = body(-0.7)
    rear_axle(parts)
    high = xml(parts).replace('base"', 'pelvis"').replace('0.3 0.1"', '0.3 -0.9"')
    drive = files.load(high).drive
    assert drive.ground == pytest.approx(-1.0)
    assert [wheel.radius for wheel in drive.wheels] == [0.1, 0.1]


def test_a_revolute_joint_without_limits_is_a_wheels(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    endless = '<limit lower="-1e16" upper="1e16" effort="5" velocity="9"/>'
    text = xml(parts).replace('"continuous"', '"revolute"', 1)
    assert files.load(text).drive.type == "differential"  # no <limit> at all
    text = xml(parts).replace('<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/>{endless}')
    assert files.load(text.replace('"continuous"', '"revolute"', 1)).drive.type == "differential"


def test_ackermann_hubs_among_passive_joints(files: Files) -> None:
    """A lidar spins, a steering wheel turns in the cabin, the hubs have no limits."""
    parts = body()
    rear_axle(parts)
    for side, y in (("left", 0.25), ("right", -0.25)):
        parts.swivel(f"{side}_hub", f"0.7 {y} 0.1", "continuous")
        parts.wheel(f"front_{side}", f"{side}_hub_fork", "0 0.02 0")
    parts.link("lidar", 0.5)
    parts.joint("lidar_joint", "continuous", ("base", "lidar"), "0.2 0 0.6", "0 0 1")
    parts.link("cabin_wheel", 0.5)
    parts.joint("cabin_joint", "continuous", ("base", "cabin_wheel"), "0.3 0 0.6", "0.6 0 0.8")
    robot = files.load(parts)
    assert robot.drive.type == "car-like"
    assert robot.quasi_velocities == ("v", "left_hub", "lidar_joint", "cabin_joint")
    assert [s.role for s in robot.drive.swivels] == ["steered", "follower"]


def test_an_arm_of_continuous_joints_is_no_wheel(files: Files) -> None:
    parts = body()
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
        parent = f"link_{k - 1}" if k else "base"
        parts.link(f"link_{k}", 1.0)
        parts.joint(f"joint_{k}", "continuous", (parent, f"link_{k}"), "0 0 0.3", axis)
    robot = files.load(parts)
    assert robot.drive.type == "fixed"
    assert robot.drive.doubts[0].startswith(
        "no joint can carry a wheel, so rpctl assumes a fixed base"
    )
    assert "give --drive fixed" in files.refusal(parts, strict=True)


def test_nothing_moves(files: Files) -> None:
    refusal_text = files.refusal(body())
    assert refusal_text.endswith(
        "no known drive: no joint can carry a wheel; it needs continuous joints about level "
        'axles that reach the ground, held by the root link "base"; make the wheels\' joints '
        'type="continuous" with the axle as <axis>, or give --drive fixed for an arm'
    )


def test_two_drive_wheels_among_four_casters(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    places = [(0.4, 0.2), (0.4, -0.2), (-0.4, 0.2), (-0.4, -0.2)]
    for k, (x, y) in enumerate(places):
        caster(parts, f"pivot_{k}", x, y, 0.05, twin=k > 1)
    drive = files.load(parts).drive
    assert drive.type == "differential"
    assert [wheel.joint for wheel in drive.wheels if wheel.driven] == ["rear_left", "rear_right"]
    assert [len(drive.carried(swivel)) for swivel in drive.swivels] == [1, 1, 2, 2]
    assert [s.role for s in drive.swivels] == ["caster"] * 4
    for swivel, doubt in zip(drive.swivels, drive.doubts, strict=True):
        assert swivel.trail == pytest.approx(-0.05)
        assert doubt.startswith(f'"{swivel.joint}" is treated as a caster')
    named = xml(parts).replace("pivot_", "caster_")
    assert files.load(named).drive.doubts == ()


def test_a_drive_file_tells_the_role(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    caster(parts, "pivot", 0.4, 0.0, 0.05, twin=False)
    drive_file = 'type = "{}"\n[[swivel]]\njoint = "pivot"\nrole = "{}"\n'
    drive = files.load(parts, drive_file.format("tricycle", "steered")).drive
    assert drive.base_speeds == ("v", "pivot")
    assert drive.swivels[0].why == "the drive file says so"
    assert files.load(parts, drive_file.format("differential", "caster"), strict=True).dof == 2
    refusal_text = files.refusal(parts, drive_file.format("differential", "steered"))
    assert "no differential drive: it takes one pair of wheels on one axle" in refusal_text


def test_balls_on_continuous_joints(files: Files) -> None:
    """Front and rear ball make no second axle, and no drive of four wheels."""
    parts = body()
    rear_axle(parts)
    for name, x in (("front_ball", 0.3), ("rear_ball", -0.3)):
        shape = '<collision><geometry><sphere radius="0.04"/></geometry></collision>'
        parts.link(f"{name}_link", 0.2, shape)
        parts.joint(name, "continuous", ("base", f"{name}_link"), f"{x} 0 0.04", "1 0 0")
    robot = files.load(parts)
    assert robot.drive.type == "differential"
    assert robot.actuators == ("rear_left", "rear_right")
    assert robot.drive.wheels[2].why.endswith("a ball, which also slides sideways")
    assert "balls, held by the root link: front_ball, rear_ball" in robot.drive.evidence
    # It rolls about its axle, so across the robot: with ω = 1 it moves at its lever arm.
    S = ReducedDynamics(robot).basis(robot.configuration())
    rate = S[robot.velocity_index("front_ball")] @ [0.0, 1.0]
    assert abs(rate) == pytest.approx(0.3 / 0.04)
    assert rpctl.verify(robot, samples=2).passed


def test_a_lone_wheel_rolls_its_own_way_and_leaves_the_heading_to_the_pair(files: Files) -> None:
    """Rolling directions are across the axles, (a_y, -a_x), the axle turned to the left."""
    for axle, direction in (
        ("0.6 0.8 0", (0.8, -0.6)),
        ("0.6 -0.8 0", (0.8, 0.6)),
        ("0 1 0", (1.0, 0.0)),
        ("1 0.001 0", (0.0, 1.0)),  # across the pair's: left of it is no side of the pair
    ):
        parts = body()
        parts.wheel("lone", "base", "0.5 0.1 0.1", axle, turn=atan2(*direction[::-1]))
        parts.wheel("left", "base", "0 0.3 0.1")
        parts.wheel("right", "base", "0 -0.3 0.1")
        drive = files.load(parts, 'type = "differential"\n').drive
        assert drive.heading == 0.0
        lone = next(wheel for wheel in drive.wheels if wheel.joint == "lone")
        assert lone.slides
        assert lone.direction == pytest.approx(direction, abs=2e-3)
        assert "-0.0" not in map(str, lone.direction)


def test_transmissions_tell_what_is_driven(files: Files) -> None:
    parts = tricycle()
    robot = files.load(parts)
    assert robot.actuators == ("rear_left", "rear_right", "steer")
    assert robot.drive.doubts[0].startswith("no transmission says which wheels are driven")
    parts.xml += [TRANSMISSION.format(name) for name in ("front", "steer")]
    robot = files.load(parts, strict=True)
    assert robot.actuators == ("front", "steer")
    assert rpctl.verify(robot, samples=2).passed


def test_effort_limits_tell_what_is_driven(files: Files) -> None:
    limit = '<axis xyz="0 1 0"/><limit effort="20" velocity="30"/></joint>'
    text = xml(tricycle())
    front = text.index('<joint name="front"')
    text = text[:front] + text[front:].replace('<axis xyz="0 1 0"/></joint>', limit)
    robot = files.load(text, strict=True)
    assert robot.actuators == ("front", "steer")


def test_wheels_that_all_steer_do_not_mimic(files: Files) -> None:
    """Front and rear of a double Ackermann: in the model they follow without the mimic."""
    text, mimic = vehicle("steered"), '<mimic joint="fl_steer" multiplier="-1"/>'
    rear = text.index('<joint name="rl_steer"')
    end = text.index("</joint>", rear)
    refusal_text = files.refusal(text[:end] + mimic + text[end:])
    assert (
        'the swivel "rl_steer" mimics "fl_steer", but no multiple keeps all wheels on'
        in refusal_text
    )


def test_steering_that_is_locked_holds_its_wheel(files: Files) -> None:
    drive = files.load(tricycle(), lock=["steer"]).drive
    assert (drive.type, drive.swivels) == ("differential", ())
    assert [wheel.joint for wheel in drive.wheels if wheel.slides] == ["front"]


def test_six_wheels_skid(files: Files) -> None:
    robot = files.load(axles(0.3, 0.0, -0.3), "skid-steer")
    assert len(robot.drive.wheels) == 6
    assert robot.drive.point == pytest.approx((0.0, 0.0))
    for name, speed in rolling_speeds(robot, [0.5, 1.0]).items():
        assert speed == pytest.approx(0.5 - 0.3 if "left" in name else 0.5 + 0.3)
    assert rpctl.verify(robot, samples=2).passed


def test_skid_steer_with_an_effective_track_and_centre(files: Files) -> None:
    """φ̇ r = v ∓ ω track/2, and the centre of rotation alone does not slide sideways."""
    drive_text = 'type = "skid-steer"\ntrack = 0.9\npoint = [0.05, 0.02]\n'
    robot = files.load(axles(0.25, -0.25), drive_text)
    assert robot.drive.track == 0.9
    assert robot.drive.point == (0.05, 0.02)
    v, omega = 0.5, 0.8
    speeds = rolling_speeds(robot, [v, omega])
    for name, speed in speeds.items():
        # P is 0.02 m left of the middle between the sides.
        assert speed == pytest.approx(v + omega * (0.02 + (-0.45 if "left" in name else 0.45)))
    S = ReducedDynamics(robot).basis(robot.configuration())
    assert (S @ [v, omega])[:3] == pytest.approx([v + 0.02 * omega, -0.05 * omega, omega])
    assert rpctl.verify(robot, samples=2).passed


@pytest.mark.parametrize("track", [0.9, 0.5])
def test_contacts_stand_half_an_effective_track_from_the_middle(files: Files, track: float) -> None:
    """φ̇ r = ∓ ω track/2, whether the track is wider than the 0.6 m of the file or narrower."""
    robot = files.load(axles(0.25, -0.25), f'type = "skid-steer"\ntrack = {track}\n')
    for name, speed in rolling_speeds(robot, [0.0, 1.0]).items():
        assert speed == pytest.approx((-0.5 if "left" in name else 0.5) * track)


def test_rollers_of_mecanum_wheels(files: Files) -> None:
    """At 45° the default; rollers at another angle c roll at vx + vy/tan c at each wheel."""
    default = files.load(axles(0.25, -0.25), "mecanum")
    lies = {"axle0_left": -1, "axle0_right": 1, "axle1_left": 1, "axle1_right": -1}

    def roller_drive_file(angle: float) -> str:
        wheels = (
            f'[[wheel]]\njoint = "{name}"\nroller_deg = {sign * angle}\n'
            for name, sign in lies.items()
        )
        return 'type = "mecanum"\n' + "".join(wheels)

    nu = [0.3, 0.2, -0.5]
    assert rolling_speeds(
        files.load(axles(0.25, -0.25), roller_drive_file(45)), nu
    ) == pytest.approx(rolling_speeds(default, nu))
    robot = files.load(axles(0.25, -0.25), roller_drive_file(30))
    for wheel in robot.drive.wheels:
        x, y = (0.25 if "0" in wheel.joint else -0.25), (0.3 if "left" in wheel.joint else -0.3)
        forward, left = 0.3 + 0.5 * y, 0.2 - 0.5 * x
        expected = forward + lies[wheel.joint] * np.tan(np.radians(30)) * left
        assert rolling_speeds(robot, nu)[wheel.joint] == pytest.approx(expected)


def test_free_steering_of_a_car(files: Files) -> None:
    """Each front wheel steers on its own; on average the two do not slip sideways."""
    robot = files.load(vehicle("car-like"), 'type = "car-like"\nsteering = "free"\n')
    assert robot.quasi_velocities == ("v", "steer_left", "steer_right", "arm_joint")
    both = robot.configuration(joints={"steer_left": 0.3, "steer_right": -0.3})  # axes differ
    omega = (ReducedDynamics(robot).basis(both) @ [1.0, 0.0, 0.0, 0.0])[2]
    assert omega == pytest.approx(np.tan(0.3) / 0.7)
    assert rpctl.verify(robot, samples=2).passed


@pytest.mark.parametrize(
    ("drive_text", "reason"),
    [
        (
            'type = "car-like"\n[[wheel]]\njoint = "frnt"',
            "wheel joint 'frnt' is not known; did you",
        ),
        (
            'type = "car-like"\n[[swivel]]\njoint = "stear"',
            "swivel joint 'stear' is not known; did",
        ),
        ('type = "tricycle"\n[[swivel]]\njoint = "rear_left"', 'joint "rear_left" is no swivel'),
        ('type = "tricycle"\n[[wheel]]\njoint = "steer"', 'joint "steer" cannot carry a wheel'),
        (
            'type = "fixed"\n[[wheel]]\njoint = "front"',
            "a fixed base has no wheel; leave out [[wheel]]",
        ),
        ('type = "tricycle"\ntrack = 0.4', "track applies to skid-steer drives only; leave it out"),
        ('type = "tricycle"\npoint = [0.1]', "point: is [0.1]; give 2 numbers"),
        ('type = "tricycle"\nsteering = "free"', "steering applies to car-like drives only"),
        (
            'type = "tricycle"\n[[wheel]]\njoint = "front"\nroller_deg = 45',
            "roller_deg applies to mecanum drives only",
        ),
        (
            'type = "mecanum"\n[[wheel]]\njoint = "front"\nroller_deg = 90',
            "roller_deg is 90; give degrees between -90 and 90",
        ),
        ('type = "tricycle"\n[[wheel]]\njoint = "front"\ndriven = 1', "give true or false"),
        (
            'type = "tricycle"\n[[swivel]]\njoint = "steer"\nrole = "free"',
            'role is "free"; give steered or caster',
        ),
        ('type = "omni"', "no omni drive: it takes three or more wheels, held by the root link"),
    ],
)
def test_a_drive_file_is_checked_with_the_same_care(
    files: Files, drive_text: str, reason: str
) -> None:
    assert reason in files.refusal(tricycle(), drive_text)


STARTS = [*KINDS, "skid-steer", "mecanum"]


@pytest.mark.parametrize("kind", cells(STARTS, {*STARTS} - {"twin", "parallel", "mecanum"}))
def test_the_start_of_every_type_is_accepted(files: Files, kind: str) -> None:
    """What a refusal offers, its type put right, is the drive that would have been found."""
    from rpctl.drive.drive import suggest

    four = kind in ("skid-steer", "mecanum")
    text = xml(axles(0.25, -0.25)) if four else vehicle(kind)
    drive = files.load(text, kind if four else "").drive
    radii = {wheel.joint: wheel.radius for wheel in drive.wheels}
    roles = {s.joint: s.role if s.trails else "steered" for s in drive.swivels}
    start = suggest(drive.type, radii, roles)
    again = files.load(text, start).drive
    assert (again.type, again.point, again.track) == (drive.type, drive.point, drive.track)
    assert [w.joint for w in again.wheels] == [w.joint for w in drive.wheels]
    assert [(s.joint, s.role) for s in again.swivels] == [(s.joint, s.role) for s in drive.swivels]
    sized = files.load(text, start.replace("# radius", "radius")).drive
    assert [w.radius for w in sized.wheels] == [w.radius for w in drive.wheels]
    assert {w.source for w in sized.wheels} == {"drive file"}


def test_a_body_drawn_through_the_ground(files: Files) -> None:
    """A box that is drawn on its side reaches below the wheels; its collision shape does not."""
    parts = axles(0.2, -0.2)
    drawn = urdf.shape('box size="0.6 0.9 0.3"', "visual", xyz=(0, 0, 0.1), rpy=(np.pi / 2, 0, 0))
    parts.xml[0] = parts.xml[0].replace("</link>", f"{drawn}</link>")
    assert files.load(parts, "skid-steer").drive.ground == pytest.approx(0.0, abs=1e-12)
    parts.xml[0] = re.sub("<collision>.*?</collision>", "", parts.xml[0])
    assert '"axle0_left": the body reaches 0.35 m lower' in files.load(parts).drive.doubts[0]
