"""Reading a URDF: what is wrong is named with its line and the way out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rpctl.description.records import rotation, rotation_rpy
from rpctl.description.urdf.reader import read
from rpctl.errors import DescriptionError
from tests.robots import SET_A, platform, write

GOOD = platform(SET_A)


def message(tmp_path: Path, text: str) -> str:
    path = write(tmp_path, text)
    with pytest.raises(DescriptionError) as caught:
        read(path)
    expected = str(caught.value)
    assert all(line.startswith(f"{path}") for line in expected.splitlines())
    return expected


def test_a_good_file_reads_as_written(tmp_path: Path) -> None:
    description = read(write(tmp_path, GOOD))
    assert description.name == "platform"
    assert description.root == "base"
    assert [joint.name for joint in description.joints] == ["left_joint", "right_joint"]
    base = description.link["base"]
    assert base.mass == SET_A["m_c"]
    np.testing.assert_allclose(base.com, [0.3, 0.0, 0.2])
    np.testing.assert_allclose(base.inertia, SET_A["I_c"] * np.eye(3))
    assert not description.findings


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', 'axis of joint "left_joint" is zero'),
        ('axis xyz="0 1 0"', 'axis xyz="0 1"', "has 2 numbers; give 3"),
        ('mass value="30.0"', 'mass value="heavy"', "is not a number"),
        ('mass value="30.0"', 'mass value="nan"', "is not finite"),
        ('mass value="30.0"', 'mass value="1e999"', "is not finite"),
        ('mass value="30.0"', 'mass value="1,5"', "is not a number"),
        ('mass value="30.0"', 'mass value="-3"', "is negative"),
        ('<mass value="30.0"/>', "", "has no <mass>; add it"),
        ('<child link="left_wheel"/>', '<child link="wheel"/>', 'unknown link "wheel"'),
        ('<child link="left_wheel"/>', "", 'has no <child link="...">'),
        ('<child link="right_wheel"/>', '<child link="left_wheel"/>', "has two parents"),
        ('type="continuous"', 'type="rotary"', 'has type "rotary"; use one of'),
        ('type="continuous"', 'type="floating"', "is floating"),
        ('joint name="right_joint"', 'joint name="left_joint"', '"left_joint" is already at line'),
        ('link name="right_wheel"', 'link name="left_wheel"', '"left_wheel" is already at line'),
    ],
)
def test_faults_are_named_with_their_line(
    tmp_path: Path, before: str, after: str, expected: str
) -> None:
    assert before in GOOD
    bad = GOOD.replace(before, after, 1)
    findings = message(tmp_path, bad).splitlines()
    first = GOOD[: GOOD.index(before)].count("\n") + 1
    lines = [int(finding.split(":")[1]) for finding in findings if expected in finding]
    # The line is the attribute's own, or that of the element around it.
    assert any(first - 4 <= line <= first for line in lines)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "the file is empty"),
        ("wheels: 2", "not XML"),
        (GOOD[:-20], "the file is truncated"),
        ("<sdf version='1.6'></sdf>", "this is SDF, not URDF"),
        ("<mujoco></mujoco>", "this is MJCF, not URDF"),
        ("<html></html>", "this is HTML"),
        ("<robot name='r'/>", "has no <link>"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot><link name='a'/></robot>", "a DOCTYPE"),
        ("<robot><link name='a'/><link name='b'/></robot>", "2 root links"),
    ],
)
def test_other_files_are_told_apart(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in message(tmp_path, text)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"none\.urdf: error: No such file"):
        read(tmp_path / "none.urdf")
    with pytest.raises(DescriptionError, match="Is a directory"):
        read(tmp_path)


def test_unphysical_inertias_warn(tmp_path: Path) -> None:
    bad = GOOD.replace('iyy="15.625"', 'iyy="-1"')
    (finding,) = read(write(tmp_path, bad)).findings
    assert finding.severity == "warning"
    assert finding.line == 5
    assert 'link "base" is not positive definite' in finding.message
    bad = GOOD.replace('iyy="15.625"', 'iyy="60"')
    (finding,) = read(write(tmp_path, bad)).findings
    assert "breaks the triangle rule" in finding.message


def test_rotations_are_rotations(rng: np.random.Generator) -> None:
    for _ in range(20):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        R = rotation(axis, rng.uniform(-3, 3)) @ rotation_rpy(*rng.uniform(-3, 3, 3))
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) > 0
    np.testing.assert_allclose(rotation_rpy(0, 0, np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
