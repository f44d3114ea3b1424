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


def test_rotations_are_rotations(rng: np.random.Generator) -> None:
    for _ in range(20):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        R = rotation(axis, rng.uniform(-3, 3)) @ rotation_rpy(*rng.uniform(-3, 3, 3))
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) > 0
    np.testing.assert_allclose(rotation_rpy(0, 0, np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_what_hangs_on_a_fault_of_the_tree_is_not_told_again(tmp_path: Path) -> None:
    """Of a chain below a misspelt parent, or below a cycle, the faults alone are told."""
    chain = "".join(
        f'<joint name="j{k}" type="fixed"><parent link="l{k - 1}"/><child link="l{k}"/></joint>\n'
        for k in range(2, 30)
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(1, 30))
    for parent, lines in (("bsae", [2]), ("l2", [2, 3])):
        first = f'<joint name="j1" type="fixed"><parent link="{parent}"/><child link="l1"/></joint>'
        path = tmp_path / "tree.urdf"
        path.write_text(f'<robot name="r"><link name="base"/>{links}\n{first}\n{chain}</robot>')
        with pytest.raises(DescriptionError) as caught:
            read(path)
        assert [finding.line for finding in caught.value.findings] == lines
