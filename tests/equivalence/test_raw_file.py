"""The proof's own reading of the user's bytes: the same robot, by other rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.description.frozen_tree import FrozenTree
from rpctl.equivalence.file_drive import read
from rpctl.equivalence.raw_file import read_file
from rpctl.robot.catalog import names
from tests.description.urdf.test_mended import FINE
from tests.grids import cells
from tests.proofs import failed
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
    assert not failed(rpctl.verify(robot, 2))
