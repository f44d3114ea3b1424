"""A robot with meshes of every bad kind, from the command line: its run is there, and notes."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.view.pages.settings import GAINS
from rpctl.view.scene.robot_meshes import build_bodies
from tests.description.corpus import BASE
from tests.description.meshes.bad_meshes import BAD, TRIANGLE, dae, obj, polygon, stl

VISUAL = """    <visual>
      <geometry><box size="0.5 0.4 0.2"/></geometry>
      <material name="red"/>
    </visual>"""
ABSURD = (
    'mesh filename="good.stl" scale="1e6 1 1"',
    'box size="1e8 0.1 0.1"',
    'sphere radius="1e-9"',
)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A robot that wears all bad meshes, a good one, one of 30 000 corners, and absurd shapes."""
    meshes = {name: content for name, (content, _) in BAD.items()}
    meshes |= {"good.stl": stl(TRIANGLE), "fan.obj": obj(polygon(30_000), [range(1, 30_001)])}
    for name, content in meshes.items():
        (tmp_path / name).write_bytes(content)
    shapes = [f'mesh filename="{name}"' for name in meshes] + [*ABSURD]
    visuals = [f"<visual><geometry><{shape}/></geometry></visual>" for shape in shapes]
    path = tmp_path / "robot.urdf"
    path.write_text(BASE.replace(VISUAL, "\n".join(visuals)), encoding="utf-8")
    return path


def check_notes(notes: Sequence[str]) -> None:
    """Check that each bad shape is named with its fault, and no other one."""
    undrawn = [each for each in notes if " not drawn: " in each]
    for expected in [expected for _, expected in BAD.values()] + [
        "reaches 1e+06 m",
        "the box of link",
        "the sphere of link",
    ]:
        assert [each for each in undrawn if expected in each], expected
    assert all('of link "base"' in each for each in undrawn)
    more = [int(found[1]) for each in undrawn if (found := re.search(r" and (\d+) more are", each))]
    assert len(undrawn) + sum(more) == len(BAD) + len(ABSURD)


def test_what_is_drawn_is_finite_and_the_rest_is_noted(robot: Path) -> None:
    bodies = build_bodies(rpctl.load(robot))
    check_notes(bodies.notes)
    assert [each.kind for each in bodies.stand_ins] == ["inertia"]
    assert {len(each.faces) for each in bodies.surfaces} == {1, 12, 29_998}
    for part in bodies.parts:
        reach = np.abs(bodies.surfaces[part.surface].vertices @ part.pose[:3, :3].T).max()
        assert 1e-6 < reach < 1e4


@pytest.mark.slow
def test_a_run_is_written_whatever_its_meshes_are(robot: Path, tmp_path: Path) -> None:
    words = ["track", str(robot), "--reference", "line", "--duration", "0.1", "--out"]
    result = CliRunner().invoke(app, [*words, str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    page = unescape((tmp_path / "out" / "report.html").read_text())
    check_notes(summary["notes"])
    assert all(note.removeprefix(GAINS) in page for note in summary["notes"])
    assert "a box of the inertia of base" in page
    assert not [word for word in ("NaN", "Infinity") if word in json.dumps(summary)]


def test_a_wheel_of_a_bad_mesh_is_told_before_anything_runs(tmp_path: Path) -> None:
    wheel = '<geometry><cylinder radius="0.15" length="0.04"/></geometry>'
    text = BASE.replace(wheel, '<geometry><mesh filename="wheel.dae"/></geometry>')
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "wheel.dae").write_bytes(dae(unit="1e300"))
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "robot.urdf")])
    said = " ".join((result.stdout + result.stderr).split())
    assert 'mesh "wheel.dae" refused: its unit is "1e300" m' in said
    assert result.exit_code in (0, 2)
