"""Boxes about links: their sizes from shapes or inertias, and how deep a point is in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.robot.link_boxes import LinkBoxes, link_boxes
from tests import urdf
from tests.robot.arms import BEND, write

MESH = 'mesh filename="none.stl"'


def solid(mass: float, edges: tuple[float, float, float], rpy: str = "", xyz: str = "") -> str:
    """Return the inertia of a solid box (kg, m)."""
    x, y, z = (mass / 12.0 * edge**2 for edge in edges)
    return urdf.inertial(mass, (y + z, z + x, x + y), rpy=rpy, xyz=xyz)


def one_link(folder: Path, *inside: str, more: str = "") -> Robot:
    """Load a base, and a link "rod" of these parts that turns about z, 1 m above it."""
    joint = urdf.joint("turn", "revolute", ("base", "rod"), "0 0 1", "0 0 1", BEND)
    return rpctl.load(write(folder, urdf.link("rod", *inside), joint, more), drive="fixed")


def halves(robot: Robot) -> list[list[float]]:
    return [sorted(half.tolist()) for _, half in link_boxes(robot.description, "rod")]


@pytest.mark.parametrize(
    ("shape", "half"),
    [
        ('box size="0.2 0.6 0.4"', (0.1, 0.3, 0.2)),
        ('cylinder radius="0.1" length="0.6"', (0.1, 0.1, 0.3)),
        ('capsule radius="0.1" length="0.6"', (0.1, 0.1, 0.4)),
        ('sphere radius="0.1"', (0.1, 0.1, 0.1)),
    ],
)
def test_a_shape_has_its_box(shape: str, half: tuple[float, ...], tmp_path: Path) -> None:
    robot = one_link(tmp_path, solid(1.0, (0.1, 0.1, 0.1)), urdf.shape(shape))
    ((_, found),) = link_boxes(robot.description, "rod")
    np.testing.assert_allclose(found, half)


def test_a_mesh_has_the_box_of_its_inertia_no_larger_than_the_link(tmp_path: Path) -> None:
    """The next joint is 0.3 m away, so 0.25 m fit; from 0.12 m, they do not."""
    for reach, half in ((0.3, 0.25), (0.12, 0.12)):
        tip = urdf.link("tip", solid(0.1, (0.1, 0.1, 0.1)))
        joint = urdf.joint("bend", "revolute", ("rod", "tip"), f"{reach} 0 0", "0 1 0", BEND)
        inertia = solid(2.0, (0.5, 0.04, 0.08), rpy="0 0 0.4")
        found = halves(one_link(tmp_path, inertia, urdf.shape(MESH), more=tip + joint))
        np.testing.assert_allclose(found, [[0.02, 0.04, half]], atol=1e-12)


def at(robot: Robot, turn: float) -> pin.Data:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.configuration(joints={"turn": turn}))
    return data


def test_a_point_is_as_deep_as_its_way_to_the_nearest_face(tmp_path: Path) -> None:
    """A bar from 0 to 0.8 m along x, 0.2 m wide and 0.1 m high, turned with its joint."""
    bar = urdf.shape('box size="0.8 0.2 0.1"', xyz="0.4 0 0")
    robot = one_link(tmp_path, solid(1.0, (0.8, 0.2, 0.1), xyz="0.4 0 0"), bar)
    boxes = LinkBoxes(robot, ["rod"], 0.0)
    for turn in (0.0, 0.7, -2.0):
        cos, sin, data = math.cos(turn), math.sin(turn), at(robot, turn)
        for along, across, up, depth in (
            (0.4, 0.0, 0.0, 0.05), (0.78, 0.0, 0.0, 0.02), (0.4, -0.09, 0.03, 0.01),
            (0.82, 0.0, 0.0, 0.0), (0.4, 0.11, 0.0, 0.0), (-0.01, 0.0, 0.0, 0.0),
        ):  # fmt: skip
            point = np.array([[cos * along - sin * across, sin * along + cos * across, 1.0 + up]])
            assert boxes.depth(data, point) == pytest.approx(depth, abs=1e-12)
            outside = np.array([[5.0, 5.0, 5.0]])
            both = np.vstack([outside, point])
            assert boxes.depth(data, both) == pytest.approx(depth, abs=1e-12)
    grown = LinkBoxes(robot, ["rod"], 0.1)
    assert grown.depth(at(robot, 0.0), np.array([[0.4, 0.15, 1.0]])) == pytest.approx(0.05)
