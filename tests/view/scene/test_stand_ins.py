"""What is drawn of links whose meshes are missing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import rpctl
from rpctl import Robot
from rpctl.view.film import player
from rpctl.view.pages.report import write_report
from rpctl.view.pages.robot_page import robot_page
from rpctl.view.scene.robot_meshes import STRIPE_RATIO, Bodies, build_bodies
from rpctl.view.scene.scene import build_scene
from rpctl.view.scene.stand_ins import StandIn, inertia_box, robot_size
from tests import urdf
from tests.grids import cells
from tests.robots import write
from tests.view.readers import drawn_by, embedded
from tests.view.samples import mesh_visual, numbers, short_run, write_cart

GONE = mesh_visual("gone.stl")
COLLISION = urdf.shape('box size="0.5 0.3 0.1"', "collision", "0.1 0 0.15", "0 0 0.3")
HEAVY = urdf.inertial(4, (0.03, 0.04, 0.05), xyz="0.05 0 0.2")
BADGE = "Mesh missing: 1 link, hatched"


def mast(folder: Path, *inside: str) -> Robot:
    """Load a cart that carries a mast, 0.3 m above its base, which holds what is given."""
    cart = write_cart(folder).read_text(encoding="utf-8").replace("</robot>", "")
    link = urdf.link("mast", *inside)
    joint = urdf.joint("mast_joint", "fixed", ("base", "mast"), "0 0 0.3")
    return rpctl.load(write(folder, f"{cart}{link}{joint}</robot>", "mast.urdf"), root="planar")


def hatched(bodies: Bodies) -> list[np.ndarray[Any, Any]]:
    """Return the vertices (n, 3) of what stands in, in the joints' frames."""
    return [
        bodies.surfaces[part.surface].vertices @ part.pose[:3, :3].T + part.pose[:3, 3]
        for part in bodies.parts
        if part.stands_in
    ]


def edges_of(points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.asarray(np.ptp(points, axis=0))


@pytest.mark.parametrize("seed", range(4))
def test_inertia_box_has_the_inertia_that_it_was_made_of(seed: int) -> None:
    random = np.random.default_rng(seed)
    mass, edges = random.uniform(0.1, 20.0), random.uniform(0.02, 1.5, 3)
    turn = Rotation.random(random_state=random).as_matrix()
    own = np.diag(mass / 12.0 * ((edges**2).sum() - edges**2))
    found, axes = inertia_box(mass, turn @ own @ turn.T)
    assert np.sort(found) == pytest.approx(np.sort(edges))
    again = axes @ np.diag(mass / 12.0 * ((found**2).sum() - found**2)) @ axes.T
    np.testing.assert_allclose(again, turn @ own @ turn.T, atol=1e-12 * mass)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_inertia_box_keeps_the_links_axes_and_bears_impossible_moments() -> None:
    edges, axes = inertia_box(12.0, np.diag([0.25 + 0.09, 0.04 + 0.09, 0.04 + 0.25]))
    assert edges == pytest.approx([0.2, 0.5, 0.3])  # Ixx is b² + c²
    assert (axes == np.eye(3)).all()
    edges, axes = inertia_box(1.0, np.array([[0.1, 1e-9, 0], [1e-9, 0.1, 0], [0, 0, 0.1]]))
    assert (axes == np.eye(3)).all()  # rounding turns no box
    edges, _ = inertia_box(6.0, np.diag([1.0, 0.2, 0.3]))
    assert edges == pytest.approx([0.0, np.sqrt(1.1), np.sqrt(0.9)])


def test_collision_shape_stands_in_where_it_is(tmp_path: Path) -> None:
    bodies = build_bodies(mast(tmp_path, HEAVY, GONE, COLLISION))
    (points,) = hatched(bodies)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    assert middle == pytest.approx([0.1, 0.0, 0.45], abs=1e-6)
    turned = (points - middle) @ Rotation.from_euler("z", 0.3).as_matrix()
    assert edges_of(turned) == pytest.approx([0.5, 0.3, 0.1], abs=1e-6)
    assert bodies.stand_ins == (StandIn("mast", "collision"),)
    assert len(bodies.parts) == 4  # the base and the wheels have their shapes, not hatched
    assert sum(part.stands_in for part in bodies.parts) == 1
    gone, instead = bodies.notes
    assert 'mesh "gone.stl" of link "mast" is not drawn: no such file' in gone
    assert instead.endswith("in place of missing meshes: the collision shape of mast")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("package://nowhere/mast.stl", None, 'package "nowhere" was not found'),
        ("mast.blend", b"BLENDER", "refused: the name of a mesh must end in"),
        ("mast.stl", b"version https://git-lfs.github.com/spec/v1\noid sha256:1\n", "git lfs pull"),
        ("mast.dae", b"<COLLADA", "not readable"),
        ("mast.stl", b"", "not readable|no triangles"),
        ("../../mast.stl", None, "refused: it lies outside"),
    ],
)
def test_every_mesh_that_cannot_be_drawn_has_a_stand_in(
    tmp_path: Path, name: str, content: bytes | None, reason: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    bodies = build_bodies(mast(tmp_path, HEAVY, mesh_visual(name)))
    assert bodies.stand_ins == (StandIn("mast", "inertia"),)
    assert len(hatched(bodies)) == 1
    assert re.search(reason, bodies.notes[0])


def test_hatches_are_equally_wide_on_every_scale(tmp_path: Path) -> None:
    """The robot's size gives the stripes' width, whatever the unit of the mesh."""
    trimesh.creation.box((200.0, 100.0, 50.0)).export(tmp_path / "mm.stl")
    collision = urdf.shape('mesh filename="mm.stl" scale="0.001 -0.001 0.001"', "collision")
    robot = mast(tmp_path, HEAVY, GONE, collision)
    scene = drawn_by(build_scene(robot, short_run(robot, 0.2)).commands)["/rpctl/robots"]["object"]
    nodes = [node for group in scene["object"]["children"] for node in group["children"]]
    (node,) = (node for node in nodes if node["name"].startswith("stand-in-"))
    geometry = next(g for g in scene["geometries"] if g["uuid"] == node["geometry"])
    attributes = geometry["data"]["attributes"]
    points = numbers(attributes["position"]["array"]).reshape(-1, 3)
    along = numbers(attributes["uv"]["array"]).reshape(-1, 2)[:, 0]
    assert edges_of(points) == pytest.approx([0.2, 0.1, 0.05], rel=1e-5)
    stripes = 0.35 / np.sqrt(3.0) / (STRIPE_RATIO * robot_size(robot))
    assert np.ptp(along) == pytest.approx(stripes, rel=1e-5)  # from one corner to the opposite one
    (material,) = (m for m in scene["materials"] if m["uuid"] == node["material"])
    (texture,), (image,) = scene["textures"], scene["images"]
    assert (material["map"], texture["image"]) == (texture["uuid"], image["uuid"])
    pixels = numbers(image["url"]["data"], "uint8").reshape(-1, 4)
    assert len(pixels) == image["url"]["width"] * image["url"]["height"]
    assert {tuple(pixels[0, :3]), tuple(pixels[len(pixels) // 2, :3])} == {
        (240, 241, 244),
        (139, 150, 164),
    }


@pytest.mark.parametrize("missing", cells((True, False), [True], [False]))
def test_pages_report_film_and_notebook_tell_of_it(tmp_path: Path, missing: bool) -> None:
    robot = (
        mast(tmp_path, HEAVY, GONE) if missing else rpctl.load(write_cart(tmp_path), root="planar")
    )
    run = short_run(robot, 0.2)
    scene = build_scene(robot, run)
    report = write_report(run, tmp_path / "report.html", robot=robot).read_text("utf-8")
    both = write_report([run, run], tmp_path / "both.html").read_text("utf-8")
    pages = [report, both, robot_page(robot), player(scene, "mast", "")]
    for page in pages:
        assert (BADGE in page) == missing
        assert ("a box of the inertia of mast" in page) == missing
    assert ("textures" in drawn_by(embedded(report)["commands"])["/rpctl/robots"]["object"]) == (
        missing
    )
