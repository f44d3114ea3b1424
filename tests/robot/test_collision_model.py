"""Shapes that collide: coal's distances against geometry on paper, and which pairs may touch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.robot.collision import CollisionModel, collision_model
from tests import urdf
from tests.folding import HOME, folding
from tests.robots import write

GJK_M = 1e-5  # m: what coal's iterations leave
HOOK = urdf.limit(-1.0, 1.0, 5, 1)
LIGHT = urdf.inertial(0.1, (1e-3, 1e-3, 1e-3))


def names(model: CollisionModel) -> set[frozenset[str]]:
    return {frozenset(model.shapes[k].link for k in pair) for pair in model.pairs.tolist()}


def test_neighbours_and_the_wheels_on_the_ground_may_touch(tmp_path: Path) -> None:
    model = collision_model(folding(tmp_path))
    found = names(model)
    assert frozenset(["base", "forearm"]) in found
    assert frozenset(["column", "forearm"]) in found
    assert frozenset(["left_wheel", "upper"]) in found
    assert not found & {frozenset(["base", "upper"]), frozenset(["upper", "forearm"])}
    assert not found & {frozenset(["base", "left_wheel"]), frozenset(["base", "column"])}
    on_ground = {link for pair in found for link in pair if "ground" in pair} - {"ground"}
    assert on_ground == {"upper", "forearm"}
    assert model.allowed == ()
    assert model.notes == ()


def test_how_high_a_fixed_base_is_mounted_is_not_known(tmp_path: Path) -> None:
    """The pairs of the links stay, those with the ground go."""
    rolling, text = folding(tmp_path), folding(tmp_path).description.raw.decode()
    fixed = rpctl.load(write(tmp_path, text), drive="fixed", home=HOME)
    on_ground = {pair for pair in names(collision_model(rolling)) if "ground" in pair}
    assert names(collision_model(fixed)) == names(collision_model(rolling)) - on_ground


def test_what_touches_at_home_may_touch_and_is_told(tmp_path: Path) -> None:
    """A cage about the upper arm at home, fixed to the base beside it: it is on a third joint."""
    stand = [
        urdf.link(
            "hook", urdf.inertial(0.1, (1e-3, 1e-3, 1e-3)), urdf.shape('sphere radius="0.1"')
        ),
        urdf.joint("hook_joint", "revolute", ("base", "hook"), (0.2, 0, 0.5), "0 0 1", HOOK),
    ]
    model = collision_model(folding(tmp_path, *stand))
    assert [tuple(pair) for pair in model.allowed] == [("upper", "hook", "at home")]
    assert frozenset(["hook", "upper"]) not in names(model)
    assert frozenset(["hook", "forearm"]) in names(model)


def test_what_touches_in_every_posture_may_touch(tmp_path: Path) -> None:
    """A slider that leaves the ball of a pivot only at its home, by 2 mm of 0.2 m."""
    slide = urdf.limit(-0.2, 0.0, 5, 1)
    parts = [
        urdf.link("pivot", LIGHT, urdf.shape('sphere radius="0.2"')),
        urdf.joint("pivot_joint", "revolute", ("base", "pivot"), (0, 0, 1.5), "0 0 1", HOOK),
        urdf.link("slider", LIGHT, urdf.shape('sphere radius="0.2"')),
        urdf.joint("slide", "prismatic", ("base", "slider"), (0.402, 0, 1.5), "1 0 0", slide),
    ]
    model = collision_model(folding(tmp_path, *parts, slide=0.0))
    assert [tuple(pair) for pair in model.allowed] == [("pivot", "slider", "in every posture")]
    wide = collision_model(folding(tmp_path, *parts, slide=-0.1))
    assert [tuple(pair) for pair in wide.allowed] == [("pivot", "slider", "at home")]


def distance(robot: Robot, first: str, second: str, **joints: float) -> float:
    model = collision_model(robot)
    distances = model.distances()
    distances.place(robot.configuration(joints=joints))
    (pair,) = [
        number
        for number, pair in enumerate(model.pairs.tolist())
        if {model.shapes[k].link for k in pair} == {first, second}
    ]
    return distances.distance(pair)


def test_distances_of_a_posture_on_paper(tmp_path: Path) -> None:
    """The forearm straight down from 0.4 m ahead: its end at 0.4 - 0.35 - 0.03 m, 0.12 beside."""
    robot = folding(tmp_path)
    down = {"shoulder": 0.0, "elbow": 0.5 * np.pi}
    assert distance(robot, "forearm", "ground", **down) == pytest.approx(0.02, abs=GJK_M)
    assert distance(robot, "forearm", "base", **down) == pytest.approx(0.12, abs=GJK_M)
    folded = {"shoulder": 0.0, "elbow": np.pi}  # back along the upper arm, above the base
    assert distance(robot, "forearm", "base", **folded) == pytest.approx(0.14, abs=GJK_M)
    assert distance(robot, "forearm", "column", **folded) == pytest.approx(-0.005, abs=0.002)


MESH = 'mesh filename="part.stl" scale="1 1 2"'


@pytest.mark.slow
def test_a_mesh_is_its_hull(tmp_path: Path) -> None:
    """A tetrahedron with corners at 0.1 m, drawn out to 0.2 m along the arm."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {' '.join(map(str, corners[k]))}\n" for k in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    (tmp_path / "part.stl").write_text(f"solid part\n{facets}endsolid part\n")
    robot = folding(tmp_path, forearm=MESH)
    assert collision_model(robot).notes == ()
    down = {"shoulder": 0.0, "elbow": 0.5 * np.pi}  # from 0.2 m below the elbow on
    assert distance(robot, "forearm", "ground", **down) == pytest.approx(0.0, abs=GJK_M)
    flat = facets.replace("0.1\nendloop", "0.0\nendloop").replace(" 0.1\n", " 0.0\n")
    (tmp_path / "part.stl").write_text(f"solid part\n{flat}endsolid part\n")
    (note,) = collision_model(folding(tmp_path, forearm=MESH)).notes
    assert "it is flat: it has no convex hull" in note


@pytest.mark.slow
def test_a_disc_of_many_corners_is_its_hull_but_for_a_thousandth(tmp_path: Path) -> None:
    """A disc of 600 corners, 0.02 m thick: its caps are fans about one corner."""
    turn = np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    rim = np.column_stack([0.1 * np.cos(turn), 0.1 * np.sin(turn)])
    corners = np.vstack([np.insert(rim, 2, height, axis=1) for height in (-0.005, 0.005)])
    lines = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    for first in (1, 601):
        lines += [f"f {first} {first + k} {first + k + 1}" for k in range(1, 599)]
    (tmp_path / "disc.obj").write_text("\n".join(lines) + "\n")
    robot = folding(tmp_path, forearm='mesh filename="disc.obj" scale="1 1 2"')
    assert collision_model(robot).notes == ()
    level = {"shoulder": 0.0, "elbow": 0.0}  # on its edge, 0.4 m above the ground
    assert distance(robot, "forearm", "ground", **level) == pytest.approx(0.3, abs=5e-4)


def test_for_a_missing_mesh_a_box_stands_in(tmp_path: Path) -> None:
    """The box of its moments is 0.49 m long, and ends where the elbow is, 0.2 m from its middle."""
    robot = folding(tmp_path, forearm=MESH)
    model = collision_model(robot)
    (note,) = model.notes
    assert note.startswith("the collision mesh of forearm is missing (no such file")
    assert note.endswith("a box of the link's inertia instead")
    up = {"shoulder": -0.5 * np.pi, "elbow": 0.0}  # its middle 1.0 m above the ground
    assert distance(robot, "forearm", "ground", **up) == pytest.approx(1.0 - 0.2, abs=GJK_M)
    level = {"shoulder": 0.0, "elbow": 0.0}  # 0.346 m high
    height = 0.5 * np.sqrt(6.0 * (0.02 + 0.03 - 0.03) / 1.0)
    assert distance(robot, "forearm", "ground", **level) == pytest.approx(0.4 - height, abs=GJK_M)
