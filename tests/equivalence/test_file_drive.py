"""The drive measured on the file, by paper and pencil: a root link whose axes lie askew, too."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import ArrayLike

import rpctl
from rpctl import Robot
from rpctl.equivalence.file_drive import measure
from rpctl.equivalence.raw_file import read_file
from rpctl.robot.drive import Drive, Swivel, Wheel
from tests.robot.wild import Files, axles, body, xml
from tests.vehicles import KINDS, Parts, vehicle

ASKEW = math.radians(30.0)
FORWARD = np.array([math.cos(ASKEW), math.sin(ASKEW)])
LEFT = np.array([-FORWARD[1], FORWARD[0]])


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def askew(text: str) -> str:
    """Return a URDF with all that its base carries turned by ASKEW about the base's z axis."""
    robot = ElementTree.fromstring(text)
    for joint in robot.findall("joint"):
        parent, origin = joint.find("parent"), joint.find("origin")
        assert parent is not None
        assert origin is not None
        if parent.get("link") == "base":
            x, y, z = map(float, str(origin.get("xyz")).split())
            x, y = (x * FORWARD + y * LEFT).tolist()
            origin.set("xyz", f"{x!r} {y!r} {z!r}")
            origin.set("rpy", f"0 0 {ASKEW!r}")
    return ElementTree.tostring(robot, encoding="unicode")


def measured(robot: Robot) -> Drive:
    return measure(robot, read_file(robot.description.raw))[0]


def wheel(drive: Drive, name: str) -> Wheel:
    (found,) = (each for each in drive.wheels if each.joint == name)
    return found


def swivel(drive: Drive, name: str) -> Swivel:
    (found,) = (each for each in drive.swivels if each.joint == name)
    return found


def near(value: ArrayLike, expected: ArrayLike) -> None:
    found, truth = np.asarray(value, dtype=float), np.asarray(expected, dtype=float)
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-12)


def three_on_an_axle() -> Parts:
    """Three wheels on one axle at x = .2, two left of the middle: their mean is not P."""
    parts = body()
    for name, y in (("outer", 0.3), ("inner", 0.1), ("right", -0.3)):
        parts.wheel(name, "base", f"0.2 {y} 0.1")
    return parts


def test_p_is_between_the_outermost_wheels_of_an_axle(files: Files) -> None:
    drive = measured(files.load(askew(xml(three_on_an_axle())), "differential"))
    near(drive.heading, ASKEW)
    near(drive.point, 0.2 * FORWARD)
    near(drive.ground, 0.0)
    for each in drive.wheels:
        near(each.direction, FORWARD)


def test_p_of_two_axles_is_between_them(files: Files) -> None:
    """A third wheel on the front axle does not draw it there."""
    parts = axles(0.4, -0.1)
    parts.wheel("inner", "base", "0.4 0.2 0.1")
    near(measured(files.load(askew(xml(parts)), "skid-steer")).point, 0.15 * FORWARD)


def test_a_steered_wheel_askew(files: Files) -> None:
    """Its contact 3 cm ahead and 1 cm left of its pivot, both seen along its own heading."""
    drive = measured(files.load(askew(vehicle("tricycle"))))
    steer, front = swivel(drive, "steer"), wheel(drive, "front")
    near(steer.pivot, 0.6 * FORWARD)
    near((steer.heading, steer.sign, steer.trail), (ASKEW, 1.0, 0.03))
    near(front.lateral, 0.01)
    near(front.direction, FORWARD)
    near(drive.point, -0.1 * FORWARD)


def test_casters_askew(files: Files) -> None:
    """Each trails behind its pivot, its axis points down; twin wheels are 2 cm to either side."""
    drive = measured(files.load(askew(vehicle("casters"))))
    for k, (x, y, trail) in enumerate([(0.4, 0.2, 0.06), (0.4, -0.2, 0.05), (-0.3, 0.0, 0.07)]):
        caster = swivel(drive, f"caster_{k}")
        near(caster.pivot, x * FORWARD + y * LEFT)
        near((caster.heading, caster.sign, caster.trail), (ASKEW, -1.0, -trail))
    near([wheel(drive, f"caster_1_roller_{side}").lateral for side in "lr"], (0.02, -0.02))
    near(wheel(drive, "caster_0_roller").lateral, 0.004)


def test_rollers_of_a_mecanum_base_askew(files: Files) -> None:
    """On the ground they make a diamond, seen from above: front left at −45°, right at 45°."""
    drive = measured(files.load(askew(xml(axles(0.25, -0.25))), "mecanum"))
    for name, sign in (("0_left", -1), ("0_right", 1), ("1_left", 1), ("1_right", -1)):
        near(wheel(drive, f"axle{name}").direction, (FORWARD + sign * LEFT) * math.sqrt(0.5))


@pytest.mark.parametrize("kind", KINDS)
def test_the_certificate_holds_askew(files: Files, kind: str) -> None:
    """All derivations agree where nothing of the base lies along its own axes."""
    proof = rpctl.verify(files.load(askew(vehicle(kind))), samples=1)
    assert proof.passed, [check for check in proof.checks if not check.passed]
