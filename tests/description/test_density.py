"""Inertias estimated from shapes: those of the textbook, and the same in every engine."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import rpctl
from rpctl.description.records import Link
from rpctl.errors import DescriptionError
from tests.description.corpus import BASE

ARM = """<inertial><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial>"""
RHO = 800.0
PLACE = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 -0.6"/>'


def shaped(folder: Path, *shapes: str, tag: str = "collision", place: str = "") -> Path:
    """Write the base file, its arm with shapes in place of an inertia."""
    parts = (f"<{tag}>{place}<geometry>{shape}</geometry></{tag}>" for shape in shapes)
    path = folder / "robot.urdf"
    path.write_text(BASE.replace(ARM, "".join(parts)), encoding="utf-8")
    return path


def estimate(folder: Path, *shapes: str, tag: str = "collision", place: str = "") -> Link:
    path = shaped(folder, *shapes, tag=tag, place=place)
    return rpctl.load(path, density=RHO).description.link["arm"]


TUBE, BALL = 0.005 * math.pi, 4e-3 / 3 * math.pi  # m³, of the capsule
SIDEWAYS = TUBE * (0.01 / 4 + 0.25 / 12) + BALL * (0.4 * 0.01 + 0.25 / 4 + 3 * 0.5 * 0.1 / 8)
ALONG = TUBE * 0.005 + BALL * 0.4 * 0.01
BOXES = {
    "capsule": (
        '<capsule radius="0.1" length="0.5"/>',
        TUBE + BALL,
        np.array([SIDEWAYS, SIDEWAYS, ALONG]) / (TUBE + BALL),
    ),
    "box": ('<box size="0.3 0.2 0.1"/>', 0.006, np.array([0.05, 0.1, 0.13]) / 12),
    "sphere": ('<sphere radius="0.1"/>', 4e-3 / 3 * math.pi, np.full(3, 0.4 * 0.01)),
    "cylinder": (
        '<cylinder radius="0.1" length="0.5"/>',
        0.005 * math.pi,
        np.array([0.01 / 4 + 0.25 / 12, 0.01 / 4 + 0.25 / 12, 0.005]),
    ),
}


@pytest.mark.parametrize("kind", BOXES)
def test_primitives_have_the_inertia_of_the_textbook(kind: str, tmp_path: Path) -> None:
    shape, volume, per_mass = BOXES[kind]
    link = estimate(tmp_path, shape)
    assert link.estimated
    assert link.mass == pytest.approx(RHO * volume, rel=1e-14)
    np.testing.assert_allclose(link.inertia, RHO * volume * np.diag(per_mass), rtol=1e-13)
    np.testing.assert_allclose(link.com, 0)


def test_a_box_mesh_is_a_box(tmp_path: Path) -> None:
    scale = "-1000 1 0.01"  # mirrored, and in other units
    factors = np.array([float(word) for word in scale.split()])
    mesh = trimesh.creation.box(np.array([0.3, 0.2, 0.1]) / factors)
    mesh.export(tmp_path / "box.stl")
    mesh.export(tmp_path / "box.obj", digits=17)
    there = f'<mesh filename="box.obj" scale="{scale}"/>'
    ours = estimate(tmp_path, there, place=PLACE)
    theirs = estimate(tmp_path, BOXES["box"][0], place=PLACE)
    assert ours.mass is not None
    assert ours.mass == pytest.approx(theirs.mass, rel=1e-9)
    np.testing.assert_allclose(ours.com, theirs.com, rtol=1e-9)
    np.testing.assert_allclose(ours.inertia, theirs.inertia, rtol=1e-9, atol=1e-9)
    single = estimate(tmp_path, f'<mesh filename="box.stl" scale="{scale}"/>', place=PLACE)
    np.testing.assert_allclose(single.inertia, theirs.inertia, rtol=1e-6, atol=1e-6)


def test_shapes_add_up_and_move(tmp_path: Path) -> None:
    """A box is two half boxes; a turned one has a turned inertia about the moved centre."""
    whole = estimate(tmp_path, '<box size="0.4 0.2 0.1"/>')
    text = shaped(tmp_path, '<box size="0.2 0.2 0.1"/>', '<box size="0.2 0.2 0.1"/>').read_text()
    for x in ("-0.1", "0.1"):
        placed = f'<collision><origin xyz="{x} 0 0"/><geometry><box'
        text = text.replace("<collision><geometry><box", placed, 1)
    (tmp_path / "halves.urdf").write_text(text)
    halves = rpctl.load(tmp_path / "halves.urdf", density=RHO).description.link["arm"]
    assert halves.mass == pytest.approx(whole.mass, rel=1e-14)
    np.testing.assert_allclose(halves.inertia, whole.inertia, rtol=1e-13, atol=1e-16)
    moved = estimate(tmp_path, '<box size="0.4 0.2 0.1"/>', place=PLACE)
    np.testing.assert_allclose(moved.com, [0.1, -0.2, 0.3], rtol=1e-14)
    R = pin.rpy.rpyToMatrix(0.4, 0.5, -0.6)
    np.testing.assert_allclose(moved.inertia, R @ whole.inertia @ R.T, rtol=1e-12, atol=1e-15)


def test_an_open_mesh_is_taken_as_its_hull_and_told(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.3, 0.2, 0.1))
    mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    mesh.export(tmp_path / "open.stl")
    path = shaped(tmp_path, '<mesh filename="open.stl"/>')
    robot = rpctl.load(path, density=RHO)
    (expected,) = (f for f in robot.findings if f.severity == "warning")
    assert (
        'mesh "open.stl" of link "arm" is not watertight; rpctl uses its convex hull'
        in expected.message
    )
    assert expected.line == robot.description.link["arm"].collisions[0].line
    assert robot.description.link["arm"].mass == pytest.approx(RHO * 0.006, rel=1e-6)


def test_a_flat_mesh_weighs_nothing_and_is_told(tmp_path: Path) -> None:
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(tmp_path / "flat.stl")
    robot = rpctl.load(shaped(tmp_path, '<mesh filename="flat.stl"/>'), density=RHO)
    (message,) = (
        f.message for f in robot.findings if "cannot be used for the estimate" in f.message
    )
    assert "encloses no volume" in message
    assert robot.description.link["arm"].mass is None


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        ("none.stl", "no such file"),
        ("../../etc/passwd", "refused"),
        ("noise.stl", "which do not match its length"),
        ("far.stl", "reaches 1e+08 m"),
    ],
)
def test_an_unknown_mesh_is_not_taken_as_nothing(mesh: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "noise.stl").write_bytes(b"\x00" * 100)
    trimesh.creation.box((2e8, 1.0, 1.0)).export(tmp_path / "far.stl")
    path = shaped(tmp_path, f'<mesh filename="{mesh}"/>')
    line = path.read_text().partition("<mesh ")[0].count("\n") + 1
    with pytest.raises(DescriptionError) as caught:
        rpctl.load(path, density=RHO)
    (message,) = str(caught.value).splitlines()
    assert message.startswith(f'{path}:{line}: error: mesh "{mesh}" of link "arm" cannot be used')
    assert expected in message
    assert message.endswith("its link has no <inertial>: give one, or the mesh")
