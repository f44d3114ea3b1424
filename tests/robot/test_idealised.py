"""What is idealised: said where it applies, with the number that pencil and paper give."""

from __future__ import annotations

import math
from math import pi
from pathlib import Path

import pytest

import rpctl
from rpctl import Robot
from rpctl.robot.idealised import Idealisation, idealisations
from rpctl.robot.vary import without_losses
from tests.drive.drive_cases import Files, body, xml
from tests.robots import SET_A, four_wheels, platform, write
from tests.vehicles import Parts, rear_axle, vehicle

THIN = "thin wheels"
STEERING = "singular steering"
LIMIT = '<limit lower="-1.2" upper="1.2" effort="40" velocity="6"/>'  # that Parts give
MEMO = platform(SET_A)  # wheels of 0.15 m, 40 mm wide, at y = ±0.75 m


def by_what(robot: Robot) -> dict[str, Idealisation]:
    """Return what is idealised by its kind, but for the wheels' width; each kind once."""
    found = [each for each in idealisations(robot) if each.what != THIN]
    drive_text = {each.what: each for each in found}
    assert len(drive_text) == len(found)
    return drive_text


def only(robot: Robot) -> Idealisation:
    (found,) = by_what(robot).values()
    return found


def of_car(parts: Parts, files: Files) -> list[Idealisation]:
    """Return what is idealised of a car's wheels; its steering has limits that are wide."""
    return [each for each in idealisations(files.load(parts)) if each.what not in (THIN, STEERING)]


def turned_axles(tmp_path: Path, *axes: tuple[float, float, float]) -> Robot:
    text = MEMO
    for axis in axes:
        numbers = " ".join(map(repr, axis))
        text = text.replace('<axis xyz="0 1 0"/>', f'<axis xyz="{numbers}" />', 1)
    return rpctl.load(write(tmp_path, text))


def toed(tmp_path: Path, left: float, right: float) -> Robot:
    """Return a platform whose axles are turned about the vertical, rad."""
    return turned_axles(
        tmp_path, *((-math.sin(angle), math.cos(angle), 0.0) for angle in (left, right))
    )


@pytest.mark.parametrize("name", ["paper", "mixed_chain", "casters"])
def test_a_clean_robot_has_thin_wheels_and_no_more(name: str) -> None:
    (thin,) = idealisations(rpctl.load(name))
    width = {"paper": 70.0, "mixed_chain": 50.0, "casters": 40.0}[name]
    assert (thin.what, thin.unit) == (THIN, "mm")
    assert thin.value == pytest.approx(width)
    assert f"though up to {width:g} mm wide" in thin.sentence


def test_axles_that_are_not_parallel(tmp_path: Path) -> None:
    found = only(toed(tmp_path, math.radians(0.8), math.radians(-0.8)))
    assert (found.what, found.unit) == ("heading", "°")
    assert found.value == pytest.approx(0.8)
    assert "the mean of 2 axles that are not parallel" in found.sentence
    assert found.sentence.endswith("is 0.8° (14 mrad) off it")
    one = by_what(toed(tmp_path, math.radians(0.8), 0.0))
    assert one["heading"].value == pytest.approx(0.4)
    # The wheels, 1.5 m apart, lie on a line that the mean axle crosses at 0.4°.
    assert one["axle scatter"].value == pytest.approx(1500.0 * math.sin(math.radians(0.4)))
    assert not by_what(toed(tmp_path, 0.9e-4, -0.9e-4))
    assert only(toed(tmp_path, 1.1e-4, -1.1e-4)).value == pytest.approx(math.degrees(1.1e-4))


def test_wheels_nearly_on_one_axle(tmp_path: Path) -> None:
    """The left wheel 3 mm ahead; the contacts are level."""
    found = only(rpctl.load(write(tmp_path, MEMO.replace('xyz="0 0.75', 'xyz="0.003 0.75'))))
    assert (found.what, found.unit) == ("axle scatter", "mm")
    assert found.value == pytest.approx(3.0)
    assert found.sentence.endswith("their centres are 3 mm apart along the heading")
    assert "left_joint" in found.sentence
    assert "right_joint" in found.sentence
    assert not by_what(rpctl.load(write(tmp_path, MEMO.replace('xyz="0 0.75', 'xyz="9e-6 0.75'))))


def test_axles_that_share_one_constraint(tmp_path: Path) -> None:
    """Axles at 0 and −0.9 m: P lies between them, 0.45 m from each."""
    found = only(four_wheels(tmp_path, "skid-steer"))
    assert (found.what, found.unit) == ("axles apart", "m")
    assert found.value == pytest.approx(0.45)
    assert "2 fixed axles share one lateral constraint, at P" in found.sentence
    assert "at 0.45 m/s for each rad/s" in found.sentence
    assert not by_what(four_wheels(tmp_path, "mecanum"))
    drive_text = write(tmp_path, 'type = "skid-steer"\npoint = [-0.2, 0]\n', "drive.toml")
    found = only(rpctl.load(tmp_path / "skid-steer.urdf", drive=drive_text))
    assert found.value == pytest.approx(0.7)
    assert "rear_" in found.sentence


def cylinder(r: float, role: str, x: float = 0.0) -> str:
    origin = f'<origin xyz="{x} 0 0" rpy="{pi / 2} 0 0"/>'
    return f'<{role}>{origin}<geometry><cylinder radius="{r}" length="0.05"/></geometry></{role}>'


def cart(shape: str) -> Parts:
    parts = body()
    for name, y in (("left", 0.2), ("right", -0.2)):
        parts.link(f"{name}_link", 1.0, shape)
        parts.joint(name, "continuous", ("base", f"{name}_link"), f"0 {y} 0.1", "0 1 0")
    return parts


def test_a_visual_radius_that_is_not_the_collisions(files: Files) -> None:
    shapes = cylinder(0.1, "collision") + cylinder(0.11, "visual")
    found = only(files.load(cart(shapes)))
    assert (found.what, found.value, found.unit) == ("radius", 0.11, "m")
    assert found.sentence == (
        'the radius of "left" (line 1), "right" (line 1) is 0.1 m (collision cylinder), that of '
        "the visual shape 0.11 m (visual cylinder, line 1); simulators roll on the collision"
    )
    assert not by_what(files.load(cart(cylinder(0.1, "collision") + cylinder(0.1, "visual"))))
    text = xml(cart(shapes)).replace('radius="0.11"', 'radius="0.12"', 1)
    assert [each.value for each in idealisations(files.load(text))[:2]] == [0.12, 0.11]
    lugs = '<visual><geometry><box size="0.2 0.04 0.2"/></geometry></visual>'
    assert not by_what(
        files.load(cart(shapes + lugs))
    )  # what is drawn reaches further than one knows
    drive_text = 'type = "differential"\n' + "".join(
        f'[[wheel]]\njoint = "{name}"\nradius = 0.12\n' for name in ("left", "right")
    )
    radii = {
        each.value: each.sentence for each in idealisations(files.load(cart(shapes), drive_text))
    }
    assert set(radii) == {0.1, 0.11}
    assert "is 0.12 m (drive file), that of the collision shape 0.1 m" in radii[0.1]
    seen = files.load(cart(cylinder(0.1, "visual")), drive_text)
    assert only(seen).sentence.endswith("there is no round collision")


def car(trail: float, axis: str = "0 0 1") -> Parts:
    """Return a car with a front axle 0.7 m ahead; the left contact is ``trail`` ahead of its axis.

    The swivels' origins are 0.1 m above the ground.
    """
    parts = body()
    rear_axle(parts)
    parts.swivel("steer_left", "0.7 0.25 0.1", "revolute", axis)
    parts.wheel("front_left", "steer_left_fork", f"{trail} 0.05 0")
    parts.swivel("steer_right", "0.7 -0.25 0.1", "revolute")
    parts.wheel("front_right", "steer_right_fork", "0 -0.05 0")
    return parts


def test_trails_of_wheels_that_steer_together(files: Files) -> None:
    assert of_car(car(0.0), files) == []
    for trail, where in ((0.0015, "1.5 mm ahead of"), (-0.0015, "1.5 mm behind")):
        (found,) = of_car(car(trail), files)
        assert found.what == "trail"
        assert found.value == pytest.approx(1e3 * trail)
        assert '"steer_left" (line 1) steers together with others' in found.sentence
        assert f"its contact is {where} its axis" in found.sentence
    assert of_car(car(9e-6), files) == []


def test_a_swivel_that_leans(files: Files) -> None:
    """tan of the lean is 0.01: 1 mm for 0.1 m above the ground."""
    (found,) = of_car(car(0.0, axis="0.006 0.008 1"), files)
    assert (found.what, found.unit) == ("swivel lean", "°")
    assert found.value == pytest.approx(math.degrees(math.atan(0.01)))
    assert "leans 0.573° and is treated as upright" in found.sentence
    assert "meet the ground 1 mm from below its origin" in found.sentence
    below = xml(car(0.0, axis="0.006 0.008 1"))  # the origin 0.2 m below the ground, same wheels
    for old, new in (("0.7 0.25 0.1", "0.7 0.25 -0.2"), ('"0.0 0.05 0"', '"0.0 0.05 0.3"')):
        assert old in below
        below = below.replace(old, new)
    leaning = by_what(files.load(below))["swivel lean"]
    assert "meet the ground 2 mm from below its origin" in leaning.sentence


@pytest.mark.parametrize("limit", [None, 1.5])
def test_steering_that_no_sample_has(tmp_path: Path, limit: float | None) -> None:
    """A bicycle's hold on its base is cos δ: below a tenth from acos 0.1 on, 84.3°."""
    text = vehicle("bicycle")
    assert not by_what(rpctl.load(write(tmp_path, text)))
    if limit is None:
        text = text.replace('"steer" type="revolute"', '"steer" type="continuous"')
    else:
        text = text.replace('lower="-1.2" upper="1.2"', f'lower="{-limit}" upper="{limit}"')
    found = only(rpctl.load(write(tmp_path, text)))
    reach = pi if limit is None else limit
    gap = 4.0 * math.asin(0.1) if limit is None else 2.0 * (limit - math.acos(0.1))
    assert (found.what, found.unit) == (STEERING, "%")
    assert found.value == pytest.approx(100.0 * gap / (2.0 * reach), rel=1e-9)
    inner, outer = math.degrees(math.acos(0.1)), min(95.739, math.degrees(reach))
    spans = f"from {-outer:.1f}° to {-inner:.1f}° and {inner:.1f}° to {outer:.1f}°: "
    assert spans in found.sentence
    assert found.sentence.endswith(f": {found.value:.2g} % of its range")


def test_friction_that_is_smooth_and_losses_that_are_left_out(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    parts.xml = [
        part.replace("</joint>", '<dynamics damping="0.2"/></joint>') for part in parts.xml
    ]
    for name, kind, loss in (
        ("shoulder", "revolute", 'damping="0.5" friction="0.3"'),
        ("slide", "prismatic", 'damping="70" friction="0"'),
        ("head", "revolute", 'damping="9"'),
    ):
        parts.link(f"{name}_link", 1.0)
        more = f'<limit lower="-1" upper="1" effort="9" velocity="1"/><dynamics {loss}/>'
        text = Parts([])
        text.joint(name, kind, ("base", f"{name}_link"), "0 0 0.5", "0 0 1", more)
        parts.xml += [part.replace(LIMIT, "") for part in text.xml]
    robot = files.load(parts, lock=["head"])
    (creep,) = [each for each in idealisations(robot) if each.what != THIN]
    assert (creep.what, creep.value, creep.unit) == ("creep", 0.01, "rad/s")
    assert creep.sentence == (
        'friction of "shoulder" (line 1) is smooth below 0.01 rad/s: under a load of 70 % of it, '
        "a joint creeps at this rate"
    )
    found = [each for each in idealisations(without_losses(robot)) if each.what != THIN]
    assert [(each.what, each.value, each.unit) for each in found] == [
        ("damping", 0.5, "N·m·s/rad"),
        ("friction", 0.3, "N·m"),
        ("damping", 70.0, "N·s/m"),
    ]
    assert found[0].sentence == (
        '<dynamics> damping of 3 joints is ignored, at most 0.5 N·m·s/rad of "shoulder" (line 1)'
    )
    assert found[1].sentence == ('<dynamics> friction is ignored: 0.3 N·m of "shoulder" (line 1)')
