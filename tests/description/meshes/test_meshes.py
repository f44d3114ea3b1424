from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.meshes.reading import read_mesh
from rpctl.files.caps import read_input

TEAPOT = """<?xml version="1.0"?>{doctype}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>../../secret.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse>
<color>1 0.5 0 1</color></diffuse></lambert></technique></profile_COMMON></effect>
</library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 100 0 0 0 200 0</float_array>
<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="ms"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material>
<technique_common><instance_material symbol="ms" target="#m"/></technique_common>
</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def resolve(name: str, urdf: Path, *package_dirs: Path) -> Path:
    return MeshPaths(urdf, package_dirs).resolve(name)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a URDF in a package beside another one, with a mesh in each and one outside."""
    for folder in ("ws/bot/urdf", "ws/bot/meshes", "ws/other"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "ws/bot/package.xml").write_text("<package/>")
    for mesh in ("ws/bot/meshes/a.stl", "ws/bot/urdf/b.stl", "ws/other/c.stl", "outside.stl"):
        trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / mesh)
    (tmp_path / "ws/bot/urdf/notes.txt").write_text("secret")
    (tmp_path / "ws/bot/meshes/link.stl").symlink_to(tmp_path / "outside.stl")
    (tmp_path / "ws/bot/meshes/inner.stl").symlink_to("a.stl")
    return tmp_path / "ws/bot/urdf/bot.urdf"


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("package://bot/meshes/a.stl", "bot/meshes/a.stl"),
        ("package://other/c.stl", "other/c.stl"),
        ("../meshes/a.stl", "bot/meshes/a.stl"),
        ("b.stl", "bot/urdf/b.stl"),
        ("../meshes/inner.stl", "bot/meshes/a.stl"),
    ],
)
def test_meshes_are_found_in_declared_roots(package: Path, name: str, found: str) -> None:
    assert resolve(name, package) == package.parents[2] / found


def test_declared_packages_come_first(package: Path, tmp_path: Path) -> None:
    for mesh in ("near/other/c.stl", "far/other/c.stl", "far/other/d.stl"):
        (tmp_path / mesh).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((1, 1, 1)).export(tmp_path / mesh)
    near, far = tmp_path / "near", tmp_path / "far"
    assert resolve("package://other/c.stl", package) == package.parents[2] / "other/c.stl"
    assert resolve("package://other/c.stl", package, near) == near / "other/c.stl"
    assert resolve("package://other/c.stl", package, far, near) == far / "other/c.stl"
    assert resolve("package://other/d.stl", package, near, far) == far / "other/d.stl"
    assert resolve("package://other/c.stl", package, near / "other") == near / "other/c.stl"
    with pytest.raises(MeshError, match="refused"):
        resolve("package://other/../../outside.stl", package, near)


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "../../../../../../../../etc/passwd",
        "/etc/passwd",
        "file:///etc/passwd",
        "file://b.stl",
        "http://example.org/a.stl",
        "../../../outside.stl",
        "package://bot/../../outside.stl",
        "package://../outside.stl",
        "package:///etc/passwd",
        "package://./b.stl",
        "package://etc/passwd",
        "../meshes/link.stl",
        "notes.txt",
        "b.stl/../notes.txt",
        "package://bot\0/b.stl",
    ],
)
def test_names_outside_the_roots_are_refused(package: Path, name: str) -> None:
    with pytest.raises(MeshError, match=r"refused|not found"):
        resolve(name, package)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb"])
def test_every_format_gives_the_same_triangles(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"box.{kind}"
    trimesh.creation.box((1.0, 2.0, 3.0)).export(path)
    (surface,) = read_mesh(path).surfaces
    assert len(surface.faces) == 12
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_dae_is_in_metres_with_its_colour_and_no_texture(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text(TEAPOT.format(doctype=""))
    (surface,) = read_mesh(tmp_path / "a.dae").surfaces
    assert surface.vertices.max(axis=0) == pytest.approx([1.0, 2.0, 0.0])
    assert surface.rgba == pytest.approx((1.0, 0.5, 0.0, 1.0), abs=0.01)


def test_dae_with_entities_is_refused(tmp_path: Path) -> None:
    doctype = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    for encoding in ("utf-8", "utf-16"):
        (tmp_path / "a.dae").write_text(TEAPOT.format(doctype=doctype), encoding=encoding)
        with pytest.raises(MeshError, match="refused"):
            read_mesh(tmp_path / "a.dae")


def test_obj_opens_no_file_but_the_mtl_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "meshes"
    folder.mkdir()
    (tmp_path / "outside.mtl").write_text("newmtl x\nKd 0 0 1\n")
    (tmp_path / "secret.png").write_bytes(b"secret")
    (folder / "a.mtl").write_text("newmtl x\nKd 1 0 0\nmap_Kd ../secret.png\n")
    shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl x\nf 1 2 3\n"
    (folder / "a.obj").write_text("mtllib a.mtl\n" + shape)
    (folder / "b.obj").write_text("mtllib ../outside.mtl\n" + shape)
    opened: list[Path] = []

    def spy(path: Path, cap_name: str, kind: str) -> bytes:
        opened.append(path)
        return read_input(path, cap_name, kind)

    monkeypatch.setattr(mesh_files, "read_input", spy)
    (inside,) = read_mesh(folder / "a.obj").surfaces
    (outside,) = read_mesh(folder / "b.obj").surfaces
    assert inside.rgba == pytest.approx((1.0, 0.0, 0.0, 1.0), abs=0.01)
    assert outside.rgba != pytest.approx((0.0, 0.0, 1.0, 1.0), abs=0.01)
    assert {path.name for path in opened} == {"a.obj", "a.mtl", "b.obj"}
