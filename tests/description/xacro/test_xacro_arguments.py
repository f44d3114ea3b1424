"""Arguments of xacro: given in words or in Python, listed, and told when missing or unknown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.description.records import ReadSettings
from rpctl.description.xacro.expansion import expand
from rpctl.description.xacro.messages import ExpansionError
from rpctl.errors import DescriptionError
from tests.workspaces import link, write, xacro

pytest.importorskip("xacro")

MASS = '<xacro:arg name="mass" default="3"/>'
USE = link("base", "$(arg mass)")


def call(*words: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout, result.stderr


def mass(*words: object) -> float:
    code, out, err = call("expand", *words)
    assert code == 0, err
    return float(out.partition('<mass value="')[2].partition('"')[0])


def test_words_stand_anywhere(tmp_path: Path) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", MASS, USE)
    assert mass(path) == 3.0
    assert mass(path, "mass:=7") == mass("mass:=7", path) == mass("--xacro-arg", "mass:=7", path)
    words = ("mass:=6", "--drive", "fixed", path, "--json", "mass:=8")
    assert json.loads(call("inspect", *words)[1])["mass"] == 8.0
    robot = rpctl.load(path, drive="fixed", xacro_args={"mass": 9})
    assert robot.mass == 9.0


def test_a_missing_argument_lists_those_declared(tmp_path: Path) -> None:
    part = xacro(tmp_path / "part.xacro", '<xacro:arg name="b" default="$(arg a)/x"/>')
    path = xacro(
        tmp_path / "r.urdf.xacro", '<xacro:arg name="a" default="1"/>',
        '<xacro:include filename="part.xacro"/>', link("base", "$(arg sise)"),
        '<xacro:arg name="size" default="2"/>',
    )  # fmt: skip
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    assert str(caught.value).splitlines() == [
        f'{path}:4: error: xacro: argument "sise" has no value; add sise:=VALUE; did you mean '
        "size?",
        f'{path}:2: info: declares a, which is "1" by default',
        f'{path}:5: info: declares size, which is "2" by default',
        f'{part}:2: info: declares b, which is "$(arg a)/x" by default',
    ]


def test_an_argument_used_too_early_has_its_default(tmp_path: Path) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", USE, MASS)
    found = expand(path)
    assert '<mass value="3"/>' in found.text
    note = 'argument "mass" is used before it is declared; xacro uses its default'
    assert [f.message for f in found.findings] == [note]
    assert mass(path, "mass:=4") == 4.0
    late = '<xacro:arg name="mass" default="$(arg other)"/>'
    path = xacro(tmp_path / "s.urdf.xacro", USE, late)
    fault = r'xacro:2: error: xacro: argument "mass" has no value; add mass:=VALUE other:=VALUE, b'
    with pytest.raises(ExpansionError, match=fault):
        expand(path)


def test_a_default_that_names_no_file_is_told(tmp_path: Path) -> None:
    write(tmp_path / "ur5.yaml", "m: 4")
    write(tmp_path / "ur10.yaml", "m: 5")
    write(tmp_path / "notes.txt", "")
    lines = ('<xacro:arg name="type" default="ur5x"/>', '<xacro:arg name="b" default="1"/>')
    load = "<xacro:property name=\"m\" value=\"${xacro.load_yaml('$(arg type).yaml')['m']}\"/>"
    path = xacro(tmp_path / "r.urdf.xacro", *lines, load, link("base", "${m}"))
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    fault, *hints = str(caught.value).splitlines()
    assert "ur5x.yaml: No such file or directory" in fault
    declared = f'{path}:2: info: declares type, which is "ur5x" by default'
    assert hints == [f"{declared}; there are ur10, ur5"]
    assert mass(path, "type:=ur5") == 4.0


def test_an_argument_that_nobody_declares_is_an_error(tmp_path: Path) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", MASS, USE)
    with pytest.raises(ExpansionError) as caught:
        expand(path, ReadSettings(xacro_args={"mas": "1"}))
    assert str(caught.value).splitlines() == [
        f'{path}: error: no file declares the argument "mas"; did you mean mass?',
        f'{path}:2: info: declares mass, which is "3" by default',
    ]
    undeclared = xacro(tmp_path / "u.urdf.xacro", USE)
    assert mass(undeclared, "mass:=5") == 5.0
    plain = write(tmp_path / "plain.urdf", f'<robot name="r">{link("base")}</robot>')
    with pytest.raises(
        DescriptionError, match="contains no xacro, so it takes no arguments; leave out"
    ):
        rpctl.load(plain, xacro_args={"mass": 1})


def test_inspect_lists_the_arguments(tmp_path: Path) -> None:
    part = xacro(tmp_path / "part.xacro", '<xacro:arg name="b" default=""/>')
    include = '<xacro:include filename="part.xacro"/>'
    path = xacro(tmp_path / "r.urdf.xacro", include, MASS, link("base", "$(arg nobody)"))
    code, out, _ = call("inspect", path, "--xacro-args", "--json")
    assert code == 0
    assert json.loads(out) == [
        {"name": "mass", "default": "3", "file": str(path), "line": 3},
        {"name": "b", "default": "", "file": str(part), "line": 2},
    ]
    code, out, _ = call("inspect", path, "--xacro-args")
    assert code == 0
    assert [line.split() for line in out.splitlines() if ":" in line] == [
        ["mass", "3", "r.urdf.xacro:3"], ["b", '""', "part.xacro:2"]
    ]  # fmt: skip
    plain = write(tmp_path / "plain.urdf", f'<robot name="r">{link("base")}</robot>')
    code, out, _ = call("inspect", plain, "--xacro-args", "--json")
    assert (code, json.loads(out)) == (0, [])


def test_arguments_that_nobody_gives_are_told_at_once(tmp_path: Path) -> None:
    """Those that are given, that have a default, or that a comment names are none of them."""
    more = '<!-- $(arg old) --><xacro:arg name="side" default=""/>'
    uses = "".join(f'<m v="$(arg {name})"/>' for name in ("mass", "size", "side", "given"))
    path = xacro(tmp_path / "r.urdf.xacro", more, uses)
    with pytest.raises(ExpansionError, match=r"no value; add mass:=VALUE size:=VALUE\n"):
        expand(path, ReadSettings(xacro_args={"given": "1"}))
    given = dict.fromkeys(("given", "mass", "size"), "1")
    assert '<m v="1"/>' in expand(path, ReadSettings(xacro_args=given)).text
