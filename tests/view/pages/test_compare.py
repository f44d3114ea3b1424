from __future__ import annotations

from typing import Any

import pytest

from rpctl import Robot, Run
from rpctl.view.scene.scene import ROBOTS_PATH, Scene, build_scene, compare_scene
from tests.view.samples import short_run, unpack


@pytest.fixture(scope="module")
def runs(paper: Robot, paper_run: Run) -> list[Run]:
    return [paper_run, short_run(paper, 1.0)]


@pytest.fixture(scope="module")
def scenes(paper: Robot, runs: list[Run]) -> list[Scene]:
    return [build_scene(paper, run) for run in runs]


@pytest.fixture(scope="module")
def merged(paper: Robot, runs: list[Run]) -> Scene:
    return compare_scene([paper, paper], runs)


def command(scene: Scene, path: str) -> dict[str, Any]:
    found = [unpack(packed) for packed in scene.commands]
    return next(c for c in found if path in (c["path"], c["type"]))


def names(scene: Scene, path: str) -> list[str]:
    return [node["name"] for node in command(scene, path)["object"]["object"]["children"]]


def test_other_runs_are_ghosts_of_the_same_meshes(scenes: list[Scene], merged: Scene) -> None:
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
    paper: Robot, paper_run: Run, scenes: list[Scene], cart: Robot, cart_run: Run
) -> None:
    both = command(compare_scene([paper, cart], [paper_run, cart_run]), ROBOTS_PATH)["object"]
    counts = [
        len(command(scene, ROBOTS_PATH)["object"]["geometries"])
        for scene in (scenes[0], build_scene(cart, cart_run))
    ]
    assert len(both["geometries"]) == sum(counts)


def test_all_runs_move_in_one_clip(scenes: list[Scene], merged: Scene) -> None:
    (animation,) = command(merged, "set_animation")["animations"]
    tracks = {track["name"]: track for track in animation["clip"]["tracks"]}
    (own,) = command(scenes[1], "set_animation")["animations"]
    moved = {track["name"]: track for track in own["clip"]["tracks"]}
    assert tracks["run2-robot-1.position"]["values"] == moved["robot-1.position"]["values"]
    assert "run2-reference-1.position" not in tracks
    assert merged.duration == pytest.approx(3.0)
