"""The proof's own reading of the user's bytes: the same robot, by other rules."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.description.frozen_tree import FrozenTree
from rpctl.equivalence import file_drive, file_wheels, planar, raw_file, tree, wheel_slip
from rpctl.equivalence.file_reading import read
from rpctl.equivalence.raw_file import read_file
from rpctl.robot.catalog import names
from tests.description.urdf.test_mended import FINE
from tests.grids import cells
from tests.robots import SET_A, platform, write


@pytest.mark.parametrize(
    "name", cells(names(), ("paper", "tiago", "mecanum", "car", "swerve", "panda"))
)
def test_the_minimal_reader_places_every_link_as_the_strict_one(name: str) -> None:
    description = rpctl.load(name).description
    raw = read_file(description.raw)
    rng = np.random.default_rng(3)
    positions = {joint.name: float(rng.uniform(-1.0, 1.0)) for joint in description.joints}
    poses, frozen = raw.poses(positions), FrozenTree(description, positions)
    assert list(raw.link) == list(description.link)
    for link in description.links:
        expected = frozen.pose(link.name)
        np.testing.assert_allclose(poses[link.name], expected, rtol=0, atol=1e-13)
        shapes = [(s.kind, s.size) for s in (*link.collisions, *link.visuals)]
        assert [(s.kind, s.size) for s in raw.link[link.name].shapes] == shapes


@pytest.mark.parametrize("name", FINE)
def test_the_minimal_reader_reads_odd_files(name: str) -> None:
    """Byte-order marks, wide characters, other newlines, namespaces: the same tree."""
    plain, odd = read_file(FINE["no declaration"]), read_file(FINE[name])
    assert list(odd.joint) == list(plain.joint)
    for link, pose in plain.poses({}).items():
        np.testing.assert_array_equal(odd.poses({})[link], pose)


def test_it_reads_by_itself_only_what_yourdfpy_cannot(tmp_path: Path) -> None:
    text = platform(SET_A)
    assert read(rpctl.load(write(tmp_path, text))).yourdfpy
    spaced = text.replace("<robot ", '<robot xmlns="http://example.org/urdf" ')
    robot = rpctl.load(write(tmp_path, spaced))
    reading = read(robot)
    assert not reading.yourdfpy
    assert reading.links == reading.raw.links
    assert rpctl.verify(robot, 2).passed


@pytest.mark.parametrize("module", [raw_file, file_wheels, file_drive, wheel_slip])
def test_it_shares_no_number_with_the_strict_reader_or_the_detection(module: object) -> None:
    """Of ``description`` only meshes are opened through it; of ``robot`` records are named."""
    source = Path(str(module.__file__)).read_text(encoding="utf-8")  # type: ignore[attr-defined]
    nodes = list(ast.walk(ast.parse(source)))
    imported = {
        f"{node.module}.{alias.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    rooms = ("rpctl.description", "rpctl.drive", "rpctl.robot")
    own = {each for each in imported if each.startswith(rooms)}
    assert own <= {
        "rpctl.description.meshes.reading",
        "rpctl.description.meshes.paths.MeshError",
        "rpctl.description.meshes.paths.MeshPaths",
        "rpctl.drive.drive.Drive",
        "rpctl.drive.drive.Swivel",
        "rpctl.drive.drive.Wheel",
        "rpctl.robot.model.Robot",
    }
    read_of_robot = {n.attr for n in nodes if isinstance(n, ast.Attribute)}
    assert not read_of_robot & {"xml", "model", "tree", "child_joints", "parent_joint"}


@pytest.mark.parametrize("module", [raw_file, file_wheels, file_drive, tree, planar])
def test_poses_and_axes_are_not_those_of_the_detection(module: object) -> None:
    source = Path(str(module.__file__)).read_text(encoding="utf-8")  # type: ignore[attr-defined]
    assert not re.search(r"frozen_tree|FrozenTree|robot\.tree\b", source)
