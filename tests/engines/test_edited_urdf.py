"""The file that an engine reads: the user's, but for what is locked, drawn only, or mended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.engines.edited_urdf import Dialect, edged_wheels, edit_urdf, other_shapes
from rpctl.engines.engine import ALL_DEFAULT
from rpctl.robot.model import Robot
from tests import urdf

DIALECT = Dialect(
    name="Engine",
    meshes=(".obj",),
    crowned='<crowned radius="{radius}" half="{half_width}"/>',
    proximity='<drake:slides xmlns:drake="http://drake.mit.edu"/>',
    massless="<inertial><mass value='0'/></inertial>",
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return rpctl.load("paper", lock={"arm_prismatic_joint": 0.6})


def edited(robot: Robot, *mended: str) -> tuple[Any, tuple[str, ...]]:
    return edit_urdf(robot, frozenset(mended), DIALECT)


def shapes(root: Any, link: str) -> list[str]:
    return [str(e[0].tag) for e in root.findall(f"link[@name='{link}']/collision/geometry")]


def test_the_users_file_stays_but_for_drawings_and_locked_joints(robot: Robot) -> None:
    root, notes = edited(robot)
    assert not notes and not root.findall(".//visual")
    assert shapes(root, "base_link") == ["box", "box", "cylinder", "cylinder", "sphere"]
    assert shapes(root, "wheel_left_link") == ["cylinder"]
    assert root.find("link[@name='tool_link']/inertial") is None
    locked = root.find("joint[@name='arm_prismatic_joint']")
    assert locked.get("type") == "fixed" and len(locked.findall("origin")) == 1
    assert locked.find("origin").get("xyz").split()[0] == "0.6"
    assert locked.find("limit") is None and locked.find("axis") is None
    assert root.find("joint[@name='arm_revolute_joint']").get("type") == "revolute"


def test_only_wheels_and_supports_remain_of_the_shapes(robot: Robot) -> None:
    root, _ = edited(robot, "collisions")
    assert shapes(root, "base_link") == ["sphere"]
    assert shapes(root, "wheel_right_link") == ["cylinder"]
    assert not shapes(root, "arm_rail_link")


def test_wheels_get_a_crown_of_their_own_size(robot: Robot) -> None:
    root, _ = edited(robot, "wheel")
    assert shapes(root, "wheel_left_link") == ["crowned"]
    crown = root.find("link[@name='wheel_left_link']/collision/geometry/crowned")
    assert crown.attrib == {"radius": "0.15", "half": "0.035"}
    assert shapes(root, "base_link")[0] == "box"


def test_supports_slide_once(robot: Robot) -> None:
    root, _ = edited(robot, "caster")
    assert shapes(root, "base_link").count("sphere") == 1
    slides = "{http://drake.mit.edu}slides"
    support = root.find(f".//{slides}").getparent()
    assert support.find("geometry/sphere").get("radius") == "0.04"
    assert support.find("origin").get("xyz") == "0.78 0.0 0.04"


def test_inertias_are_those_of_all_that_moves_together(robot: Robot) -> None:
    root, _ = edited(robot, "inertia")
    masses = {
        e.getparent().getparent().get("name"): float(e.get("value")) for e in root.iter("mass")
    }
    assert masses["arm_sleeve_link"] == pytest.approx(4.0 + 2.0)  # the locked rail rides on it
    assert masses["arm_rail_link"] == masses["tool_link"] == 0.0
    assert sum(masses.values()) == pytest.approx(38.0)
    place = np.array(
        root.find("link[@name='arm_sleeve_link']/inertial/origin").get("xyz").split(), float
    )
    np.testing.assert_allclose(
        place, [(4.0 * 0.25 + 2.0 * (0.6 - 0.2)) / 6.0, 0.0, 0.0], atol=1e-12
    )
    izz = float(root.find("link[@name='arm_sleeve_link']/inertial/inertia").get("izz"))
    reduced = 4.0 * 2.0 / 6.0 * (0.4 - 0.25) ** 2  # parallel axes: the two bodies apart
    assert izz == pytest.approx(0.12 + 0.05 + reduced)


def box(name: str, *more: str) -> str:
    return urdf.link(name, urdf.inertial(10.0, (0.2, 0.2, 0.2), xyz=(0.0, 0.0, 0.2)), *more)


def two_wheels(path: Path, *inside: str, more: str = "") -> Path:
    """Write a robot on two wheels and a ball that the file only draws."""
    wheel = urdf.shape('cylinder radius="0.1" length="0.04"', rpy=urdf.ROUND)
    parts = [
        box("base_link", urdf.shape('sphere radius="0.05"', "visual", (0.3, 0, 0.05)), *inside)
    ]
    for side, y in (("left", 0.2), ("right", -0.2)):
        ends = ("base_link", f"wheel_{side}_link")
        parts.append(urdf.joint(f"wheel_{side}_joint", "continuous", ends, (0, y, 0.1), (0, 1, 0)))
        parts.append(urdf.link(ends[1], urdf.inertial(1.0, (0.003, 0.005, 0.003)), wheel))
    path.write_text(urdf.robot("two", *parts, more))
    return path


def test_meshes_that_are_not_found_or_not_read_are_left_out_and_told(tmp_path: Path) -> None:
    (tmp_path / "hull.stl").write_text("solid x\nendsolid x\n")
    (tmp_path / "hull.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    names = ("hull.stl", "hull.obj", "none.obj")
    meshes = [urdf.shape(f'mesh filename="{name}"', xyz=(0, 0, 0.5)) for name in names]
    root, notes = edited(rpctl.load(two_wheels(tmp_path / "two.urdf", *meshes)))
    (kept,) = root.findall(".//mesh")
    assert kept.get("filename") == str((tmp_path / "hull.obj").resolve())
    assert notes[0] == "Engine does not read .stl files as collision shapes: left out of base_link"
    assert "no such file" in notes[1] and notes[1].endswith("left out of base_link")


@pytest.mark.parametrize("strict", [True, False])
def test_a_transmission_without_an_actuator_is_told(tmp_path: Path, strict: bool) -> None:
    more = '<transmission name="t"><joint name="wheel_left_joint"/></transmission>'
    robot = rpctl.load(two_wheels(tmp_path / "two.urdf", more=more))
    dialect = Dialect("Engine", (), "<x/>", strict_transmissions=strict)
    root, notes = edit_urdf(robot, ALL_DEFAULT, dialect)
    assert root.find("transmission") is None
    assert bool(notes) is strict


def test_what_a_robot_has_that_can_be_mended(tmp_path: Path, robot: Robot) -> None:
    assert edged_wheels(robot) and other_shapes(robot)
    two = rpctl.load(two_wheels(tmp_path / "two.urdf"))
    assert edged_wheels(two) and not other_shapes(two)
    text = (tmp_path / "two.urdf").read_text()
    round_ = tmp_path / "round.urdf"
    round_.write_text(text.replace('cylinder radius="0.1" length="0.04"', 'sphere radius="0.1"'))
    assert not edged_wheels(rpctl.load(round_))
