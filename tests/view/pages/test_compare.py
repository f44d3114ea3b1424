from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rpctl import Robot, Run
from rpctl.view.pages.compare import TRAILS_PATH, covered_trails, merge
from rpctl.view.scene.obstacle_shapes import OBSTACLES_PATH
from rpctl.view.scene.scene import ROBOTS_PATH, Scene, build_scene
from tests.runs import vary
from tests.view.samples import DISC, WALL, short_run, unpack, with_obstacles


@pytest.fixture(scope="module")
def runs(paper: Robot, paper_run: Run) -> list[Run]:
    return [paper_run, short_run(paper, 1.0)]


@pytest.fixture(scope="module")
def scenes(paper: Robot, runs: list[Run]) -> list[Scene]:
    return [build_scene(paper, run) for run in runs]


def command(scene: Scene, path: str) -> dict[str, Any]:
    found = [unpack(packed) for packed in scene.commands]
    return next(c for c in found if path in (c["path"], c["type"]))


def names(scene: Scene, path: str) -> list[str]:
    return [node["name"] for node in command(scene, path)["object"]["object"]["children"]]


def test_other_runs_are_ghosts_of_the_same_meshes(runs: list[Run], scenes: list[Scene]) -> None:
    merged = merge(runs, scenes)
    before, after = (command(s, ROBOTS_PATH)["object"] for s in (scenes[0], merged))
    assert len(after["geometries"]) == len(before["geometries"])
    added = set(names(merged, ROBOTS_PATH)) - set(names(scenes[0], ROBOTS_PATH))
    assert added == {f"run2-{n}" for n in names(scenes[0], ROBOTS_PATH) if n.startswith("robot-")}
    known = {material["uuid"] for material in after["materials"]}
    geometries = {geometry["uuid"] for geometry in after["geometries"]}
    for group in after["object"]["children"]:
        assert all(mesh["material"] in known for mesh in group["children"])
        assert all(mesh["geometry"] in geometries for mesh in group["children"])


def test_other_robot_brings_its_meshes(
    runs: list[Run], scenes: list[Scene], ur5: Robot, ur5_run: Run
) -> None:
    other = build_scene(ur5, ur5_run)
    merged = command(merge([runs[0], ur5_run], [scenes[0], other]), ROBOTS_PATH)["object"]
    count = len(command(scenes[0], ROBOTS_PATH)["object"]["geometries"])
    assert len(merged["geometries"]) == count + len(
        command(other, ROBOTS_PATH)["object"]["geometries"]
    )


def test_all_runs_move_in_one_clip(runs: list[Run], scenes: list[Scene]) -> None:
    merged = merge(runs, scenes)
    (animation,) = command(merged, "set_animation")["animations"]
    tracks = {track["name"]: track for track in animation["clip"]["tracks"]}
    (own,) = command(scenes[1], "set_animation")["animations"]
    moved = {track["name"]: track for track in own["clip"]["tracks"]}
    assert tracks["run2-robot-1.position"]["values"] == moved["robot-1.position"]["values"]
    assert "run2-reference-1.position" not in tracks
    assert merged.duration == pytest.approx(3.0)


def test_the_same_desired_trail_is_drawn_once(runs: list[Run], scenes: list[Scene]) -> None:
    desired = {"trail-base-desired", "trail-tip-desired"}
    assert covered_trails(*runs) == desired
    assert covered_trails(runs[1], runs[0]) == set()  # the first ends before the other
    shifted = vary(runs[1], base_ref=runs[1].base_ref + np.array([0.1, 0.0, 0.0]))
    assert covered_trails(runs[0], shifted) == {"trail-tip-desired"}
    drawn = names(merge(runs, scenes), TRAILS_PATH)
    assert {n for n in drawn if "run2" in n} == {"run2-trail-base", "run2-trail-tip"}


@pytest.mark.slow
def test_obstacles_that_runs_share_are_drawn_once(paper: Robot, runs: list[Run]) -> None:
    def obstacles(*shown: Run) -> bytes:
        scene = merge(shown, [build_scene(paper, run) for run in shown])
        (drawn,) = (packed for packed in scene.commands if unpack(packed)["path"] == OBSTACLES_PATH)
        return drawn

    both = with_obstacles(runs[0], DISC, WALL)
    one, other = with_obstacles(runs[0], DISC), with_obstacles(runs[0], WALL, DISC)
    assert obstacles(both, both) == obstacles(both, one) == obstacles(one, both)
    assert obstacles(runs[0], both) == obstacles(both)
    assert obstacles(other, one) != obstacles(one)


def test_runs_without_obstacles_have_none(runs: list[Run], scenes: list[Scene]) -> None:
    assert OBSTACLES_PATH not in [unpack(packed)["path"] for packed in merge(runs, scenes).commands]
