"""What obstacles a run's settings tell of, and the shapes that a scene has for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Disc, HalfPlane, Robot, Run
from rpctl.control.registry import Unregistered
from rpctl.simulation.config import Config
from rpctl.simulation.merits.obstacles import (
    BASE,
    TIP,
    AvoidedObstacle,
    find_obstacles,
    run_obstacles,
    shape_text,
)
from rpctl.view.scene.obstacles import (
    OBSTACLES_PATH,
    clip,
    column,
    near,
    obstacle_commands,
    obstacle_corners,
    obstacle_texts,
    wall,
)
from rpctl.view.scene.scene import build_scene
from tests.view.samples import DISC, PILLAR, WALL, numbers, unpack, with_obstacles


def test_obstacles_are_found_at_any_depth_and_once() -> None:
    inner = rpctl.Horizon(base_obstacles=(DISC, WALL, DISC), base_radius=0.4)
    found = find_obstacles(Config(rpctl.EndEffector(base=inner)), 0.7)
    assert [(o.body, o.shape, o.radius) for o in found] == [(BASE, DISC, 0.4), (BASE, WALL, 0.4)]
    law = rpctl.Horizon(base_obstacles=(DISC,), end_effector_obstacles=(DISC, PILLAR))
    drawn = [(o.body, o.shape, o.radius) for o in find_obstacles(Config(law), 0.7)]
    assert drawn == [(BASE, DISC, 0.7), (TIP, DISC, 0.05), (TIP, PILLAR, 0.05)]
    assert find_obstacles(Config()) == ()


def test_base_reaches_as_far_as_its_contacts(paper_run: Run) -> None:
    (obstacle,) = run_obstacles(with_obstacles(paper_run, DISC))
    away = np.array(paper_run.ground.points) - paper_run.robot.drive.point
    assert obstacle.radius == pytest.approx(np.linalg.norm(away, axis=1).max())


def test_shape_of_somebodys_own_is_told_and_not_drawn() -> None:
    own = (Unregistered("Blob", {"mass": 1.0}), Unregistered("Disc", {"wobble": 2.0}))
    law = Unregistered("Mine", {"base_obstacles": own})
    assert find_obstacles(Config(law)) == ()
    assert obstacle_texts(law) == {"Base obstacles": "Blob; Disc"}


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        (Disc(1, 0.05, 0.3), "disc at (1, 0.05) m, radius 0.3 m"),
        (Disc(-0.0, -1.5, 0.3), "disc at (0, −1.5) m, radius 0.3 m"),
        (HalfPlane(0, 2, -0.95), "half-plane, free where y ≥ −0.95 m"),
        (HalfPlane(-1, 0, -1.5), "half-plane, free where x ≤ 1.5 m"),
        (HalfPlane(3, -4, 0.5), "half-plane, free where 0.6 x − 0.8 y ≥ 0.5 m"),
    ],
)
def test_shapes_in_words(shape: Disc | HalfPlane, text: str) -> None:
    assert shape_text(shape) == text


@pytest.mark.parametrize("normal", [(0.0, 1.0), (3.0, -4.0), (-1.0, 0.5)])
def test_line_is_clipped_to_the_ground(normal: tuple[float, float]) -> None:
    centre, radius = np.array([2.0, -1.0]), 3.0
    plane = HalfPlane(*normal, 0.7)
    ends = clip(plane, centre, radius)
    assert ends is not None
    assert plane.distance(ends) == pytest.approx([0.0, 0.0])
    assert np.linalg.norm(ends - centre, axis=1) == pytest.approx([radius, radius])
    past = HalfPlane(*normal, float(plane.normal @ centre) + 1.01 * radius)
    assert clip(past, centre, radius) is None
    assert wall(past, centre, radius, 0.5, 0.01, dashed=False) == []


def test_wall_stands_on_its_line_and_fades_out() -> None:
    plane, centre = HalfPlane(3.0, -4.0, 0.7), np.array([2.0, -1.0])
    (floor, tint), (_, line), (sides, opacity) = wall(plane, centre, 3.0, 0.5, 0.01, dashed=False)
    vertices = sides[0]
    assert plane.distance(vertices[:, :2]) == pytest.approx(np.zeros(len(vertices)))
    assert set(vertices[:, 2]) == {0.0, 0.5}
    assert plane.distance(floor[0][:, :2]).max() == pytest.approx(0.0)  # it is beyond, not before
    assert plane.distance(floor[0][:, :2]).min() < -0.3
    for alpha in (tint, line, opacity):
        assert alpha[[0, 1, -2, -1]] == pytest.approx(0.0, abs=0.02)
        assert alpha.max() > 0.1
    assert opacity[0::2].max() > 3.0 * opacity[1::2].max()  # its top is fainter than its foot


def test_column_stands_on_its_disc() -> None:
    (floor, _), (edge, _), (sides, _) = column(DISC, 1.2, 0.02, dashed=False)
    away = np.hypot(*(sides[0][:, :2] - (DISC.x, DISC.y)).T)
    assert away == pytest.approx(np.full(len(away), DISC.radius))
    assert set(sides[0][:, 2]) == {0.0, 1.2}
    band = np.hypot(*(edge[0][:, :2] - (DISC.x, DISC.y)).T)
    assert (np.abs(band - DISC.radius) < 0.011).all()
    a, b, c = (floor[0][floor[1][:, i], :2] for i in range(3))
    ab, ac = b - a, c - a
    area = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]).sum()
    assert area == pytest.approx(np.pi * DISC.radius**2, rel=2e-3)


def test_edges_of_the_end_effectors_are_dashed() -> None:
    (_, (solid, _), _) = column(PILLAR, 1.0, 0.02, dashed=False)
    (_, (dashed, _), _) = column(PILLAR, 1.0, 0.02, dashed=True)

    def area(mesh: Any) -> float:
        a, b, c = (mesh[0][mesh[1][:, i]] for i in range(3))
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    assert 0.4 * area(solid) < area(dashed) < 0.8 * area(solid)


def test_only_what_is_near_is_framed() -> None:
    points = np.array([[1.0, 1.0], [5.9, 0.0], [6.1, 0.0], [0.0, -2.6]])
    shown = near(points, np.zeros(3), np.array([4.0, 0.1, 1.0]) - [0.0, 0.1, 0.0])
    assert shown.tolist() == [[1.0, 1.0], [5.9, 0.0]]
    assert near(points, np.zeros(2), np.full(2, 0.6)).tolist() == [[1.0, 1.0]]


def test_cameras_frame_discs_but_no_half_plane(paper: Robot, paper_run: Run) -> None:
    plain = build_scene(paper, paper_run)
    disc = Disc(float(plain.hull[:, 0].max()) + 0.5, 0.0, 0.3)
    ground, height = paper.drive.ground, float(plain.start[1, 2]) - paper.drive.ground
    framed = build_scene(paper, with_obstacles(paper_run, disc, WALL, Disc(80.0, 0.0, 1.0)))
    assert framed.hull[:, 0].max() == pytest.approx(disc.x + 0.3, abs=0.05)
    walled = build_scene(paper, with_obstacles(paper_run, WALL))
    np.testing.assert_array_equal(walled.hull, plain.hull)
    tops = [
        obstacle_corners([AvoidedObstacle(b, DISC, 0.0)], plain.hull, ground, height)[:, 2]
        for b in (BASE, TIP)
    ]
    assert ground < tops[0].max() < ground + height < tops[1].max()


def test_scene_has_one_mesh_for_each_body(paper: Robot, paper_run: Run) -> None:
    def meshes(run: Run) -> list[dict[str, Any]]:
        commands = map(unpack, build_scene(paper, run).commands)
        return [c["object"] for c in commands if c["path"] == OBSTACLES_PATH]

    assert meshes(paper_run) == []
    (scene,) = meshes(with_obstacles(paper_run, DISC, WALL, tip=(PILLAR,)))
    names = [node["name"] for node in scene["object"]["children"]]
    assert names == ["obstacles-base", "obstacles-tip"]
    assert all(material["transparent"] for material in scene["materials"])
    assert not any(material["depthWrite"] for material in scene["materials"])
    places = scene["geometries"][1]["data"]["attributes"]["position"]["array"]
    points = numbers(places).reshape(-1, 3)
    assert np.hypot(*(points[:, :2] - (PILLAR.x, PILLAR.y)).T).max() < PILLAR.radius + 0.02
    assert points[:, 2].min() == pytest.approx(paper.drive.ground, abs=0.01)


def test_wall_that_the_ground_does_not_reach_is_not_drawn() -> None:
    far = AvoidedObstacle(BASE, HalfPlane(0.0, 1.0, -90.0), 0.0)
    lower, upper = -np.ones(3), np.ones(3)
    assert obstacle_commands([far], lower, upper, 0.0, 1.0) == []
