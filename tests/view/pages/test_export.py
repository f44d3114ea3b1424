"""What an exporter can get wrong: order and mirrors, in a real browser, and textures."""

from __future__ import annotations

import base64
import sys
from pathlib import Path
from typing import Any

import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.view.pages.report import write_report
from rpctl.view.pages.robot_page import robot_page
from tests.grids import cells
from tests.view.chromium import opened, picture_at
from tests.view.samples import mesh_visual, short_run, write_cart

SECRET = b"the secret of this test, which stands in no page"
DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
  <library_images><image id="i"><init_from>{texture}</init_from></image></library_images>
  <library_effects><effect id="e"><profile_COMMON>
    <newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
    <newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>
    <technique sid="c"><phong><diffuse><texture texture="t" texcoord="UV"/></diffuse></phong>
    </technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="pa" count="9">0 0 0  1 0 0  0 1 0</float_array>
      <technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/>
      <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
    </source>
    <source id="u"><float_array id="ua" count="6">0 0  1 0  0 1</float_array>
      <technique_common><accessor source="#ua" count="3" stride="2"><param name="S" type="float"/>
      <param name="T" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
      <input semantic="TEXCOORD" source="#u" offset="1" set="0"/><p>0 0 1 1 2 2</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="vs"><node><instance_geometry url="#g">
    <bind_material><technique_common><instance_material symbol="m" target="#m"/>
    </technique_common></bind_material></instance_geometry></node></visual_scene>
  </library_visual_scenes>
  <scene><instance_visual_scene url="#vs"/></scene>
</COLLADA>
"""
opened_files: list[str] = []


def note(event: str, arguments: Any) -> None:
    if event == "open":
        opened_files.append(str(arguments[0]))


@pytest.fixture(scope="module")
def audited() -> list[str]:
    """Return the names of all files opened from now on; a hook cannot be taken off again."""
    sys.addaudithook(note)
    return opened_files


def test_animation_is_applied_every_time_a_page_is_opened(
    browser: Any, paper: Robot, paper_run: Run, tmp_path: Path
) -> None:
    url = write_report(paper_run, tmp_path / "report.html", robot=paper).as_uri()
    sample = len(paper_run.t) // 2
    for _ in range(4):
        with opened(browser, url) as page:
            picture_at(page, float(paper_run.t[sample]))
            place = page.evaluate(
                "rpctl.viewer.scene.getObjectByName('robot-1').position.toArray()"
            )
            assert place[:2] == pytest.approx(paper_run.q[sample, :2], abs=2e-3)


TEXTURES = [
    "../../secret.png",
    "../secret.png",
    "file://{folder}/secret.png",
    "{folder}/secret.png",
]


@pytest.mark.parametrize("texture", cells(TEXTURES, TEXTURES[::3], TEXTURES[1:3]))
def test_texture_that_a_mesh_names_is_not_embedded(
    texture: str, tmp_path: Path, audited: list[str]
) -> None:
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    for place in (tmp_path, folder.parent):
        (place / "secret.png").write_bytes(SECRET)
    text = DAE.format(texture=texture.format(folder=tmp_path))
    (folder / "part.dae").write_text(text, encoding="utf-8")
    robot = rpctl.load(write_cart(folder.parent, mesh_visual("meshes/part.dae")))
    audited.clear()
    html = robot_page(robot)
    report = write_report(short_run(robot, 0.1), tmp_path / "report.html", robot=robot)
    assert any(name.endswith("part.dae") for name in audited)  # the mesh itself is drawn
    assert not [name for name in audited if "secret" in name or "passwd" in name]
    for page in (html.encode(), report.read_bytes()):
        for shift in range(3):  # of base64, wherever the secret begins
            encoded = base64.b64encode(b"x" * shift + SECRET)[4:-4]
            assert encoded not in page
        assert SECRET not in page
        assert b"root:x:0" not in page
