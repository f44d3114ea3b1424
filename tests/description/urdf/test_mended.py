"""Odd files that are read all the same: the robot is that of the plain file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from tests.description.corpus import BASE, CASES
from tests.proofs import failed

PLAIN = BASE.replace('<?xml version="1.0" encoding="UTF-8"?>\n', "")
FINE = {
    "utf-8 with a mark": BASE.encode("utf-8-sig"),
    "utf-16": BASE.encode("utf-16"),
    "utf-16 little, no mark": BASE.encode("utf-16-le"),
    "utf-16 big, no mark": BASE.encode("utf-16-be"),
    "utf-32": BASE.encode("utf-32"),
    "latin-1, declared": BASE.replace("UTF-8", "ISO-8859-1").replace('"red"', '"é"').encode(
        "latin-1"),
    "windows newlines": BASE.replace("\n", "\r\n").encode(),
    "old newlines": BASE.replace("\n", "\r").encode(),
    "no declaration": PLAIN.encode(),
    "comments": BASE.replace("<link ", "<!-- <link name='x'> --><link ").encode(),
    "instructions": BASE.replace("<link ", "<?edit me?><link ").encode(),
    "declared namespaces": BASE.replace("<robot ", '<robot xmlns:g="urn:g" ').replace(
        "<visual>", "<g:plugin><g:a/></g:plugin><visual>").encode(),
    "gazebo": BASE.replace("<joint ", "<gazebo reference='arm'><a/></gazebo><joint ", 1).encode(),
    "quoted otherwise": BASE.replace('"', "'").encode(),
    "blanks in numbers": BASE.replace('"0.2 0 0.4"', '"&#10; 0.2&#9;0 0.4 "').encode(),
    "exponents": BASE.replace('"30"', '"+3.E+1"').encode(),
    "text between": BASE.replace("</link>", "</link> - ").encode(),
    "safety": BASE.replace("<limit ", "<safety_controller/><dynamics/><limit ").encode(),
    "any version": BASE.replace("<robot ", '<robot version="9" ').encode(),
}  # fmt: skip


def same(one: Robot, other: Robot) -> None:
    rng = np.random.default_rng(1)
    ours, theirs = rpctl.ReducedDynamics(one), rpctl.ReducedDynamics(other)
    q, nu = one.random_configuration(rng), rng.normal(size=one.dof)
    np.testing.assert_allclose(ours.inertia(q), theirs.inertia(q), rtol=1e-12)
    np.testing.assert_allclose(ours.bias(q, nu), theirs.bias(q, nu), rtol=1e-12, atol=1e-14)


def load(path: Path, data: bytes, *, strict: bool = False) -> Robot:
    path.write_bytes(data)
    return rpctl.load(path, strict=strict)


@pytest.mark.parametrize("name", FINE)
def test_odd_but_right_files_are_read_without_a_word(name: str, tmp_path: Path) -> None:
    robot = load(tmp_path / "odd.urdf", FINE[name], strict=True)
    same(robot, load(tmp_path / "plain.urdf", BASE.encode()))


@pytest.mark.parametrize(
    "name",
    [
        "default namespace", "undeclared prefix", "undeclared prefix of an attribute",
        "latin-1 as utf-8", "unknown encoding", "declared utf-16", "long axis", "two inertials",
        "two limits", "no limit", "limits out of reach", "no name", "colour of 255",
        "blanks before the declaration", "negative effort",
    ],
)  # fmt: skip
def test_mended_files_give_the_same_dynamics(name: str, tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.name == name)
    robot = load(tmp_path / "odd.urdf", case.data)
    same(load(tmp_path / "plain.urdf", BASE.encode()), robot)
    assert not failed(rpctl.verify(robot, 2))


def test_a_chain_of_mimics_is_one_mimic_of_the_first(tmp_path: Path) -> None:
    limit = '<limit lower="-2" upper="2" effort="9" velocity="3"/>'
    links = (
        """<link name="tip"><inertial><mass value="0.2"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
      <joint name="last" type="revolute"><parent link="arm"/><child link="tip"/>
      <axis xyz="0 1 0"/><mimic joint="{}" multiplier="{}" offset="{}"/>"""
        + limit
        + "</joint>"
    )
    slide = '<limit lower="0" upper="0.1" effort="5" velocity="1"/>'
    follows = f'<mimic joint="shoulder" multiplier="0.5" offset="0.1"/>{slide}'
    chained = BASE.replace(slide, follows).replace(
        "</robot>", links.format("slide", 3, 0.2) + "</robot>"
    )
    direct = BASE.replace(slide, follows).replace(
        "</robot>", links.format("shoulder", 1.5, 0.5) + "</robot>"
    )
    one = load(tmp_path / "a.urdf", chained.encode())
    other = load(tmp_path / "b.urdf", direct.encode())
    same(one, other)
    q = one.configuration(joints={"shoulder": 0.4})
    assert one.joint_position(q, "last") == pytest.approx(1.5 * 0.4 + 0.5)
    assert not failed(rpctl.verify(one, 2))


def test_all_is_told_at_once_errors_first(tmp_path: Path) -> None:
    text = BASE.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>').replace('"30"', '"x"')
    text = text.replace('rgba="1 0 0 1"', 'rgba="1 0 0 9"')
    with pytest.raises(rpctl.RpctlError) as caught:
        load(tmp_path / "r.urdf", text.encode())
    assert [message_text.split(": ")[1] for message_text in str(caught.value).splitlines()] == [
        "error", "error", "warning",
    ]  # fmt: skip


def test_names_cannot_break_the_message(tmp_path: Path) -> None:
    name = "a&#10;b&#27;[31m" + "\u202e" + "c" * 5000
    text = BASE.replace(
        'name="slide" type="prismatic"', f'name="{name.replace("&#27;", "")}" type="x"'
    )
    with pytest.raises(rpctl.RpctlError) as caught:
        load(tmp_path / "r.urdf", text.encode())
    lines = str(caught.value).splitlines()
    assert len(lines) == 2  # a control character, and a type that is not known
    for line in lines:
        assert line.isprintable()
        assert r"a\nb" in line
        assert len(line) < 1500
