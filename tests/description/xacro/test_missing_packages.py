"""Missing packages: all told in one message with the lines that want them, or left out."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.description.records import ReadSettings
from rpctl.description.xacro.expansion import expand
from rpctl.description.xacro.messages import ExpansionError
from rpctl.errors import RpctlError
from tests.workspaces import fixed, link, package, write, xacro

pytest.importorskip("xacro")

LENIENT = ReadSettings(ignore_missing_packages=True)


def include(name: str) -> str:
    return f'<xacro:include filename="{name}"/>'


def husky(folder: Path) -> Path:
    """Return a robot that lacks a laser's package, a camera's behind a found one, and a mesh's."""
    bot = package(folder / "src" / "bot")
    mount = package(folder / "src" / "repo" / "mount")
    xacro(
        mount / "urdf" / "mount.xacro", include("$(find camera)/urdf/camera.xacro"),
        '<xacro:macro name="mount" params="parent">', link("mount", "2"),
        fixed("mount_joint", "${parent}", "mount"),
        '<xacro:camera parent="mount"/>', "</xacro:macro>",
    )  # fmt: skip
    return xacro(
        bot / "urdf" / "bot.urdf.xacro", include("$(find laser)/laser.xacro"),
        include("package://mount/urdf/mount.xacro"), include("$(find laser)/other.xacro"),
        link("base", "5"), '<xacro:laser parent="base"><origin xyz="0 0 1"/></xacro:laser>',
        '<xacro:mount parent="base"/>', fixed("tip_joint", "laser", "tip"), link("tip"),
        fixed("end_joint", "tip", "end"), link("end"), fixed("to_laser", "base", "laser"),
        '<gazebo><p>$(find control)/c.yaml</p></gazebo>',
        '<transmission name="gone"><joint name="to_laser"/></transmission>',
        '<transmission name="kept"><joint name="mount_joint"/></transmission>',
        '<link name="hull"><visual><geometry><mesh filename="package://hulls/h.stl"/></geometry>',
        "</visual></link>", fixed("hull_joint", "base", "hull"),
    )  # fmt: skip


def test_all_are_told_at_once_with_the_lines_that_want_them(tmp_path: Path) -> None:
    path = husky(tmp_path)
    mount = tmp_path / "src" / "repo" / "mount" / "urdf" / "mount.xacro"
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    assert str(caught.value).splitlines() == [
        f"{path}: error: 4 packages were not found: laser, camera, control, hulls; declare a "
        "folder above them with --package-dir or in ROS_PACKAGE_PATH, or leave out what comes "
        "from them with --ignore-missing-packages",
        f'{path}:2: info: needs package "laser"',
        f'{path}:4: info: needs package "laser"',
        f'{mount}:2: info: needs package "camera"',
        f'{path}:13: info: names package "control"',
        f'{path}:16: info: names package "hulls"',
    ]


def test_a_folder_above_them_is_all_that_is_needed(tmp_path: Path) -> None:
    path = husky(tmp_path / "ws")
    far = tmp_path / "far" / "src"
    body = link("laser", "0.5"), '<xacro:insert_block name="place"/>'
    macro = '<xacro:macro name="laser" params="parent *place">', *body, "</xacro:macro>"
    xacro(package(far / "repo" / "laser") / "laser.xacro", *macro)
    xacro(far / "repo" / "laser" / "other.xacro")
    lens = '<xacro:macro name="camera" params="parent">', link("camera", "0.25")
    joint = fixed("camera_joint", "${parent}", "camera"), "</xacro:macro>"
    xacro(package(far / "deep" / "er" / "camera") / "urdf" / "camera.xacro", *lens, *joint)
    robot = rpctl.load(path, "fixed", package_dirs=[far])
    assert robot.mass == pytest.approx(5.0 + 2.0 + 0.5 + 0.25 + 1.0 + 1.0)


def test_what_comes_from_them_is_left_out_and_told(tmp_path: Path) -> None:
    path = husky(tmp_path)
    robot = rpctl.load(path, "fixed", ignore_missing_packages=True)
    assert {each.name for each in robot.description.links} == {"base", "mount", "hull"}
    assert robot.mass == pytest.approx(7.0)
    told = [f.message for f in robot.findings if "left out" in f.message]
    assert told == [
        'left out, because package "laser" was not found: the includes of bot.urdf.xacro:2, '
        "bot.urdf.xacro:4",
        'left out, because package "camera" was not found: the includes of mount.xacro:2',
        "left out: <xacro:laser>, a macro that was not found (bot.urdf.xacro:6)",
        "left out: <xacro:camera>, a macro that was not found (mount.xacro:6)",
        'left out: tip, end, which hang on the missing link "laser"',
        'left out: joint "to_laser", whose link "laser" is missing',
        'left out: transmission "gone"',
    ]
    assert 'package "control" was not found; only text refers to it (bot.urdf.xacro:13)' in [
        f.message for f in robot.findings
    ]
    with pytest.raises(RpctlError, match="error: left out: <xacro:laser>"):
        rpctl.load(path, "fixed", ignore_missing_packages=True, strict=True)


def test_files_that_must_be_read_are_needed_all_the_same(tmp_path: Path) -> None:
    path = xacro(
        tmp_path / "r.urdf.xacro", include("$(find laser)/laser.xacro"),
        "<xacro:property name=\"m\" value=\"${xacro.load_yaml('$(find sizes)/m.yaml')}\"/>",
        link("base", "${m['base']}"),
    )  # fmt: skip
    with pytest.raises(ExpansionError, match="2 packages were not found: laser, sizes"):
        expand(path)
    with pytest.raises(ExpansionError, match=r"that was not found \(laser, sizes\); declare"):
        expand(path, LENIENT)


def test_a_urdf_that_holds_xacro_is_expanded_and_told(tmp_path: Path) -> None:
    path = xacro(tmp_path / "r.urdf", '<xacro:property name="m" value="4"/>', link("base", "${m}"))
    robot = rpctl.load(path, "fixed")
    assert robot.mass == 4.0
    assert robot.description.expanded
    note = robot.findings[-1].message
    assert note.startswith(
        "it contains xacro, so rpctl expanded it although its name does not "
        "end in .xacro; lines are"
    )
    commented = link("base").replace("<link", "<!-- <xacro:leg/> $(find a) --><link")
    plain = rpctl.load(write(tmp_path / "p.urdf", f'<robot name="r">{commented}</robot>'), "fixed")
    assert not plain.description.expanded


def test_xacro_from_before_jade_is_told(tmp_path: Path) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", link("base", "${m}"), '<property name="m" value="4"/>')
    with pytest.raises(ExpansionError, match=r"r.urdf.xacro:3: error: this is xacro from before"):
        expand(path)


def test_an_include_is_found_where_the_source_keeps_it(tmp_path: Path) -> None:
    """An installation drops the folder "description"; the path in the file is the installed one."""
    bot = package(tmp_path / "src" / "bot")
    path = xacro(
        bot / "description" / "urdf" / "bot.xacro", include("$(find bot)/parts/wheel.xacro")
    )
    wheel = xacro(bot / "description" / "parts" / "wheel.xacro", link("wheel"))
    expansion = expand(path)
    assert 'name="wheel"' in expansion.text
    told = [finding.message for finding in expansion.findings]
    assert told == [
        f'"{bot}/parts/wheel.xacro" does not exist until its package is installed; rpctl reads '
        f"{wheel}"
    ]
