"""Detection: which wheels, how large, where forward is, and why not."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import DriveError
from tests.robots import SET_A, platform, write

GOOD = platform(SET_A)


def load(tmp_path: Path, text: str) -> Robot:
    return rpctl.load(write(tmp_path, text))


def test_tiago(tiago: Robot) -> None:
    drive = tiago.drive
    assert drive.type == "differential"
    assert [wheel.joint for wheel in drive.wheels] == ["wheel_left_joint", "wheel_right_joint"]
    assert [wheel.radius for wheel in drive.wheels] == [0.0985, 0.0985]
    assert drive.track == pytest.approx(0.4044)
    assert drive.point == (0.0, 0.0)
    assert drive.ground == pytest.approx(0.0, abs=1e-15)


def test_left_is_left_whatever_the_signs_and_the_order(tmp_path: Path) -> None:
    flipped = load(tmp_path, platform(SET_A, right_sign=-1))
    assert [w.joint for w in flipped.drive.wheels] == ["left_joint", "right_joint"]
    assert flipped.drive.heading == 0.0


def test_forward_follows_the_axle(tmp_path: Path) -> None:
    text = GOOD.replace('origin xyz="0 0.75', 'origin xyz="-0.75 0')
    text = text.replace('origin xyz="0 -0.75', 'origin xyz="0.75 0').replace("0 1 0", "1 0 0")
    text = text.replace('rpy="1.5707963267948966 0 0"', 'rpy="0 1.5707963267948966 0"')
    drive = load(tmp_path, text).drive
    assert drive.heading == pytest.approx(math.pi / 2)
    assert drive.wheels[0].joint == "left_joint"


def test_the_heading_is_across_the_mean_of_the_axles(tmp_path: Path) -> None:
    """An axle turned by ψ rolls along ψ: the mean of two unit vectors halves their angle."""
    toe = math.radians(0.8)
    for left, right, heading in (
        (toe, 0.0, 0.5 * toe),
        (0.0, toe, 0.5 * toe),
        (toe, -toe, 0.0),
        (toe + math.pi, 0.0, 0.5 * toe),  # an axis that points right tells the same axle
        (toe, math.pi, 0.5 * toe),
    ):
        text = GOOD
        for angle in (left, right):
            axis = f'<axis xyz="{-math.sin(angle)!r} {math.cos(angle)!r} 0" />'
            text = text.replace('<axis xyz="0 1 0"/>', axis, 1)
        drive = load(tmp_path, text).drive
        assert drive.heading == pytest.approx(heading, abs=1e-15)
        ahead = (math.cos(heading), math.sin(heading))
        assert all(wheel.direction == pytest.approx(ahead, abs=1e-15) for wheel in drive.wheels)


def test_wheels_that_slide_along_have_no_say_in_the_heading(tmp_path: Path) -> None:
    stray = GOOD[GOOD.index('<link name="left_wheel">') : GOOD.index('<link name="right_wheel">')]
    stray = stray.replace("left_", "stray_").replace('xyz="0 0.75', 'xyz="-0.9 0')
    stray = stray.replace('<axis xyz="0 1 0"/>', '<axis xyz="-0.01 1 0"/>')
    drive = load(tmp_path, GOOD.replace("</robot>", f"{stray}</robot>")).drive
    assert [wheel.slides for wheel in drive.wheels] == [False, False, True]
    assert drive.heading == 0.0


def test_a_radius_that_nothing_tells_is_asked_for(tmp_path: Path) -> None:
    bare = re.sub(r"<collision>.*?</collision>", "", GOOD, flags=re.DOTALL)
    bare = bare.replace('0.75 0.15"/>', '0.75 -0.1"/>')
    with pytest.raises(DriveError, match=r':\d+: the radius of wheel "left_wheel" is not known'):
        load(tmp_path, bare)


def test_a_spinning_lidar_is_no_wheel(tmp_path: Path) -> None:
    lidar = """<link name="lidar"><inertial><mass value="1"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
      <joint name="lidar_joint" type="continuous"><parent link="base"/><child link="lidar"/>
      <axis xyz="0 0 1"/></joint>"""
    robot = load(tmp_path, platform(SET_A, extra=lidar))
    assert robot.quasi_velocities == ("v", "omega", "lidar_joint")


def test_wheels_at_right_angles_to_their_axle_are_told(tmp_path: Path) -> None:
    """What it says to write is right, in the joint's own frame."""
    wrong = re.sub(r"<collision>.*?</collision>", "", GOOD, flags=re.DOTALL)
    wrong = wrong.replace("0 1 0", "1 0 0")
    wrong = wrong.replace('xyz="0 0.75 0.15"', 'xyz="0 0.75 0.15" rpy="0 0 1.5707963267948966"')
    wrong = wrong.replace("1 0 0", "0 1 0", 1)
    with pytest.raises(DriveError, match=r'no two wheels share one axle.*"left_joint" \(line') as e:
        load(tmp_path, wrong)
    left, right = re.findall(r'<axis xyz="([^"]*)"/>', str(e.value))
    assert (left, right) == ("1 0 0", "0 1 0")


def test_p_is_midway_between_the_outermost_of_three_wheels(tmp_path: Path) -> None:
    """Wheels at .75, .55 and −.45 m: P at .15 m, not at their mean; track 1.2 m."""
    middle = GOOD[GOOD.index('<link name="left_wheel">') : GOOD.index('<link name="right_wheel">')]
    middle = middle.replace("left_", "middle_").replace("0 0.75", "0 0.55")
    text = platform(SET_A, extra=middle).replace("0 -0.75", "0 -0.45")
    drive = load(tmp_path, text).drive
    assert [wheel.joint for wheel in drive.wheels] == ["left_joint", "middle_joint", "right_joint"]
    assert drive.point == pytest.approx((0.0, 0.15))
    assert drive.track == pytest.approx(1.2)
