"""The drive file: it settles what a URDF leaves open, and is checked with the same care."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.drive.drive import WheelSpec, read_drive, suggest
from rpctl.errors import DescriptionError, DriveError, UnknownNameError
from tests.robots import SET_A, four_wheels, platform, write

GOOD = """
type = "differential"
[[wheel]]
joint = "left_joint"
radius = 0.2
[[wheel]]
joint = "right_joint"
"""


def file(tmp_path: Path, text: str) -> Path:
    return write(tmp_path, text, "drive.toml")


def test_it_gives_radii(tmp_path: Path) -> None:
    urdf = write(tmp_path, platform(SET_A))
    drive = rpctl.load(urdf, drive=file(tmp_path, GOOD)).drive
    assert [(w.radius, w.source.split(",")[0]) for w in drive.wheels] == [
        (0.2, "drive file"),
        (0.15, "collision cylinder"),
    ]
    assert rpctl.load(urdf, drive=str(file(tmp_path, GOOD))).drive == drive


def test_it_picks_two_wheels_out_of_four(tmp_path: Path) -> None:
    urdf = four_wheels(tmp_path, "skid-steer").description.path
    assert rpctl.load(urdf).drive.type == "skid-steer"
    assert rpctl.load(urdf, drive="mecanum").drive.type == "mecanum"
    two = rpctl.load(urdf, drive=file(tmp_path, GOOD))
    assert two.drive.type == "differential"
    assert "rear_left_joint" in two.quasi_velocities  # turns freely, as an arm's joint would
    (doubt,) = two.drive.doubts
    assert doubt.startswith(
        "rear_left_joint, rear_right_joint: the drive file does not name them as wheels"
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("type = ", "not TOML"),
        ('type = "tank"', 'type is "tank"; give differential or skid-steer'),
        ("", "type is missing; give one of"),
        (
            GOOD + "colour = 1",
            ":8: error: wheel[2].colour: setting 'colour' is not known; one of: joint",
        ),
        (
            'colour = 1\ntype = "fixed"',
            ":1: error: colour: setting 'colour' is not known; one of: type",
        ),
        (GOOD.replace("0.2", "-0.2"), "wheel[1]: radius is -0.2; give a positive number"),
        (GOOD.replace("0.2", "nan"), "wheel[1].radius: is nan; give a finite number"),
        (GOOD.replace("0.2", "true"), "wheel[1].radius: is True; give a number"),
        (GOOD.replace("right_joint", "left_joint"), 'joint "left_joint" is named twice'),
        (GOOD.replace('joint = "right_joint"', ""), "wheel[2]: missing: joint"),
        ('type = "fixed"\n[wheel]\njoint = "a"', "write [[wheel]]"),
    ],
)
def test_faults_are_named(tmp_path: Path, text: str, expected: str) -> None:
    path = file(tmp_path, text)
    with pytest.raises(DescriptionError) as caught:
        read_drive(path)
    assert expected in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_joints_have_to_fit(tmp_path: Path) -> None:
    urdf = write(tmp_path, platform(SET_A))
    with pytest.raises(UnknownNameError, match="wheel joint 'lefty' is not known; did you mean"):
        rpctl.load(urdf, drive=file(tmp_path, GOOD.replace("left_joint", "lefty")))
    urdf = write(tmp_path, platform(SET_A).replace('type="continuous"', 'type="fixed"', 1))
    with pytest.raises(DriveError, match=r'joint "left_joint" cannot carry a wheel'):
        rpctl.load(urdf, drive=file(tmp_path, GOOD))


def test_a_run_finds_its_drive_again(tmp_path: Path) -> None:
    robot = four_wheels(tmp_path, "mecanum")
    again = rpctl.Run.load(
        rpctl.track(robot, "line", duration=0.05).save(tmp_path / "r.npz")
    ).load_robot()
    assert again.drive == robot.drive


def test_the_start_is_a_drive_file(tmp_path: Path) -> None:
    spec = read_drive(file(tmp_path, suggest("differential", {"a": 0.2, "b": None})))
    assert spec.type == "differential"
    assert spec.wheels == {"a": WheelSpec("a"), "b": WheelSpec("b")}
