from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial.transform import Rotation, Slerp

import rpctl
from rpctl import Robot, Run
from rpctl.arrays import Array
from rpctl.view.scene import scene as scenes
from rpctl.view.scene.robot_meshes import build_bodies
from rpctl.view.scene.scene import Scene, build_scene
from rpctl.view.scene.stage import lights_command
from tests.view.samples import mesh_visual, numbers, short_run, unpack, write_cart

FRAME = 1e-5  # m and entries of a pose: single precision


def placed(scene: Scene, prefix: str, frame: int) -> dict[str, np.ndarray[Any, Any]]:
    """Return the pose (4, 4) of each animated node at a frame, as the viewer fills it in."""
    (animation,) = unpack(scene.commands[-1])["animations"]
    poses: dict[str, np.ndarray[Any, Any]] = {}
    for track in animation["clip"]["tracks"]:
        node, _, kind = track["name"].partition(".")
        if not node.startswith(prefix):
            continue
        pose = poses.setdefault(node, np.eye(4))
        times = numbers(track["times"])
        time = float(np.clip(scene.times[frame], times[0], times[-1]))
        values = numbers(track["values"]).reshape(len(times), -1)
        if kind == "position":
            pose[:3, 3] = [np.interp(time, times, column) for column in values.T]
        elif len(times) == 1:
            pose[:3, :3] = Rotation.from_quat(values[0]).as_matrix()
        else:
            pose[:3, :3] = Slerp(times, Rotation.from_quat(values))(time).as_matrix()
    return poses


def robots(scene: Scene) -> dict[str, Any]:
    return next(
        command["object"]
        for command in map(unpack, scene.commands)
        if command["type"] == "set_object" and command["path"] == scenes.ROBOTS_PATH
    )


def matrix(node: dict[str, Any]) -> np.ndarray[Any, Any]:
    return np.array(node["matrix"]).reshape(4, 4).T


@pytest.mark.parametrize("name", ["paper", pytest.param("tiago", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("prefix", "kind"), [("robot-", "q"), ("reference-", "q_ref")])
def test_shapes_stand_where_pinocchio_places_their_links(
    name: str, prefix: str, kind: str, request: pytest.FixtureRequest
) -> None:
    robot: Robot = request.getfixturevalue(name)
    run: Run = request.getfixturevalue(f"{name}_run")
    scene = build_scene(robot, run)
    groups = {group["name"]: group for group in robots(scene)["object"]["children"]}
    data = robot.model.createData()
    for frame in (0, len(scene.times) // 2, len(scene.times) - 1):
        sample = int(np.argmin(np.abs(run.t - scene.times[frame])))
        pin.framesForwardKinematics(robot.model, data, getattr(run, kind)[sample])
        poses = placed(scene, prefix, frame)
        drawn = [
            poses[group] @ matrix(node)
            for group in poses
            for node in groups[group]["children"]
            if not node["name"].startswith("veil-")
        ]
        expected = [
            data.oMf[robot.model.getFrameId(link.name, pin.FrameType.BODY)].homogeneous
            @ shape.origin
            @ np.diag([*(shape.size if shape.mesh else (1.0, 1.0, 1.0)), 1.0])
            for link in robot.description.links
            for shape in link.visuals
        ]
        assert len(drawn) == len(expected)
        remaining = np.array(drawn)
        for pose in expected:
            gaps = np.abs(remaining - pose).max(axis=(1, 2))
            assert gaps.min() < FRAME
            remaining = np.delete(remaining, gaps.argmin(), axis=0)


def test_same_run_gives_the_same_bytes(paper: Robot, paper_run: Run) -> None:
    assert build_scene(paper, paper_run).commands == build_scene(paper, paper_run).commands


@pytest.mark.slow
def test_meshes_are_sent_once_and_shared_with_the_ghost(tiago: Robot, tiago_run: Run) -> None:
    scene = robots(build_scene(tiago, tiago_run))
    shown: dict[str, set[str]] = {"part": set(), "tint": set(), "veil": set()}
    count = 0
    for group in scene["object"]["children"]:
        for node in group["children"]:
            shown[node["name"].partition("-")[0]].add(node["geometry"])
            count += node["name"].startswith("part-")
    assert shown["part"] == shown["tint"] == shown["veil"]
    assert len(scene["geometries"]) == len(shown["part"]) < count / 2


def test_two_files_of_one_mesh_are_sent_once(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.5, 0.3, 0.1))
    for name in ("a.stl", "b.stl"):
        box.export(tmp_path / name)
    path = write_cart(tmp_path, mesh_visual("a.stl") + mesh_visual("b.stl", "1 -1 1"))
    bodies = build_bodies(rpctl.load(path))
    assert len(bodies.parts) == 4
    assert len(bodies.surfaces) == 2


def test_mirror_is_on_the_child_and_the_animated_node_only_moves(tmp_path: Path) -> None:
    trimesh.creation.box((0.5, 0.3, 0.1)).export(tmp_path / "body.stl")
    robot = rpctl.load(write_cart(tmp_path, mesh_visual("body.stl", "1 -1 2")))
    scene = build_scene(robot, short_run(robot, 0.5))
    groups = {group["name"]: group for group in robots(scene)["object"]["children"]}
    (child,) = groups["robot-1"]["children"]
    assert not {"matrix", "scale"} & groups["robot-1"].keys()
    assert np.linalg.det(matrix(child)[:3, :3]) == pytest.approx(-2.0)
    assert child["matrixAutoUpdate"] is False
    (animation,) = unpack(scene.commands[-1])["animations"]
    kinds = {track["name"].partition(".")[2] for track in animation["clip"]["tracks"]}
    assert kinds == {"position", "quaternion"}


@pytest.mark.parametrize("name", ["paper", pytest.param("tiago", marks=pytest.mark.slow)])
def test_wheels_touch_the_drawn_ground(name: str, request: pytest.FixtureRequest) -> None:
    robot: Robot = request.getfixturevalue(name)
    run: Run = request.getfixturevalue(f"{name}_run")
    scene = build_scene(robot, run)
    ground = next(
        unpack(c)["object"] for c in scene.commands if unpack(c).get("path") == "/rpctl/ground"
    )
    points = numbers(ground["geometries"][0]["data"]["attributes"]["position"]["array"])
    heights = np.unique(points.reshape(-1, 3)[:, 2])
    bodies, poses = build_bodies(robot), placed(scene, "robot-", 0)
    for wheel in robot.drive.wheels:
        joint = robot.model.getJointId(wheel.joint)
        lowest = min(
            (part.pose[:3, :3] @ bodies.surfaces[part.surface].vertices.T + part.pose[:3, 3:])
            .T.dot(poses[f"robot-{joint}"][2, :3])
            .min()
            + poses[f"robot-{joint}"][2, 3]
            for part in bodies.parts
            if part.joint == joint
        )
        assert heights == pytest.approx([lowest], abs=0.02 * wheel.radius)


@pytest.mark.parametrize("away", [-100.0, 0.0, 100.0])
def test_sun_shines_down_on_a_motion_anywhere(away: float) -> None:
    lower = np.array([away - 2.0, away - 1.0, 0.0])
    upper = lower + np.array([4.0, 2.0, 1.2])
    root = unpack(lights_command(lower, upper))["object"]["object"]
    sun = next(node for node in root["children"] if node["name"] == "sun")
    position, view = matrix(sun)[:3, 3], sun["shadow"]["camera"]
    assert position[2] > 0.0
    back = position / np.linalg.norm(position)
    for point in (lower, upper):
        assert view["near"] < (position - point) @ back < view["far"]


def test_note_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    robot = rpctl.load(write_cart(tmp_path, mesh_visual(str(tmp_path.parent / "secret.stl"))))
    note, _ = build_bodies(robot).notes
    assert "secret.stl" in note
    assert str(tmp_path.parent) not in note


@pytest.mark.parametrize("duration", [30.0, 90.0, 300.0, 3600.0])
def test_trails_are_finer_than_frames_that_lie_far_apart(duration: float) -> None:
    t: Array = np.linspace(0.0, duration, round(duration / 0.01) + 1)
    frames = scenes._frames(t)
    for most in (scenes.MAX_BASE_POINTS, scenes.MAX_TIP_POINTS):
        samples = scenes._trail_samples(t, frames, most)
        each, rest = divmod(len(samples) - 1, len(frames) - 1)
        assert rest == 0, "the viewer shows as much of a trail from each frame to the next"
        np.testing.assert_array_equal(samples[::each], frames)
        assert len(samples) <= max(most, len(frames))
        gap = np.diff(t[samples]).max()
        assert each == 1 or gap > 0.5 * scenes.TRAIL_STEP_S
        assert gap < scenes.TRAIL_STEP_S + 0.02 or len(samples) > 0.7 * most
    desired = scenes._desired_samples(t, frames)
    assert t[desired[0]] == 0.0
    assert t[desired[-1]] == pytest.approx(min(duration, scenes.DESIRED_S), abs=0.011)
    assert len(desired) <= scenes.MAX_FRAMES
