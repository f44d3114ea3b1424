"""Wheels as they are found in the wild: what is one, how large it is, what the user is told."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh

from tests.drive.drive_cases import (
    Files,
    body,
    meshed,
    xml,
)
from tests.vehicles import rear_axle


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
    assert doubt.startswith('no shape tells the size of wheel "left" (mesh "gone.stl"')
    assert "its radius, 0.1 m, is the axle height" in doubt
    bare = re.sub("<visual>.*?</visual>", "", xml(parts))
    assert "error: no shape tells the size of wheel" in files.refusal(bare, strict=True)
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
    assert "is 0.04 m by 0.2 m across its axis, which no wheel is: correct the <axis>" in doubts[0]


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
