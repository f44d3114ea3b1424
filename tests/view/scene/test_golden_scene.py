"""What is drawn of a run that is known on paper: who stands where, and which trail is whose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from rpctl import Robot, Run
from rpctl.view.pages.compare import merge
from rpctl.view.pages.report import write_report
from rpctl.view.pages.scene_page import player
from rpctl.view.scene.obstacle_shapes import OBSTACLES_PATH
from rpctl.view.scene.scene import Scene, build_scene
from rpctl.view.scene.trails import BASE_COLOUR, DESIRED_COLOUR, TIP_COLOUR
from tests.golden import COUNT, TIMES
from tests.runs import vary
from tests.view.readers import Array, drawn_by, embedded, middles, path_distances, tracks, trails
from tests.view.samples import DISC, numbers, with_obstacles

K = np.arange(COUNT)
NEAR = 1e-3  # m: trails lie that near to their paths, and thinned frames to theirs


@pytest.fixture(scope="module")
def scene(tricycle: Robot, golden: Run) -> Scene:
    return build_scene(tricycle, golden)


@pytest.fixture(scope="module")
def other(golden: Run) -> Run:
    """Another run of the robot: all of its motion and reference is somewhere else."""
    aside = np.array([0.0, 3.0, 0.0])
    moved = np.zeros(golden.q.shape[1])
    moved[1] = 3.0
    return vary(
        golden,
        q=golden.q_ref + moved,
        q_ref=golden.q + 2.0 * moved,
        base=golden.base_ref + aside,
        base_ref=golden.log.base + 2.0 * aside,
        ee=golden.log.ee_ref + aside,
        ee_ref=golden.log.ee + 2.0 * aside,
    )


def check_trails(commands: Sequence[bytes], run: Run, prefix: str = "") -> None:
    """Check that the actual trails are the motion's, and the desired ones the reference's."""
    found = {n.removeprefix(prefix): v for n, v in trails(commands).items() if n.startswith(prefix)}
    base = middles(found["trail-base"], COUNT)
    assert base[:, :2] == pytest.approx(run.log.base[:, :2], abs=NEAR)
    assert middles(found["trail-tip"], COUNT) == pytest.approx(run.log.ee, abs=NEAR)
    width = float(np.linalg.norm(found["trail-base"][0] - found["trail-base"][1]))
    flat = np.column_stack([run.base_ref[:, :2], np.full(COUNT, -0.05)])  # on the ground
    assert path_distances(found["trail-base-desired"], flat).max() < width
    assert base[:, 2] == pytest.approx(-0.05, abs=width)
    assert path_distances(found["trail-tip-desired"], run.log.ee_ref).max() < width
    for name, path in (("base", flat), ("tip", run.log.ee_ref)):
        dashes = found[f"trail-{name}-desired"]
        assert np.linalg.norm(dashes[:2].mean(axis=0) - path[0]) < width  # from its start
        assert np.linalg.norm(dashes - path[-1], axis=1).min() < 15.0 * width  # to its end


def check_motion(commands: Sequence[bytes], robot: Robot, q: Array, prefix: str) -> None:
    """Check that all joints below a prefix move as a motion (K, nq) has it."""
    found, data = tracks(commands), robot.model.createData()
    for k, row in enumerate(q):
        pin.forwardKinematics(robot.model, data, row)
        for joint in range(1, robot.model.njoints):
            times, places = found[f"{prefix}-{joint}.position"]
            at = [np.interp(TIMES[k], times, column) for column in places.T]
            assert at == pytest.approx(data.oMi[joint].translation, abs=NEAR)
            times, turns = found[f"{prefix}-{joint}.quaternion"]
            kept = np.flatnonzero(np.abs(times - TIMES[k]) < 1e-6)
            if len(kept):
                turn = Rotation.from_quat(turns[kept[0]]).as_matrix()
                assert turn == pytest.approx(data.oMi[joint].rotation, abs=1e-6)


def test_trails_and_motions_are_the_robots_and_its_references(
    tricycle: Robot, golden: Run, scene: Scene
) -> None:
    check_trails(scene.commands, golden)
    check_motion(scene.commands, tricycle, golden.q, "robot")
    check_motion(scene.commands, tricycle, golden.q_ref, "reference")
    drawn = drawn_by(scene.commands)["/rpctl/trails"]["object"]
    colours = {material["uuid"]: material["color"] for material in drawn["materials"]}
    assert {node["name"]: colours[node["material"]] for node in drawn["object"]["children"]} == {
        "trail-base-desired": DESIRED_COLOUR,
        "trail-base": BASE_COLOUR,
        "trail-tip-desired": DESIRED_COLOUR,
        "trail-tip": TIP_COLOUR,
    }


def turned(commands: Sequence[bytes], child: str, parent: str) -> list[float]:
    """Return by how much one node is turned about z against another, at both ends, rad."""
    found, angles = tracks(commands), []
    for k in (0, -1):
        inner, outer = (
            Rotation.from_quat(found[f"{node}.quaternion"][1][k]) for node in (child, parent)
        )
        angles.append(float((outer.inv() * inner).as_rotvec()[2]))
    return angles


def test_ghost_steers_and_reaches_as_its_reference(tricycle: Robot, scene: Scene) -> None:
    steer, swing, slide = (
        tricycle.model.getJointId(f"{name}_joint") for name in ("steer", "swing", "slide")
    )
    ghost = [f"reference-{joint}" for joint in (1, steer, swing, slide)]
    robot = [f"robot-{joint}" for joint in (1, steer, swing, slide)]
    assert turned(scene.commands, ghost[1], ghost[0]) == pytest.approx([-0.1, -0.35])
    assert turned(scene.commands, robot[1], robot[0]) == pytest.approx([0.0, 0.5])
    assert turned(scene.commands, ghost[2], ghost[0]) == pytest.approx([0.6, -0.9])
    assert turned(scene.commands, robot[2], robot[0]) == pytest.approx([0.0, 1.0])
    places = {name: values for name, (_, values) in tracks(scene.commands).items()}
    for (_, _, first, second), lengths in ((ghost, (0.35, 0.05)), (robot, (0.0, 0.25))):
        reach = [
            np.linalg.norm(places[f"{second}.position"][k] - places[f"{first}.position"][k])
            for k in (0, -1)
        ]
        assert reach == pytest.approx([0.4 + length for length in lengths])


def test_ghost_is_veiled_and_the_robot_is_not(scene: Scene) -> None:
    drawn = drawn_by(scene.commands)["/rpctl/robots"]["object"]
    paints = {m["uuid"]: m for m in drawn["materials"]}
    for group in drawn["object"]["children"]:
        solid = group["name"].startswith("robot-")
        for mesh in group["children"]:
            paint = paints[mesh["material"]]
            assert mesh["material"].startswith("paint-") == solid
            assert paint.get("opacity", 0.0) == (
                1.0 if solid else {"tint": 0.3}.get(paint["uuid"], 0.0)
            )
            assert mesh.get("castShadow", False) == solid


def test_everything_is_in_view(tricycle: Robot, golden: Run, scene: Scene) -> None:
    """Robot, ghost and all four paths, and the ground below."""
    everything = np.concatenate(
        [
            golden.log.base[:, :2],
            golden.base_ref[:, :2],
            golden.log.ee[:, :2],
            golden.log.ee_ref[:, :2],
        ]
    )
    assert (scene.lower[:2] <= everything.min(axis=0) + 1e-9).all()
    assert (scene.upper[:2] >= everything.max(axis=0) - 1e-9).all()
    assert (
        -0.1 * (np.sqrt(2.0) - 1.0) <= scene.lower[2] + 0.05 < -0.035
    )  # a wheel's box as it turns
    assert scene.upper[2] == pytest.approx(0.45 + 0.6)  # the first end-effector reference
    assert scene.follow == "robot-1"
    assert scene.origin == pytest.approx([0.0, 0.0, 0.0])
    data = tricycle.model.createData()
    pin.forwardKinematics(tricycle.model, data, golden.q[0])
    low, high = scene.start  # the base reaches from -0.25, the front wheel to 0.8 m
    assert low == pytest.approx([-0.25, -0.32, -0.05], abs=1e-3)
    assert high == pytest.approx([0.8, 0.32, 0.5], abs=1e-3)


def test_a_motion_in_the_air_has_its_ground_in_view(tricycle: Robot, golden: Run) -> None:
    """However the shapes lie: here the robot has none, and its paths are above the ground."""
    drive = replace(tricycle.drive, ground=-0.5)
    scene = build_scene(
        replace(tricycle, drive=drive), vary(golden, drive=replace(golden.robot.drive, ground=-0.5))
    )
    assert scene.lower[2] == pytest.approx(-0.5)
    trail = middles(trails(scene.commands)["trail-base"], COUNT)
    assert trail[:, 2] == pytest.approx(-0.5, abs=0.05)
    assert trail[:, 2].min() > -0.5


def test_clips_start_at_zero_and_long_ones_are_thinned(tricycle: Robot, golden: Run) -> None:
    late = vary(golden, t=golden.t + 7.0)
    scene = build_scene(tricycle, late)
    assert scene.times == pytest.approx(TIMES)
    assert scene.duration == pytest.approx(0.5)
    check_motion(scene.commands, tricycle, golden.q, "robot")
    for duration, count, frames_kept in ((2.01, 400, 62), (100.0, 2500, 1800), (0.1, 2, 2)):
        places = np.linspace(0, COUNT - 1, count).astype(int)
        arrays: dict[str, Any] = {
            n: a[places] for n, a in vars(golden.log).items() if isinstance(a, np.ndarray)
        }
        run = vary(golden, **{**arrays, "t": np.linspace(7.0, 7.0 + duration, count)})
        drawn = build_scene(tricycle, run)
        times = drawn.times
        assert len(times) == frames_kept  # 30 a second, 1800 at most, the ends among them
        said = [note for note in drawn.notes if "has 18 frames a second" in note]
        assert len(said) == (frames_kept == 1800)
        assert (times[0], times[-1]) == pytest.approx((0.0, duration))


def test_reports_and_films_carry_the_same_scene(
    tricycle: Robot, golden: Run, scene: Scene, tmp_path: Any
) -> None:
    page = write_report(golden, tmp_path / "report.html", robot=tricycle).read_text("utf-8")
    data = embedded(page)
    assert tuple(data["commands"]) == scene.commands
    assert data["duration"] == pytest.approx(0.5)
    assert data["runs"] == [{"prefix": "", "duration": 0.5, "frames": COUNT}]
    film = embedded(player(scene, "golden", 1.5, ""))
    assert tuple(film["commands"]) == scene.commands
    assert (film["duration"], film["frames"]) == (pytest.approx(0.5), COUNT)


def test_of_several_runs_each_keeps_its_motion_and_trails(
    tricycle: Robot, golden: Run, other: Run, scene: Scene
) -> None:
    second = build_scene(tricycle, other)
    merged = merge([golden, other], [scene, second])
    first = [name for name in trails(merged.commands) if not name.startswith("run2-")]
    assert first == ["trail-base-desired", "trail-base", "trail-tip-desired", "trail-tip"]
    check_trails(merged.commands, golden)
    check_trails(merged.commands, other, "run2-")
    check_motion(merged.commands, tricycle, golden.q, "robot")
    check_motion(merged.commands, tricycle, golden.q_ref, "reference")
    check_motion(merged.commands, tricycle, other.q, "run2-robot")
    for side, pick in ((merged.lower, np.minimum), (merged.upper, np.maximum)):
        own = [getattr(s, "lower" if side is merged.lower else "upper") for s in (scene, second)]
        assert side == pytest.approx(pick(*own))
    drawn = drawn_by(merged.commands)["/rpctl/robots"]["object"]
    ghosts = [g for g in drawn["object"]["children"] if g["name"].startswith("run2-")]
    assert {mesh["material"] for group in ghosts for mesh in group["children"]} == {
        "veil",
        "tint-2",
    }
    (tint,) = (each for each in drawn["materials"] if each["uuid"] == "tint-2")
    assert (tint["opacity"], tint["depthWrite"]) == (0.55, False)
    # Where both follow one reference, it is drawn once, and the first run's is.
    same = vary(other, base_ref=golden.base_ref, ee_ref=golden.log.ee_ref)
    merged = merge([golden, same], [scene, build_scene(tricycle, same)])
    names = [name for name in trails(merged.commands) if name.startswith("run2-")]
    assert names == ["run2-trail-base", "run2-trail-tip"]


def heights(commands: Sequence[bytes], path: str, number: int) -> tuple[float, float]:
    """Return the least and the largest height of a geometry, m."""
    geometry = drawn_by(commands)[path]["object"]["geometries"][number]
    points = numbers(geometry["data"]["attributes"]["position"]["array"]).reshape(-1, 3)
    return float(points[:, 2].min()), float(points[:, 2].max())


def test_the_ground_of_several_runs_is_the_first_ones(
    tricycle: Robot, golden: Run, other: Run, scene: Scene
) -> None:
    sunk = vary(other, drive=replace(other.robot.drive, ground=-0.3))
    merged = merge([golden, sunk], [scene, build_scene(tricycle, sunk)])
    assert heights(merged.commands, "/rpctl/ground", 0) == pytest.approx((-0.05, -0.05))


def test_columns_stand_on_the_ground_and_are_half_as_high_as_the_robot(
    tricycle: Robot, golden: Run
) -> None:
    """The robot is 0.55 m high, from the ground at -0.05 m to the box at its arm's end."""
    scene = build_scene(tricycle, with_obstacles(golden, DISC))
    foot, top = heights(scene.commands, OBSTACLES_PATH, 0)
    assert foot == pytest.approx(-0.05, abs=0.01)
    assert top == pytest.approx(-0.05 + 0.5 * 0.55, abs=0.01)
    merged = merge([with_obstacles(golden, DISC)] * 2, [scene, scene])
    assert heights(merged.commands, OBSTACLES_PATH, 0) == pytest.approx((foot, top), abs=0.01)
