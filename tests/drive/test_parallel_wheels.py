"""Skid-steer or mecanum: what tells, what is assumed, and what contradicts itself."""

from __future__ import annotations

import pytest

import rpctl
from rpctl import ReducedDynamics
from tests.drive.drive_cases import TRANSMISSION, Files, axles, body, xml
from tests.vehicles import Parts


def plugin(file: str, inside: str = "", name: str = "p") -> str:
    return f'<gazebo><plugin name="{name}" filename="{file}">{inside}</plugin></gazebo></robot>'


def with_plugin(parts: Parts, *plugins: str) -> str:
    text = xml(parts)
    for each in plugins:
        text = text.replace("</robot>", each)
    return text


@pytest.mark.parametrize("places", [(0.25, -0.25), (0.3, 0.0, -0.3)])
def test_parallel_wheels_are_skid_steer_by_assumption(
    files: Files, places: tuple[float, ...]
) -> None:
    robot = files.load(axles(*places))
    assert robot.drive.type == "skid-steer"
    assert len(robot.drive.wheels) == 2 * len(places)
    (doubt,) = robot.drive.doubts
    assert doubt.startswith(f"{2 * len(places)} parallel wheels: rpctl assumes ordinary ones")
    assert doubt.endswith("give --drive skid-steer or --drive mecanum")
    assert doubt in files.refusal(axles(*places), strict=True)
    assert files.load(axles(*places), "skid-steer", strict=True).drive.doubts == ()


def test_wheels_of_two_sizes_are_asked_about(files: Files) -> None:
    """Small wheels in front may be casters that slide: no skid-steer drive by assumption."""
    parts = axles(0.25)
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.wheel(f"small_{side}", "base", f"-0.25 {y} 0.05", r=0.05)
    refusal = files.refusal(parts)
    assert "2 pairs of wheels on one axle" in refusal
    start = refusal.partition("(--drive FILE):\n")[2]
    assert "# radius = 0.05  # m" in start
    assert files.load(parts, start).drive.type == "skid-steer"


def test_two_wheels_with_motors_and_two_without_are_asked_about(files: Files) -> None:
    motors = "".join(TRANSMISSION.format(f"axle0_{side}") for side in ("left", "right"))
    text = xml(axles(0.25, -0.25)).replace("</robot>", motors + "</robot>")
    assert "2 pairs of wheels on one axle" in files.refusal(text)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('_link"', '_mecanum"'),
        ('name="wild"', 'name="my_mecanum_base"'),
        ('axle0_left_link"', 'axle0_left_omni"'),
    ],
)
def test_names_that_tell_mecanum_wheels(files: Files, old: str, new: str) -> None:
    drive = files.load(xml(axles(0.25, -0.25)).replace(old, new), strict=True).drive
    assert drive.type == "mecanum"
    assert "mentions them" in drive.evidence[0]


def test_rollers_that_are_fixed_tell_mecanum_wheels(files: Files) -> None:
    parts = axles(0.25, -0.25)
    parts.link("front_roller_1", 0.01)
    parts.joint("r", "fixed", ("axle0_left_link", "front_roller_1"), "0 0 -0.09", "0 0 1")
    assert files.load(parts, strict=True).drive.type == "mecanum"


@pytest.mark.parametrize(
    ("file", "name", "kind"),
    [
        ("libgazebo_ros_skid_steer_drive.so", "p", "skid-steer"),
        ("libgazebo_ros_diff_drive.so", "p", "skid-steer"),
        ("gz-sim-diff-drive-system", "gz::sim::systems::DiffDrive", "skid-steer"),
        ("gz-sim-mecanum-drive-system", "gz::sim::systems::MecanumDrive", "mecanum"),
        ("libx.so", "omni_drive_controller", "mecanum"),
    ],
)
def test_plugins_that_tell(files: Files, file: str, name: str, kind: str) -> None:
    text = with_plugin(axles(0.25, -0.25), plugin(file, name=name))
    drive = files.load(text, strict=True).drive
    assert drive.type == kind
    assert drive.evidence[0].startswith(f'{kind}: plugin "{file}" (line 1) is made for')


@pytest.mark.parametrize("file", ["libgazebo_ros_planar_move.so", "libx_ros_force_based_move.so"])
def test_a_plugin_that_moves_any_way_is_weak_evidence(files: Files, file: str) -> None:
    text = with_plugin(axles(0.25, -0.25), plugin(file))
    drive = files.load(text).drive
    assert drive.type == "mecanum"
    (doubt,) = drive.doubts
    assert f'because plugin "{file}" (line 1) moves the base any way' in doubt
    assert doubt in files.refusal(text, strict=True)
    both = with_plugin(axles(0.25, -0.25), plugin(file), plugin("libgazebo_ros_diff_drive.so"))
    assert files.load(both, strict=True).drive.type == "skid-steer"


def test_a_file_that_says_two_things_is_asked_about(files: Files) -> None:
    text = with_plugin(axles(0.25, -0.25), plugin("libgazebo_ros_skid_steer_drive.so"))
    text = text.replace("_link", "_mecanum")
    refusal = files.refusal(text)
    assert 'the name "axle0_left_mecanum" mentions them' in refusal
    assert 'plugin "libgazebo_ros_skid_steer_drive.so" (line 1) is made for skid-steer' in refusal
    assert refusal.endswith("give --drive skid-steer or --drive mecanum")
    assert files.load(text, "skid-steer").drive.type == "skid-steer"
    assert files.load(text, "mecanum").drive.type == "mecanum"


def on_swivels(robot: str, trail: float = 0.0) -> str:
    """Return four wheels on four swivels that they trail (m), all with motors, and an arm joint."""
    parts = body(0.35)
    names = []
    for place, (x, y) in {"fl": (1, 1), "fr": (1, -1), "bl": (-1, 1), "br": (-1, -1)}.items():
        name = f"caster_joint_{place}"
        parts.swivel(name, f"{0.228 * x} {0.158 * y} 0.1", "continuous")
        parts.wheel(f"wheel_joint_{place}", f"{name}_fork", f"{-trail} 0 0")
        names += [name, f"wheel_joint_{place}"]
    parts.link("arm", 1.0)
    parts.joint("arm_joint_1", "revolute", ("base", "arm"), "0.1 0 0.5", "0 0 1")
    motors = "".join(map(TRANSMISSION.format, names))
    return xml(parts).replace("</robot>", motors + "</robot>").replace("wild", robot)


@pytest.mark.parametrize("robot", ["youbot", "mecanum_base"])
def test_swivels_under_mecanum_wheels_lead_to_the_command(files: Files, robot: str) -> None:
    text = on_swivels(robot)
    refusal = files.refusal(text)
    assert "\n  --lock 'caster_joint_*' --drive mecanum\n  --drive steered" in refusal
    base = files.load(text, "mecanum", lock=["caster_joint_*"])
    assert (base.drive.type, base.joint_names) == ("mecanum", ("arm_joint_1",))
    assert base.actuators == (*(w.joint for w in base.drive.wheels), "arm_joint_1")
    S = ReducedDynamics(base).basis(base.configuration())
    rates = [S[base.velocity_index(w.joint)] @ [0.3, 0.2, 0.0, 0.0] for w in base.drive.wheels]
    assert rates == pytest.approx([1.0, 5.0, 5.0, 1.0])  # (vx ∓ vy) / r
    assert rpctl.verify(base, samples=1).passed
    assert files.load(text, "steered").drive.type == "steered"


def test_a_mecanum_drive_that_still_swivels_is_told_what_to_lock(files: Files) -> None:
    assert "--lock 'caster_joint_*'" in files.refusal(on_swivels("x"), "mecanum")
