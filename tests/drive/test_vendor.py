"""What plugins and controllers say of the wheels, beside what the geometry gives."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl import Robot
from rpctl.drive import controls as controller_files
from rpctl.errors import Finding
from tests.drive.drive_cases import Files, axles, body, xml
from tests.drive.test_parallel_wheels import plugin, with_plugin
from tests.robots import write
from tests.vehicles import rear_axle

SIDES = """
  left_wheel: ['axle0_left', 'axle1_left']
  right_wheel: ['axle0_right', 'axle1_right']
"""


def told(robot: Robot) -> list[Finding]:
    return [f for f in robot.findings if "plugin" in f.message or "controller" in f.message]


def differential() -> str:
    parts = body()
    rear_axle(parts)
    return xml(parts)


def driven(inside: str, file: str = "libgazebo_ros_diff_drive.so") -> str:
    return differential().replace("</robot>", "\n" + plugin(file, inside))


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ("<wheelDiameter>0.26</wheelDiameter>", "has wheels of radius 0.13 m, where"),
        ("<wheel_radius>0.12</wheel_radius>", "has wheels of radius 0.12 m, where"),
        ("<wheelSeparation>0.5</wheelSeparation>", "has the wheels 0.5 m apart, the geometry 0.6"),
    ],
)
def test_lengths_that_differ_are_warned_of_with_their_line(
    files: Files, inside: str, message: str
) -> None:
    (found,) = told(files.load(driven(inside)))
    assert (found.severity, found.line) == ("warning", 2)
    assert found.message.startswith('plugin "libgazebo_ros_diff_drive.so" ' + message)


@pytest.mark.parametrize(
    "inside",
    [
        "<wheelDiameter>0.201</wheelDiameter><wheelSeparation>0.604</wheelSeparation>",
        "<wheel_radius>${radius}</wheel_radius><wheel_separation>-1</wheel_separation>",
        "",
    ],
)
def test_lengths_that_agree_or_are_none_are_not_told(files: Files, inside: str) -> None:
    assert told(files.load(driven(inside), strict=True)) == []


def test_a_joint_that_a_plugin_drives_as_a_wheel_is_none_of_an_arm(files: Files) -> None:
    """Two drums high above the ground: the file is wrong about where they are."""
    parts = body()
    rear_axle(parts)
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.wheel(f"{side}_drum", "base", f"0.4 {y} 0.7")
    inside = "<left_joint>left_drum</left_joint><right_joint>right_drum</right_joint>"
    steering = inside.replace("left_joint", "steering_wheel_joint")
    steering = steering.replace("right_joint", "steering_joint")
    turned = files.load(with_plugin(parts, plugin("libx_diff_drive.so", steering)))
    assert turned.joint_names == ("left_drum", "right_drum")
    text = with_plugin(parts, plugin("libgazebo_ros_diff_drive.so", inside))
    assert (
        '"left_drum", "right_drum" a plugin or a controller drives it as a wheel'
        in files.refusal(text)
    )
    assert files.load(text, free=["*_drum"]).joint_names == ("left_drum", "right_drum")
    assert files.load(parts).joint_names == ("left_drum", "right_drum")


@pytest.mark.parametrize("kind", ["mecanum-drive", "ackermann-steering"])
def test_a_plugin_for_another_drive_is_warned_of(files: Files, kind: str) -> None:
    text = driven("", f"gz-sim-{kind}-system")
    (found,) = told(files.load(text))
    assert found.severity == "warning"
    assert "by its wheels the drive is differential; choose with --drive" in found.message
    assert "by its wheels the drive is differential" in files.refusal(text, strict=True)


def test_the_actuators_of_ros2_control(files: Files) -> None:
    """Joints with a command interface have motors; one with a state interface has none."""
    joint = '<joint name="{}"><{}_interface name="velocity"/></joint>'
    control = '<ros2_control name="c" type="system">{}</ros2_control></robot>'
    inside = joint.format("rear_left", "command") + joint.format("rear_right", "state")
    text = differential().replace("</robot>", control.format(inside))
    robot = files.load(text)
    assert robot.actuators == ("rear_left",)
    assert robot.description.actuated == {"rear_left"}


def workspace(folder: Path, control: str, package: str = "bot_control") -> Path:
    """Return the URDF of a four-wheeled robot beside a package with a file of controllers."""
    for name in ("bot_description", package):
        (folder / name / "config").mkdir(parents=True)
        write(folder / name, f"<package><name>{name}</name></package>", "package.xml")
    write(folder / package / "config", control, "control.yaml")
    return write(folder / "bot_description", xml(axles(0.25, -0.25)))


@pytest.mark.parametrize(
    ("control", "message", "line"),
    [
        (
            f'drive:\n  type: "diff_drive_controller/DiffDriveController"{SIDES}'
            "  wheel_separation_multiplier: 1.5\n",
            "has the wheels 0.9 m apart (0.6 times its multiplier 1.5), the geometry 0.6 m",
            3,
        ),
        (
            "controller_manager:\n  ros__parameters:\n    base.type: diff_drive_controller/X\n"
            "base:\n  ros__parameters:\n    left_wheel_names: [axle0_left]\n"
            "    right_wheel_names: [axle0_right]\n    wheel_separation: 0.512\n",
            "has the wheels 0.512 m apart, the geometry 0.6 m, which is taken",
            6,
        ),
    ],
    ids=["ROS 1", "ROS 2"],
)
def test_a_controller_in_the_workspace_tells_its_separation(
    tmp_path: Path, control: str, message: str, line: int
) -> None:
    """For a skid-steer drive this is tuned odometry: a remark, and how to take it."""
    robot = rpctl.load(workspace(tmp_path, control), strict=True)
    assert robot.drive.type == "skid-steer"
    assert "is made for differential drives" in robot.drive.evidence[0]
    (found,) = told(robot)
    assert found.severity == "info"
    assert f"(bot_control/config/control.yaml:{line})" in found.message
    assert message in found.message
    assert "to use theirs, set track = " in found.message


def test_a_controller_may_name_wheels_as_joints_only(tmp_path: Path) -> None:
    """As a mecanum controller of ROS 2 does: ``front_left_joint_name``."""
    joints = ("axle0_left", "axle0_right", "axle1_left", "axle1_right")
    places = ("front_left", "front_right", "back_left", "back_right")
    control = MECANUM + "".join(
        f"  {place}_joint_name: {joint}\n" for place, joint in zip(places, joints, strict=True)
    )
    assert rpctl.load(workspace(tmp_path, control)).drive.type == "mecanum"


MECANUM = "base:\n  type: mecanum_drive_controller/MecanumDriveController\n"


@pytest.mark.parametrize(
    ("control", "package"),
    [
        (MECANUM + "  front_left_wheel_joint: axle0_left\n", "other_control"),
        (MECANUM + "  front_left_wheel_joint: of_another_robot\n", "bot_control"),
        (MECANUM, "bot_control"),
        (MECANUM + "  front_left_wheel_joint: [axle0_left\n", "bot_control"),
        (
            f"{MECANUM}  a_wheel: axle0_left\nother:\n  type: diff_drive_controller/X{SIDES}",
            "bot_control",
        ),
    ],
    ids=["of another robot", "of other joints", "of no joints", "no YAML", "of two kinds"],
)
def test_controllers_that_are_not_clearly_the_robots_tell_nothing(
    tmp_path: Path, control: str, package: str
) -> None:
    drive = rpctl.load(workspace(tmp_path, control, package)).drive
    assert drive.type == "skid-steer"
    assert drive.doubts[0].startswith("4 parallel wheels: rpctl assumes ordinary ones")


def aliases(leaf: str) -> str:
    """Return lines of YAML, each nine times the one before, from a leaf: 9**12 of it in a page."""
    tables = (", ".join(f"k{j}: *a{k - 1}" for j in range(9)) for k in range(1, 13))
    lines = (f"a{k}: &a{k} {{{table}}}\n" for k, table in enumerate((leaf, *tables)))
    return "".join(lines)


@pytest.mark.parametrize(
    "bomb",
    [aliases(""), aliases("x: 1"), "z: &z {b: *z, c: *z, d: *z}\n", f"z: {'[' * 1200}"],
    ids=["empty tables", "tables", "a table in itself", "lists in lists"],
)
def test_a_file_of_parameters_that_unfolds_without_end_tells_nothing(
    bomb: str, tmp_path: Path
) -> None:
    known = MECANUM + "  front_left_wheel_joint: axle0_left\n"
    assert rpctl.load(workspace(tmp_path / "a", known)).drive.type == "mecanum"
    assert rpctl.load(workspace(tmp_path / "b", known + bomb)).drive.type == "skid-steer"


def test_so_much_is_read_of_all_files_of_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = MECANUM + "  front_left_wheel_joint: axle0_left\n"
    path = workspace(tmp_path, known)
    (tmp_path / "bot_control" / "config" / "a.yaml").write_text("#" * 100)
    monkeypatch.setattr(controller_files, "MAX_CHARACTERS", 100 + len(known))
    assert rpctl.load(path).drive.type == "mecanum"
    monkeypatch.setattr(controller_files, "MAX_CHARACTERS", 99 + len(known))
    assert rpctl.load(path).drive.type == "skid-steer"


def test_a_file_of_parameters_that_the_robot_names_comes_first(tmp_path: Path) -> None:
    path = workspace(tmp_path, f"base:\n  type: diff_drive_controller/X{SIDES}")
    own = write(path.parent, MECANUM + "  front_left_wheel_joint: axle0_left\n", "own.yaml")
    named = f"<parameters>{own}</parameters>"
    text = path.read_text().replace("</robot>", plugin("libgz_ros2_control.so", named))
    assert rpctl.load(write(path.parent, text)).drive.type == "mecanum"
    outside = write(tmp_path, own.read_text(), "own.yaml")  # in no folder that the robot may use
    far = text.replace(str(own), str(outside))
    assert rpctl.load(write(path.parent, far)).drive.type == "skid-steer"
