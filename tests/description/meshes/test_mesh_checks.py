"""Meshes that a robot cannot show are told when it is loaded, with their lines."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

import rpctl
from rpctl.errors import DescriptionError
from tests.description.corpus import BASE

BOX = '<box size="0.5 0.4 0.2"/>'
LINE = BASE[: BASE.index(BOX)].count("\n") + 1
DAE = "<COLLADA><library_images><image><init_from>{}</init_from></image></library_images></COLLADA>"


def with_mesh(tmp_path: Path, name: str) -> Path:
    folder = tmp_path / "ws" / "bot" / "urdf"
    folder.mkdir(parents=True, exist_ok=True)
    (folder.parent / "package.xml").write_text("<package/>")
    path = folder / "bot.urdf"
    path.write_text(BASE.replace(BOX, f'<mesh filename="{name}"/>'), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("none.stl", "no such file; add it"),
        ("package://bot/none.stl", "no such file"),
        ("package://nobody/a.stl", 'package "nobody" was not found; declare a folder'),
        ("package://", "package:// without the name of a package"),
        ("../../etc/passwd", "refused: it lies outside the folders"),
        ("../../../../../../../../etc/passwd", "refused: it lies outside the folders"),
        ("/etc/passwd", "refused: it lies outside the folders"),
        ("package://bot/../../../etc/passwd", "refused: it lies outside the folders"),
        ("file:///etc/passwd", "refused: it lies outside the folders"),
        ("file://etc/passwd", "refused: rpctl reads only package:// and paths"),
        ("http://example.org/a.stl", "refused: rpctl reads only package:// and paths"),
        ("bot.urdf", "refused: the name of a mesh must end in .stl"),
        ("a" * 5000 + ".stl", "refused: this is not a valid file name"),
    ],
)  # fmt: skip
def test_meshes_out_of_reach_are_told(name: str, expected: str, tmp_path: Path) -> None:
    path = with_mesh(tmp_path, name)
    (finding,) = rpctl.load(path).findings
    assert (finding.severity, finding.line) == ("warning", LINE)
    assert finding.message.startswith('mesh "')
    assert any(part in finding.message for part in expected.split("|"))
    with pytest.raises(DescriptionError, match=f":{LINE}: error: mesh"):
        rpctl.load(path, strict=True)


def test_a_folder_whose_name_begins_alike_is_another(tmp_path: Path) -> None:
    path = with_mesh(tmp_path, "../../bot_private/a.stl")
    (tmp_path / "ws" / "bot_private").mkdir()
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "ws" / "bot_private" / "a.stl")
    (finding,) = rpctl.load(path).findings
    assert "refused: it lies outside the folders" in finding.message


def test_all_missing_packages_are_told_in_one_warning(tmp_path: Path) -> None:
    path = with_mesh(tmp_path, "package://b/0.stl")
    visual = '<visual><geometry><mesh filename="package://{}/1.stl"/></geometry></visual>\n'
    more = visual.format("a") + visual.format("b")
    path.write_text(path.read_text().replace("<visual>", f"{more}<visual>", 1))
    (finding,) = rpctl.load(path).findings
    line = path.read_text().partition("package://a/")[0].count("\n") + 1
    assert finding.line == line
    assert finding.message == (
        f"2 packages of meshes were not found: a (line {line}), b (line {line + 1} and 1 more); "
        "declare a folder above them with --package-dir or in ROS_PACKAGE_PATH"
    )
