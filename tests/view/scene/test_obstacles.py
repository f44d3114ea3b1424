"""What obstacles a run's settings tell of, and the shapes that a scene has for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rpctl import Disc, HalfPlane, Robot, Run
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle
from rpctl.view.scene.scene import build_scene
from rpctl.view.scene.stage import (
    OBSTACLES_PATH,
    column,
    obstacle_corners,
    wall,
)
from tests.view.samples import DISC, PILLAR, WALL, numbers, unpack, with_obstacles


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
