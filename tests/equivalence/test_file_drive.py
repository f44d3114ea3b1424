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
from rpctl.drive.drive import Drive, Swivel, Wheel
from rpctl.equivalence.file_drive import measure
from rpctl.equivalence.raw_file import read_file
from tests.drive.drive_cases import Files, axles, body, xml
from tests.grids import cells
from tests.robots import write
from tests.vehicles import KINDS, Parts, vehicle

ASKEW = math.radians(60.0)  # so far that sin and cos cannot stand in for each other
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


@pytest.mark.parametrize("kind", cells(KINDS, [*KINDS][::4]))
def test_the_certificate_holds_askew(files: Files, kind: str) -> None:
    """All derivations agree where nothing of the base lies along its own axes."""
    proof = rpctl.verify(files.load(askew(vehicle(kind))), samples=1)
    assert proof.passed, [check for check in proof.checks if not check.passed]


CYLINDER = """<collision><origin xyz="0 {y} 0" rpy="1.5707963267948966 0 0"/>
  <geometry><cylinder radius="{r}" length="0.02"/></geometry></collision>"""
BALL = """<collision><origin xyz="{x} 0 0"/>
  <geometry><sphere radius="0.102"/></geometry></collision>"""


def with_left_wheel(shape: str, *, beside: str = "") -> Parts:
    """Return a differential drive whose left wheel has a shape, with a link fixed to it."""
    parts = body()
    parts.link("left_link", 1.0, shape)
    parts.joint("left", "continuous", ("base", "left_link"), "0 0.3 0.1", "0 1 0")
    parts.wheel("right", "base", "0 -0.3 0.1")
    if beside:
        parts.link("beside", 0.1, beside)
        parts.joint("beside_joint", "fixed", ("left_link", "beside"), "0 0 0", "1 0 0")
    return parts


def left_of(files: Files, parts: Parts) -> Wheel:
    robot = files.load(parts, "differential")
    return wheel(measured(robot), "left")


def test_twin_tyres_are_one_wheel_between_them(files: Files) -> None:
    """Two tyres at 2 and 8 cm along the axle; the hub between base and tyres is narrower."""
    tyres = [CYLINDER.format(y=y, r=r) for y, r in ((-0.06, 0.06), (0.02, 0.1), (0.08, 0.1))]
    left = left_of(files, with_left_wheel("".join(tyres)))
    near((left.radius, left.offset), (0.1, 0.05))


@pytest.mark.parametrize(("x", "radius"), [(0.0101, 0.102), (0.0103, 0.1)])
def test_a_part_is_of_the_wheel_where_it_is_centred_on_the_axle(
    files: Files, x: float, radius: float
) -> None:
    """A ball of 10.2 cm, fixed to it, may be off the axle by a tenth of that."""
    parts = with_left_wheel(CYLINDER.format(y=0.0, r=0.1), beside=BALL.format(x=x))
    near(left_of(files, parts).radius, radius)


def test_a_mesh_is_as_high_as_the_wider_of_its_extents(files: Files) -> None:
    """In mm: 200 across, 160 high, from 10 to 30 along the axle."""
    corners = [(-100, 10, -80), (100, 30, 80), (-100, 30, 80), (100, 10, -80)]
    facets = [[corners[k] for k in face] for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))]
    lines = ["solid wheel"]
    for facet in facets:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in facet]
        lines += ["endloop", "endfacet"]
    write(files.folder, "\n".join([*lines, "endsolid wheel"]), "wheel.stl")
    mesh = '<geometry><mesh filename="wheel.stl" scale="0.001 0.001 0.001"/></geometry>'
    left = left_of(files, with_left_wheel(f"<collision>{mesh}</collision>"))
    near((left.radius, left.offset), (0.1, 0.02))


def test_the_certificate_of_a_declared_track_holds_askew(files: Files) -> None:
    """The wheels grip a quarter wider than they stand: to the left of forward, not of x."""
    drive_text = 'type = "skid-steer"\ntrack = 0.75\n'
    for k in (0, 1):
        drive_text += "".join(
            f'[[wheel]]\njoint = "axle{k}_{side}"\n' for side in ("left", "right")
        )
    proof = rpctl.verify(files.load(askew(xml(axles(0.25, -0.25))), drive_text), samples=1)
    assert proof.passed, [check for check in proof.checks if not check.passed]
