"""Robots as they are found in the wild: the drive that is found, or what the user is told."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import pytest
import trimesh

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.contact import find_contacts
from rpctl.errors import DescriptionError, DriveError, UnknownNameError
from tests.robots import write
from tests.vehicles import KINDS, Parts, caster, rear_axle, vehicle

TRANSMISSION = """<transmission name="{0}_drive"><type>simple</type><joint name="{0}"/>
  <actuator name="{0}_motor"/></transmission>"""


@dataclass(frozen=True)
class Files:
    """A folder for URDFs and drive files."""

    folder: Path

    def load(self, parts: Parts | str, drive: str = "", **options: object) -> Robot:
        xml = (
            parts if isinstance(parts, str) else f'<robot name="wild">{"".join(parts.xml)}</robot>'
        )
        path = write(self.folder, xml)
        told = write(self.folder, drive, "drive.toml") if "=" in drive else drive or None
        return rpctl.load(path, drive=told, **options)  # type: ignore[arg-type]

    def refusal(self, parts: Parts | str, drive: str = "", **options: object) -> str:
        with pytest.raises((DriveError, DescriptionError, UnknownNameError)) as caught:
            self.load(parts, drive, **options)
        return str(caught.value)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def body(z: float = 0.25, height: float = 0.3) -> Parts:
    """Return a base with a box for a body, without an arm; the ground is at z = 0."""
    parts = Parts([])
    shape = f'<collision><origin xyz="0 0 {z}"/><geometry><box size="0.6 0.4 {height}"/>'
    parts.link("base", 25.0, f"{shape}</geometry></collision>")
    return parts


def meshed(parts: Parts, name: str, xyz: str, axis: str = "0 1 0") -> None:
    """Add a wheel that only a mesh tells of, which is not there."""
    shape = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    parts.link(f"{name}_link", 1.0, shape)
    parts.joint(name, "continuous", ("base", f"{name}_link"), xyz, axis)


def xml(parts: Parts) -> str:
    return f'<robot name="wild">{"".join(parts.xml)}</robot>'


# Wheels that are nearly some.


def test_drive_wheels_on_fixed_joints(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    told = files.refusal(xml(parts).replace('"continuous"', '"fixed"'))
    assert "wheels are held by fixed joints; make" in told
    for name in ("rear_left", "rear_right"):
        line = rf'"{name}" \(line \d+\) type="continuous" with <axis xyz="0 1 0"/>'
        assert re.search(line, told)


def test_drive_wheels_on_fixed_joints_among_casters_that_turn(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    fixed = xml(parts).replace('"continuous"', '"fixed"').replace("</robot>", "")
    casters = Parts([])
    for k, (x, y) in enumerate([(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]):
        caster(casters, f"caster_{k}", x, y, 0.05, twin=False)
    told = files.refusal(fixed + "".join(casters.xml) + "</robot>")
    assert "wheels on swivels: caster_0 (caster), caster_1 (caster)" in told
    assert 'make "rear_left" (line 1) type="continuous" with <axis xyz="0 1 0"/>' in told


def test_fixed_wheels_of_meshes_are_known_by_their_names(files: Files) -> None:
    parts = body()
    meshed(parts, "left_wheel_joint", "0 0.3 0.1")
    meshed(parts, "right_wheel_joint", "0 -0.3 0.1")
    parts.link("mast", 1.0)
    parts.joint("mast_joint", "revolute", ("base", "mast"), "0 0 0.5", "0 0 1")
    told = files.refusal(xml(parts).replace('"continuous"', '"fixed"'))
    assert 'make "left_wheel_joint" (line 1) type="continuous" with its axle as <axis>' in told


def test_round_parts_that_are_fixed_are_no_wheels(files: Files) -> None:
    """Motors in the legs of a walking robot: others of its shapes reach lower."""
    parts = body()
    shape = f'<collision><origin rpy="{pi / 2} 0 0"/><geometry>'
    parts.link(
        "motor", 1.0, shape + '<cylinder radius="0.05" length="0.04"/></geometry></collision>'
    )
    parts.joint("motor_joint", "fixed", ("base", "motor"), "0.3 0.2 0.3", "0 1 0")
    parts.link("leg", 1.0)
    parts.joint("hip", "revolute", ("base", "leg"), "0.3 0.25 0.3", "0 1 0")
    assert files.load(parts).drive.type == "fixed"


@pytest.mark.parametrize("cylinders", [True, False])
def test_the_default_axis(files: Files, cylinders: bool) -> None:
    """(1 0 0) is across the line that joins the wheels; what is told to write is found."""
    parts = body()
    rear_axle(parts)
    good = xml(parts)
    bad = re.sub(r'<axis xyz="0 -?1 0"/>', "", good)
    if not cylinders:
        bad = re.sub(r"<collision><origin rpy.*?</collision>", "", bad)
    told = files.refusal(bad)
    reason = (
        "turn across their cylinders' axles" if cylinders else "across the line that joins them"
    )
    assert reason in told
    axes = dict(re.findall(r'"(rear_\w+)"[^<]*<axis xyz="([^"]*)"/>', told))
    assert axes == {"rear_left": "0 1 0", "rear_right": "0 1 0"}
    assert files.load(good).drive.heading == pytest.approx(0.0)


def test_the_default_axis_on_four_wheels_is_no_drive_sideways(files: Files) -> None:
    """With it the wheels of a side share a line, but their cylinders do not lie along it."""
    parts = body()
    rear_axle(parts, x=-0.25)
    front = Parts([])
    rear_axle(front, x=0.25)
    parts.xml += [part.replace("rear", "front") for part in front.xml]
    told = files.refusal(re.sub(r'<axis xyz="0 -?1 0"/>', "", xml(parts)), "skid-steer")
    assert told.count('<axis xyz="0 1 0"/>') == 4


def test_a_suspension_is_to_be_locked(files: Files) -> None:
    parts = body()
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.link(f"{side}_arm", 0.5)
        limits = '<limit lower="-0.02" upper="0.02" effort="100" velocity="1"/>'
        ends = ("base", f"{side}_arm")
        parts.joint(f"{side}_spring", "prismatic", ends, f"0 {y} 0.1", "0 0 1", limits)
        parts.wheel(f"{side}_wheel", f"{side}_arm", "0 0 0")
    told = files.refusal(parts)
    assert "left_wheel, right_wheel hang on joints that move, a suspension" in told
    assert "--lock left_spring --lock right_spring" in told
    robot = files.load(parts, lock=["*_spring"])
    assert robot.drive.type == "differential"
    assert robot.drive.doubts == ()


def test_a_roller_on_a_lift_hangs_on_no_suspension(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.link("lift", 1.0)
    limits = '<limit lower="0" upper="0.3" effort="100" velocity="1"/>'
    parts.joint("lift_joint", "prismatic", ("base", "lift"), "0 0 0.5", "0 0 1", limits)
    parts.wheel("roller", "lift", "0 0 0.1", r=0.05)
    robot = files.load(parts, strict=True)
    assert robot.quasi_velocities == ("v", "omega", "lift_joint", "roller")


def test_a_rocker_is_to_be_locked(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.link("rocker", 0.5)
    parts.joint("rocker_joint", "revolute", ("base", "rocker"), "0.4 0 0.2", "0 1 0")
    parts.wheel("front_wheel", "rocker", "0 0 -0.1")
    (doubt,) = files.load(parts).drive.doubts
    assert doubt.endswith("hold it: --lock rocker_joint")


def test_wheels_that_mimic_others(files: Files) -> None:
    """A rear wheel tied to the front one by a <mimic>: the ground would turn it, too."""
    text = xml(axles(0.25, -0.25))
    for side in ("left", "right"):
        start = text.index(f'<joint name="axle1_{side}"')
        end = text.index("</joint>", start)
        text = f'{text[:end]}<mimic joint="axle0_{side}"/>{text[end:]}'
    drive = files.load(text).drive
    assert (drive.type, len(drive.wheels)) == ("differential", 2)
    assert drive.doubts[0] == (
        '"axle1_left" mimics "axle0_left", so it is taken for no wheel; if it stands on the '
        "ground, take its <mimic> out (line 1)"
    )


def test_one_wheel_is_none(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    told = files.refusal(xml(parts).replace('"continuous"', '"fixed"', 1))
    assert '"rear_right": no other joint turns about a level axle: one alone is no wheel' in told
    assert 'make "rear_left" (line 1) type="continuous"' in told


# Radii.


def test_an_axle_a_millimetre_lower_than_the_radius(files: Files) -> None:
    parts = body()
    parts.wheel("left", "base", "0 0.3 0.099")
    parts.wheel("right", "base", "0 -0.3 0.0995")
    drive = files.load(parts).drive
    assert drive.type == "differential"
    assert [wheel.radius for wheel in drive.wheels] == [0.1, 0.1]
    assert drive.ground == pytest.approx(-0.00075)
    assert drive.wheels[0].why.endswith("ends 0.25 mm below the ground")


def test_meshes_that_are_not_there(files: Files) -> None:
    parts = body()
    meshed(parts, "left", "0 0.3 0.1")
    meshed(parts, "right", "0 -0.3 0.1")
    robot = files.load(parts)
    wheel, doubt = robot.drive.wheels[0], robot.drive.doubts[0]
    assert (wheel.radius, wheel.source) == (0.1, 'axle height over the root link "base"')
    assert doubt.startswith('no shape tells the size of wheel "left" (mesh "gone.stl"')
    assert "its radius, 0.1 m, is the axle height" in doubt
    bare = re.sub("<visual>.*?</visual>", "", xml(parts))
    assert "error: no shape tells the size of wheel" in files.refusal(bare, strict=True)
    sized = 'type = "differential"\n' + "".join(
        f'[[wheel]]\njoint = "{side}"\nradius = 0.09\n' for side in ("left", "right")
    )
    assert files.load(bare, sized, strict=True).drive.wheels[0].source == "drive file"


def test_meshes_that_are_not_there_on_a_root_in_the_middle_of_the_body(files: Files) -> None:
    parts = body(0.0)
    meshed(parts, "left", "0 0.3 -0.1")
    meshed(parts, "right", "0 -0.3 -0.1")
    told = files.refusal(parts)
    assert 'the radius of wheel "left_link" is not known' in told
    start = told.partition("(--drive FILE):\n")[2]
    assert files.load(parts, start.replace("# radius", "radius")).drive.wheels[0].radius == 0.1


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
    assert "is 0.04 m by 0.2 m across its axis, which no wheel is: correct the <axis>" in doubts[0]


# Roots and signs.


def test_a_root_called_world(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.xml.insert(0, '<link name="world"/>')
    parts.joint("anchor", "fixed", ("world", "base"), "0.5 0.2 0.3", "0 0 1")
    robot = files.load(parts)
    assert robot.drive.type == "differential"
    assert robot.drive.point == pytest.approx((0.5, 0.2))
    assert robot.drive.ground == pytest.approx(0.3)


def test_a_root_with_the_ground_in_it(files: Files) -> None:
    """A simulator's file: the world has a slab on which the wheels stand."""
    parts = body()
    rear_axle(parts)
    slab = (
        '<collision><origin xyz="0 0 -0.5"/><geometry><box size="90 90 1"/></geometry></collision>'
    )
    parts.xml.insert(0, f'<link name="world">{slab}</link>')
    parts.joint("anchor", "fixed", ("world", "base"), "0 0 0", "0 0 1")
    assert files.load(parts).drive.type == "differential"


def test_a_root_high_above_the_ground(files: Files) -> None:
    parts = body(-0.7)
    rear_axle(parts)
    high = xml(parts).replace('base"', 'pelvis"').replace('0.3 0.1"', '0.3 -0.9"')
    drive = files.load(high).drive
    assert drive.ground == pytest.approx(-1.0)
    assert [wheel.radius for wheel in drive.wheels] == [0.1, 0.1]


def test_opposite_axes(files: Files) -> None:
    """The right wheel's axis points right: it turns backward when the robot drives forward."""
    parts = body()
    rear_axle(parts)
    robot = files.load(parts)
    rates = ReducedDynamics(robot).actuation(robot.configuration()).T @ [1.0, 0.0]
    assert rates == pytest.approx([10.0, -10.0])


def test_negative_efforts(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    text = xml(parts).replace(
        '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><limit effort="-7" velocity="5"/>'
    )
    robot = files.load(text)
    assert robot.effort_limits.tolist() == [7.0, np.inf]
    assert any("effort limit -7" in finding.message for finding in robot.findings)


def test_a_revolute_joint_without_limits_is_a_wheels(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    endless = '<limit lower="-1e16" upper="1e16" effort="5" velocity="9"/>'
    text = xml(parts).replace('"continuous"', '"revolute"', 1)
    assert files.load(text).drive.type == "differential"  # no <limit> at all
    text = xml(parts).replace('<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/>{endless}')
    assert files.load(text.replace('"continuous"', '"revolute"', 1)).drive.type == "differential"


# What turns, and is no wheel.


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


def test_a_camera_that_pans_and_tilts_and_a_lidar(files: Files) -> None:
    parts = body()
    parts.link("lidar", 0.5)
    parts.joint("lidar_joint", "continuous", ("base", "lidar"), "0.2 0 0.6", "0 0 1")
    parts.link("neck", 0.5)
    parts.joint("pan", "continuous", ("base", "neck"), "0 0 0.5", "0 0 1")
    parts.wheel("tilt", "neck", "0 0 0.1", r=0.03)
    robot = files.load(parts)
    (doubt,) = robot.drive.doubts
    assert robot.drive.type == "fixed"
    assert '"tilt": the body reaches 0.47 m lower: no wheel' in doubt
    assert "say --drive fixed if it is" in doubt
    assert files.load(parts, "fixed", strict=True).drive.doubts == ()


def test_an_arm_of_continuous_joints_is_no_wheel(files: Files) -> None:
    parts = body()
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
        parent = f"link_{k - 1}" if k else "base"
        parts.link(f"link_{k}", 1.0)
        parts.joint(f"joint_{k}", "continuous", (parent, f"link_{k}"), "0 0 0.3", axis)
    robot = files.load(parts)
    assert robot.drive.type == "fixed"
    assert robot.drive.doubts[0].startswith("no joint could carry a wheel, so the base is taken")
    assert "say --drive fixed" in files.refusal(parts, strict=True)


def test_nothing_moves(files: Files) -> None:
    told = files.refusal(body())
    assert told.endswith(
        "no known drive: no joint could carry a wheel; it needs continuous joints about level "
        'axles that reach the ground, held by the root link "base"; make the wheels\' joints '
        'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
    )


# Casters.


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
        assert doubt.startswith(f'"{swivel.joint}" is taken for a caster')
    named = xml(parts).replace("pivot_", "caster_")
    assert files.load(named).drive.doubts == ()


def test_a_caster_with_limits_is_one_by_its_name(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.swivel("caster_front", "0.4 0 0.12", "revolute")
    parts.wheel("roller", "caster_front_fork", "-0.05 0 -0.07", r=0.05)
    drive = files.load(parts).drive
    assert drive.type == "differential"
    assert drive.doubts[0].endswith("a caster would run into its limits")
    steering = files.load(xml(parts).replace("caster_", "turn_")).drive
    assert (steering.type, steering.swivels[0].role) == ("tricycle", "steered")


def test_a_drive_file_tells_the_role(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    caster(parts, "pivot", 0.4, 0.0, 0.05, twin=False)
    said = 'type = "{}"\n[[swivel]]\njoint = "pivot"\nrole = "{}"\n'
    drive = files.load(parts, said.format("tricycle", "steered")).drive
    assert drive.base_speeds == ("v", "pivot")
    assert drive.swivels[0].why == "the drive file says so"
    assert files.load(parts, said.format("differential", "caster"), strict=True).dof == 2
    told = files.refusal(parts, said.format("differential", "steered"))
    assert "no differential drive: it takes one pair of wheels on one axle" in told


def test_a_powered_caster(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    caster(parts, "pivot", 0.4, 0.0, 0.05, twin=False)
    powered = 'type = "differential"\n[[swivel]]\njoint = "pivot"\nrole = "caster"\ndriven = true\n'
    robot = files.load(parts, powered)
    assert robot.actuators == ("rear_left", "rear_right", "pivot")
    assert rpctl.verify(robot, samples=2).passed
    # A transmission tells that it steers.
    parts.xml.append(TRANSMISSION.format("pivot"))
    drive = files.load(parts).drive
    assert (drive.type, drive.swivels[0].why) == ("tricycle", "a transmission drives it")


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
    assert robot.drive.wheels[2].why.endswith("a ball, which slides sideways, too")
    assert "balls, held by the root link: front_ball, rear_ball" in robot.drive.evidence
    # It rolls about its axle, so across the robot: with ω = 1 it moves at its lever arm.
    S = ReducedDynamics(robot).basis(robot.configuration())
    rate = S[robot.velocity_index("front_ball")] @ [0.0, 1.0]
    assert abs(rate) == pytest.approx(0.3 / 0.04)
    assert rpctl.verify(robot, samples=2).passed


def test_wheels_drawn_as_spheres_are_wheels(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    text = re.sub(r'<cylinder radius="0.1"[^>]*>', '<sphere radius="0.1"/>', xml(parts))
    drive = files.load(text).drive
    assert (drive.type, len(drive.wheels)) == ("differential", 2)
    # Two balls make a second axle of spheres, unless a name calls them so.
    balls = Parts([])
    for side, y in (("left", 0.1), ("right", -0.1)):
        balls.wheel(f"{side}_roll", "base", f"0.3 {y} 0.04", r=0.04)
    more = re.sub(r'<cylinder radius="0.04"[^>]*>', '<sphere radius="0.04"/>', "".join(balls.xml))
    text = text.replace("</robot>", f"{more}</robot>")
    assert "2 pairs of wheels on one axle" in files.refusal(text)
    called = files.load(text.replace("_roll", "_caster")).drive
    assert [wheel.slides for wheel in called.wheels] == [False, False, True, True]


def test_a_lone_wheel_beside_a_pair_rolls_along(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.wheel("third", "base", "0.5 0 0.05", r=0.05)
    robot = files.load(parts)
    assert robot.drive.type == "differential"
    assert robot.actuators == ("rear_left", "rear_right")
    assert "on axles of their own, held by the root link: third" in robot.drive.evidence
    third = robot.drive.wheels[-1]
    assert ReducedDynamics(robot).rolling.across == ((3, (0, 1)),)  # it takes no lateral force
    assert third.why.endswith("off the axle, so it rolls along, and slides sideways in bends")
    assert rpctl.verify(robot, samples=2).passed


def test_a_robot_that_balances(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    contacts = find_contacts(ReducedDynamics(files.load(parts)))
    assert contacts is not None
    assert not contacts.balanced
    assert "the planar model assumes balance and leaves pitch out" in contacts.notes[0]
    contacts = find_contacts(ReducedDynamics(files.load(vehicle("bicycle"))))
    assert contacts is not None
    assert "leaves roll out" in contacts.notes[0]


# What is driven.


def tricycle() -> Parts:
    parts = body()
    rear_axle(parts)
    parts.swivel("steer", "0.6 0 0.3", "revolute")
    parts.wheel("front", "steer_fork", "0 0 -0.2")
    return parts


def test_transmissions_tell_what_is_driven(files: Files) -> None:
    parts = tricycle()
    robot = files.load(parts)
    assert robot.actuators == ("rear_left", "rear_right", "steer")
    assert robot.drive.doubts[0].startswith("no transmission tells which wheels are driven")
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


def test_driven_flags(files: Files) -> None:
    said = 'type = "tricycle"\n'
    for name, yes in (("front", "true"), ("rear_left", "false"), ("rear_right", "false")):
        said += f'[[wheel]]\njoint = "{name}"\ndriven = {yes}\n'
    assert files.load(tricycle(), said).actuators == ("front", "steer")
    said += '[[swivel]]\njoint = "steer"\ndriven = false\n'
    assert files.load(tricycle(), said).actuators == ("front",)


# Swivels that mimic.


def hubs(mimic: str) -> Parts:
    parts = body()
    rear_axle(parts)
    for name, y, more in (("left", 0.25, mimic), ("right", -0.25, mimic)):
        parts.swivel(f"{name}_hub", f"0.7 {y} 0.1", "revolute", more=more)
        parts.wheel(f"front_{name}", f"{name}_hub_fork", "0 0 0")
    parts.link("cabin_wheel", 0.5)
    parts.joint("cabin_joint", "revolute", ("base", "cabin_wheel"), "0.3 0 0.6", "0.6 0 0.8")
    return parts


def test_hubs_that_mimic_what_is_no_swivel(files: Files) -> None:
    told = files.refusal(hubs('<mimic joint="cabin_joint" multiplier="0.1"/>'))
    assert 'the swivel "left_hub" mimics "cabin_joint", which steers no wheel' in told
    assert "take its <mimic> out" in told
    assert files.load(hubs("")).drive.type == "car-like"


def test_wheels_that_all_steer_do_not_mimic(files: Files) -> None:
    """Front and rear of a double Ackermann: in the model they follow without the mimic."""
    text, mimic = vehicle("steered"), '<mimic joint="fl_steer" multiplier="-1"/>'
    rear = text.index('<joint name="rl_steer"')
    end = text.index("</joint>", rear)
    told = files.refusal(text[:end] + mimic + text[end:])
    assert 'the swivel "rl_steer" mimics "fl_steer", but no multiple keeps all wheels on' in told


def test_a_mimic_of_a_mimic(files: Files) -> None:
    parts = hubs('<mimic joint="left_hub"/>')
    text = xml(parts).replace('<mimic joint="left_hub"/>', "", 1)
    extra = Parts([])
    extra.swivel("middle_hub", "0.9 0 0.1", "revolute", more='<mimic joint="right_hub"/>')
    extra.wheel("front_middle", "middle_hub_fork", "0 0 0")
    robot = files.load(text.replace("</robot>", "".join(extra.xml) + "</robot>"))
    assert [(s.role, s.shares) for s in robot.drive.swivels] == [
        ("steered", None),
        ("mimic", "left_hub"),
        ("mimic", "left_hub"),
    ]
    assert rpctl.verify(robot, samples=2).passed


def test_steering_that_is_locked_holds_its_wheel(files: Files) -> None:
    drive = files.load(tricycle(), lock=["steer"]).drive
    assert (drive.type, drive.swivels) == ("differential", ())
    assert [wheel.joint for wheel in drive.wheels if wheel.slides] == ["front"]


# Types that a drive file, or the option, has to tell.


def axles(*places: float) -> Parts:
    parts = body()
    for k, x in enumerate(places):
        axle = Parts([])
        rear_axle(axle, x=x)
        parts.xml += [part.replace("rear", f"axle{k}") for part in axle.xml]
    return parts


def rolling_speeds(robot: Robot, nu: list[float]) -> dict[str, float]:
    """Return φ̇ r (m/s) of each wheel, forward positive."""
    S = ReducedDynamics(robot).basis(robot.configuration())
    signs = {w.joint: float(np.sign(w.axis[1])) for w in robot.drive.wheels}
    return {
        w.joint: signs[w.joint] * w.radius * float(S[robot.velocity_index(w.joint)] @ nu)
        for w in robot.drive.wheels
    }


def test_six_wheels_skid(files: Files) -> None:
    robot = files.load(axles(0.3, 0.0, -0.3), "skid-steer")
    assert len(robot.drive.wheels) == 6
    assert robot.drive.point == pytest.approx((0.0, 0.0))
    for name, speed in rolling_speeds(robot, [0.5, 1.0]).items():
        assert speed == pytest.approx(0.5 - 0.3 if "left" in name else 0.5 + 0.3)
    assert rpctl.verify(robot, samples=2).passed


def test_skid_steer_with_an_effective_track_and_centre(files: Files) -> None:
    """φ̇ r = v ∓ ω track/2, and the centre of rotation alone does not slide sideways."""
    told = 'type = "skid-steer"\ntrack = 0.9\npoint = [0.05, 0.02]\n'
    robot = files.load(axles(0.25, -0.25), told)
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


def test_rollers_of_mecanum_wheels(files: Files) -> None:
    """At 45° the default; rollers at another angle c roll at vx + vy/tan c at each wheel."""
    default = files.load(axles(0.25, -0.25), "mecanum")
    lies = {"axle0_left": -1, "axle0_right": 1, "axle1_left": 1, "axle1_right": -1}

    def said(angle: float) -> str:
        wheels = (
            f'[[wheel]]\njoint = "{name}"\nroller_deg = {sign * angle}\n'
            for name, sign in lies.items()
        )
        return 'type = "mecanum"\n' + "".join(wheels)

    nu = [0.3, 0.2, -0.5]
    assert rolling_speeds(files.load(axles(0.25, -0.25), said(45)), nu) == pytest.approx(
        rolling_speeds(default, nu)
    )
    robot = files.load(axles(0.25, -0.25), said(30))
    for wheel in robot.drive.wheels:
        x, y = (0.25 if "0" in wheel.joint else -0.25), (0.3 if "left" in wheel.joint else -0.3)
        forward, left = 0.3 + 0.5 * y, 0.2 - 0.5 * x
        expected = forward + lies[wheel.joint] * np.tan(np.radians(30)) * left
        assert rolling_speeds(robot, nu)[wheel.joint] == pytest.approx(expected)


def test_four_wheels_and_no_word(files: Files) -> None:
    told = files.refusal(axles(0.25, -0.25))
    assert "nothing in a URDF tells skid-steer from mecanum wheels" in told
    start = told.partition("(--drive FILE):\n")[2]
    assert "# radius = 0.1  # m" in start
    assert files.load(axles(0.25, -0.25), start).drive.type == "skid-steer"
    named = xml(axles(0.25, -0.25)).replace('_link"', '_mecanum"')
    assert files.load(named).drive.type == "mecanum"


def test_free_steering_of_a_car(files: Files) -> None:
    """Each front wheel steers on its own; on average the two do not slip sideways."""
    robot = files.load(vehicle("car-like"), 'type = "car-like"\nsteering = "free"\n')
    assert robot.quasi_velocities == ("v", "steer_left", "steer_right", "arm_joint")
    both = robot.configuration(joints={"steer_left": 0.3, "steer_right": -0.3})  # axes differ
    omega = (ReducedDynamics(robot).basis(both) @ [1.0, 0.0, 0.0, 0.0])[2]
    assert omega == pytest.approx(np.tan(0.3) / 0.7)
    assert rpctl.verify(robot, samples=2).passed


@pytest.mark.parametrize(
    ("told", "reason"),
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
            "a fixed base has no wheel; leave [[wheel]]",
        ),
        ('type = "tricycle"\ntrack = 0.4', "track is of skid-steer drives only; leave it out"),
        ('type = "tricycle"\npoint = [0.1]', "point is [0.1]; give [x, y] in m"),
        ('type = "tricycle"\nsteering = "free"', "steering is of car-like drives only"),
        (
            'type = "tricycle"\n[[wheel]]\njoint = "front"\nroller_deg = 45',
            "wheel 1: roller_deg is of mecanum drives only",
        ),
        (
            'type = "mecanum"\n[[wheel]]\njoint = "front"\nroller_deg = 90',
            "roller_deg is 90; give degrees between -90 and 90",
        ),
        ('type = "tricycle"\n[[wheel]]\njoint = "front"\ndriven = 1', "give true or false"),
        ('type = "tricycle"\n[[swivel]]\njoint = "steer"\nrole = "free"', "use one of steered, c"),
        ('type = "omni"', "no omni drive: it takes three or more wheels, held by the root link"),
    ],
)
def test_a_drive_file_is_checked_with_the_same_care(files: Files, told: str, reason: str) -> None:
    assert reason in files.refusal(tricycle(), told)


@pytest.mark.parametrize("kind", [*KINDS, "skid-steer", "mecanum"])
def test_the_start_of_every_type_is_accepted(files: Files, kind: str) -> None:
    """What a refusal offers, its type put right, is the drive that would have been found."""
    from rpctl.robot.drive_file import suggest

    four = kind in ("skid-steer", "mecanum")
    text = xml(axles(0.25, -0.25)) if four else vehicle(kind)
    drive = files.load(text, kind if four else "").drive
    radii = {wheel.joint: wheel.radius for wheel in drive.wheels}
    roles = {s.joint: "caster" if s.role == "caster" else "steered" for s in drive.swivels}
    start = suggest(drive.type, radii, roles)
    again = files.load(text, start).drive
    assert (again.type, again.point, again.track) == (drive.type, drive.point, drive.track)
    assert [w.joint for w in again.wheels] == [w.joint for w in drive.wheels]
    assert [(s.joint, s.role) for s in again.swivels] == [(s.joint, s.role) for s in drive.swivels]
    sized = files.load(text, start.replace("# radius", "radius")).drive
    assert [w.radius for w in sized.wheels] == [w.radius for w in drive.wheels]
    assert {w.source for w in sized.wheels} == {"drive file"}


def test_the_kinds_are_found(files: Files) -> None:
    for kind, (found, speeds) in KINDS.items():
        drive = files.load(vehicle(kind)).drive
        assert (drive.type, drive.base_speeds) == (found, speeds)
