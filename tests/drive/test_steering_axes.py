"""Axes that lean, and joints that keep wheels from steering or rolling: what the user is told."""

from __future__ import annotations

from math import cos, radians, sin, tan

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from tests import urdf
from tests.drive.drive_cases import Files, body, tricycle, xml
from tests.urdf import actuated
from tests.vehicles import Parts, caster, rear_axle, vehicle


def car(lean: float) -> Parts:
    """A car whose kingpins lean inward at the top, by an angle in degrees."""
    parts = body()
    rear_axle(parts)
    for side, y in (("left", 1.0), ("right", -1.0)):
        axis = f"0 {-y * sin(radians(lean))!r} {cos(radians(lean))!r}"
        parts.swivel(f"steer_{side}", f"0.7 {0.25 * y} 0.1", "revolute", axis)
        parts.wheel(f"front_{side}", f"steer_{side}_fork", "0 0 0", f"0 {y} 0")
    return parts


@pytest.mark.parametrize("lean", [2.0, 5.71, 9.9])
def test_a_kingpin_leans_up_to_10_degrees_and_is_told(files: Files, lean: float) -> None:
    """It meets the ground outside of the contact, by its height times the lean's tangent."""
    robot = files.load(car(lean))
    assert robot.drive.type == "car-like"
    for swivel, side in zip(robot.drive.swivels, (1.0, -1.0), strict=True):
        assert swivel.pivot == pytest.approx((0.7, side * (0.25 + 0.1 * tan(radians(lean)))))
    certificate = rpctl.verify(robot, samples=8)
    assert certificate.passed
    told = [sentence for sentence in certificate.idealised if "is treated as upright" in sentence]
    assert len(told) == 2
    assert f'"steer_left" (line 1) leans {lean:.3g}°' in told[0]


@pytest.mark.parametrize("lean", [11.0, 30.0])
def test_a_steering_axis_that_leans_further_is_named_and_never_locked(
    files: Files, lean: float
) -> None:
    refusal = files.refusal(car(lean))
    assert "front_left" in refusal
    assert "more than 10° off the upright" in refusal
    for side in ("left", "right"):
        assert f'give "steer_{side}" (line 1) <axis xyz="0 0 1"/>' in refusal
    assert "--lock" not in refusal
    assert "--free" not in refusal


def test_a_rear_axle_on_fixed_joints_is_told_whatever_the_drive(files: Files) -> None:
    """The front wheels make a differential drive, and the rear ones slide along."""
    parts = body()
    parts.wheel("front_left", "base", "0.4 0.3 0.1")
    parts.wheel("front_right", "base", "0.4 -0.3 0.1")
    good = xml(parts)
    parts.wheel("rear_left", "base", "0 0.3 0.1")
    parts.wheel("rear_right", "base", "0 -0.3 0.1")
    text = xml(parts)
    rear = text.index('<joint name="rear_left"')
    fixed = text[:rear] + text[rear:].replace('"continuous"', '"fixed"')
    drive = files.load(fixed).drive
    assert drive.type == "differential"
    (doubt,) = drive.doubts
    assert doubt.startswith(
        "further bodies that look like wheels on the ground are held by fixed joints"
    )
    for name in ("rear_left", "rear_right"):
        assert f'"{name}" (line 1) type="continuous" with <axis xyz="0 1 0"/>' in doubt
    assert "held by fixed joints" in files.refusal(fixed, strict=True)
    assert files.load(good).drive.doubts == ()
    assert files.load(fixed.replace("rear_", "caster_")).drive.doubts == ()  # these may slide


def test_drawn_wheels_on_fixed_joints_count_where_the_others_axles_are(files: Files) -> None:
    """A spare wheel high up, and a wheel's cover beside it, are drawn as meshes, too."""
    parts = body()
    parts.wheel("front_left", "base", "0.4 0.3 0.1")
    parts.wheel("front_right", "base", "0.4 -0.3 0.1")
    places = {"spare": "-0.5 0 0.6", "cover": "0.4 0.33 0.1", "rear": "-0.3 0.3 0.11"}
    for name, place in places.items():
        parts.link(f"{name}_wheel", 1.0, urdf.shape('mesh filename="gone.stl"', "visual"))
        parts.joint(f"{name}_joint", "fixed", ("base", f"{name}_wheel"), place, "0 1 0")
    (doubt,) = files.load(parts).drive.doubts
    assert 'make "rear_joint" (line 1) type="continuous" with its axle as <axis>' in doubt
    assert "spare" not in doubt
    assert "cover" not in doubt


def test_steering_hinges_that_are_fixed_are_told(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.link(f"{side}_hinge", 0.5)
        parts.joint(f"base_to_{side}_hinge", "fixed", ("base", f"{side}_hinge"), f"0.7 {y} 0.1", "")
        parts.wheel(f"front_{side}", f"{side}_hinge", "0 0 0")
    parts.link("hingebot_foot", 0.1)  # the root link: a joint that carries all wheels steers none
    parts.joint("hinge_foot", "fixed", ("hingebot_foot", "base"), "0 0 0", "")
    text = xml(parts).replace('<axis xyz=""/>', "")
    drive = files.load(text).drive
    told = [doubt for doubt in drive.doubts if "called steering" in doubt]
    assert len(told) == 1
    assert 'make "base_to_left_hinge" (line 1) type="revolute" with <axis xyz="0 0 1"/>' in told[0]


def on_casters(kind: str, axis: str) -> Parts:
    """Return a base whose four wheels hang on casters of a kind of joint, about an axis."""
    parts = body()
    for x, y in ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)):
        name = f"{'fb'[x < 0]}{'lr'[y < 0]}"
        parts.link(f"{name}_fork", 0.5)
        parts.joint(f"{name}_caster", kind, ("base", f"{name}_fork"), f"{x} {y} 0.2", axis)
        parts.wheel(f"{name}_wheel", f"{name}_fork", "-0.05 0 -0.1")
    return parts


def test_casters_that_are_fixed_are_told_with_their_wheels(files: Files) -> None:
    """Who mends the wheels alone would have a skid-steer base."""
    text = xml(on_casters("fixed", "0 0 1"))
    refusal = files.refusal(text.replace('"continuous"', '"fixed"'))
    assert '"fl_wheel" (line 1) type="continuous" with <axis xyz="0 1 0"/>' in refusal
    upright = '"fl_caster" (line 1) type="continuous" with <axis xyz="0 0 1"/>'
    assert upright in refusal
    assert any(upright in doubt for doubt in files.load(text).drive.doubts)
    named = files.load(text.replace("caster", "head")).drive.doubts  # its <axis> tells
    assert any(upright.replace("caster", "head") in doubt for doubt in named)
    level = text.replace("caster", "head").replace('<axis xyz="0 0 1"/>', "")
    assert not any("head" in doubt for doubt in files.load(level).drive.doubts)
    rollers = text.replace("_wheel_link", "_mecanum_link")
    assert files.load(rollers).drive.doubts == ()


def test_a_caster_that_does_not_stand_upright_is_not_to_be_locked(files: Files) -> None:
    refusal = files.refusal(on_casters("continuous", "1 0 0"))
    assert '"fl_caster" (line 1) <axis xyz="0 0 1"/>' in refusal
    assert "--lock '*_caster'" not in refusal
    assert files.load(on_casters("continuous", "0 0 1"), "powered-casters").drive.swivels


def test_wheels_whose_axles_stand_make_no_fixed_base(files: Files) -> None:
    """Four endless joints side by side, upright, which meshes alone say are wheels."""
    parts = body()
    for k, (x, y) in enumerate([(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]):
        parts.link(f"corner_{k}", 2.0)
        parts.joint(f"joint_{k}", "continuous", ("base", f"corner_{k}"), f"{x} {y} 0", "0 0.05 1")
    refusal = files.refusal(parts)
    assert "joints turn upright side by side; if they carry wheels, give " in refusal
    for k in range(4):
        assert f'"joint_{k}" (line 1) <axis xyz="0 1 0"/>' in refusal
    assert files.load(parts, "fixed").drive.type == "fixed"
    assert files.load(parts, lock=["joint_[1-3]"]).drive.type == "fixed"  # a turntable


def test_a_steered_wheel_off_its_axis_is_told_where_to_go(files: Files) -> None:
    motors = (f"{end}{side}_steer" for end in "fr" for side in "lr")
    text = vehicle("steered").replace("</robot>", actuated(*motors) + "</robot>")
    joint = text.index('<joint name="fl_wheel"')
    aside = text[:joint] + text[joint:].replace('xyz="0 0.02 0"', 'xyz="0.03 0.02 0"', 1)
    refusal = files.refusal(aside)
    assert 'the wheels of "fl_steer" stand 30 mm off its axis' in refusal
    assert (
        'put what stands off under it: "fl_wheel" (line 1) to <origin xyz="0 0.02 0" .../>'
        in refusal
    )
    assert files.load(aside.replace("0.03 0.02 0", "0 0.02 0")).drive.type == "steered"


def test_joints_in_one_place_get_no_axis_of_zeros(files: Files) -> None:
    parts = body()
    for name in ("left", "right"):
        parts.wheel(name, "base", "0.2 0 0.1")
    refusal = files.refusal(parts)
    assert "no known drive" in refusal
    assert '<axis xyz="0 0 0"/>' not in refusal


def test_a_drive_file_that_is_asked_for_comes_complete(files: Files) -> None:
    """Three wheels at 120° whose meshes are not there: with radii it is the drive that they are."""
    parts = body()
    for k in range(3):
        turn = radians(120.0 * k)
        axle = f"{cos(turn)!r} {sin(turn)!r} 0"
        parts.link(f"omni_{k}_link", 1.0, urdf.shape('mesh filename="gone.stl"', "visual"))
        place = f"{0.3 * cos(turn)!r} {0.3 * sin(turn)!r} -0.1"
        parts.joint(f"omni_{k}", "continuous", ("base", f"omni_{k}_link"), place, axle)
    refusal = files.refusal(parts)
    assert 'the radius of wheel "omni_0_link" is not known' in refusal
    start = refusal[refusal.index('type = "omni"') :]
    robot = files.load(parts, start.replace("# radius = 0.1", "radius = 0.08"))
    assert robot.drive.type == "omni"
    assert [wheel.radius for wheel in robot.drive.wheels] == [0.08] * 3


def test_inspect_prints_the_drive_file_that_a_doubt_asks_for(files: Files) -> None:
    """Which wheels of a tricycle motors turn: the file that it prints, changed, says otherwise."""
    path = files.folder / "wild.urdf"
    path.write_text(xml(tricycle()))
    told = CliRunner().invoke(app, ["inspect", str(path)]).output
    start = told[told.index('type = "tricycle"') :]
    front, rear = start.split('joint = "rear_left"')
    driven = front + 'joint = "rear_left"' + rear.replace("# driven = true", "driven = false")
    assert files.load(xml(tricycle())).actuators == ("rear_left", "rear_right", "steer")
    robot = files.load(xml(tricycle()), driven.replace("# driven = true", "driven = true"))
    assert robot.actuators == ("front", "steer")


def test_a_castor_with_a_transmission_is_a_caster(files: Files) -> None:
    """Vendors give every joint one; "pivot" would be steered, as before."""
    parts = body()
    rear_axle(parts)
    caster(parts, "front_castor", 0.4, 0.0, 0.05, twin=False)
    text = xml(parts).replace("</robot>", actuated("front_castor") + "</robot>")
    drive = files.load(text).drive
    assert drive.type == "differential"
    assert [(s.role, s.driven) for s in drive.swivels] == [("caster", False)]
    assert '"front_castor" is treated as a caster' in drive.doubts[0]
    assert "a transmission drives it" in drive.doubts[0]
    assert files.load(text.replace("front_castor", "pivot")).drive.type == "tricycle"
