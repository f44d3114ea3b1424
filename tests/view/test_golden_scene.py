"""What is drawn of a run that is known on paper: who stands where, and which trail is whose."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import rpctl
from rpctl import Robot, Run
from rpctl.reference.motion import ReferenceState
from rpctl.view.compare import merge
from rpctl.view.live import Broadcast, broadcast
from rpctl.view.obstacle_shapes import PATH
from rpctl.view.player import player
from rpctl.view.report import write_report
from rpctl.view.robot_page import Show, robot_page
from rpctl.view.scene import Scene, build_scene
from rpctl.view.stage import BASE_COLOUR, DESIRED_COLOUR, TIP_COLOUR
from rpctl.view.stream import Stream
from tests.golden import COUNT, TIMES
from tests.view.samples import DISC, among, numbers, unpack
from tests.view.test_live import Unopened, frames
from tests.view.test_server import ask

Array = np.ndarray[Any, Any]
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
    return replace(
        golden,
        q=golden.q_ref + moved,
        q_ref=golden.q + 2.0 * moved,
        base=golden.base_ref + aside,
        base_ref=golden.base + 2.0 * aside,
        ee=golden.ee_ref + aside,
        ee_ref=golden.ee + 2.0 * aside,
    )


def drawn_by(commands: Sequence[bytes]) -> dict[str, dict[str, Any]]:
    """Return the commands by the path that they are about, or by their type."""
    return {c["path"] or c["type"]: c for c in map(unpack, commands)}


def embedded(page: str) -> dict[str, Any]:
    """Return the data that a page carries, with its commands as bytes."""
    found = re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found.group(1))
    data["commands"] = [base64.b64decode(each) for each in data["commands"]]
    return data


def trails(commands: Sequence[bytes]) -> dict[str, Array]:
    """Return the vertices (n, 3) of the trails by their nodes' names."""
    scene = drawn_by(commands)["/rpctl/trails"]["object"]
    geometries = {g["uuid"]: g["data"]["attributes"]["position"] for g in scene["geometries"]}
    return {
        node["name"]: numbers(geometries[node["geometry"]]["array"]).reshape(-1, 3)
        for node in scene["object"]["children"]
    }


def middles(vertices: Array, count: int) -> Array:
    """Return the path (count, 3) in the middle of a band or tube."""
    return np.asarray(vertices.reshape(count, -1, 3).mean(axis=1))


def away(points: Array, path: Array) -> Array:
    """Return the distances (n,) of points from a path of straight pieces."""
    start, step = path[:-1], np.diff(path, axis=0)
    share = np.einsum("nij,ij->ni", points[:, None] - start, step) / (step**2).sum(axis=1)
    foot = start + np.clip(share, 0.0, 1.0)[..., None] * step
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


def tracks(commands: Sequence[bytes]) -> dict[str, tuple[Array, Array]]:
    """Return times (n,) and values (n, size) of every animated property."""
    (animation,) = drawn_by(commands)["set_animation"]["animations"]
    found = {}
    for track in animation["clip"]["tracks"]:
        times = numbers(track["times"])
        found[track["name"]] = times, numbers(track["values"]).reshape(len(times), -1)
    return found


def check_trails(commands: Sequence[bytes], run: Run, prefix: str = "") -> None:
    """Check that the actual trails are the motion's, and the desired ones the reference's."""
    found = {n.removeprefix(prefix): v for n, v in trails(commands).items() if n.startswith(prefix)}
    base = middles(found["trail-base"], COUNT)
    assert base[:, :2] == pytest.approx(run.base[:, :2], abs=NEAR)
    assert middles(found["trail-tip"], COUNT) == pytest.approx(run.ee, abs=NEAR)
    width = float(np.linalg.norm(found["trail-base"][0] - found["trail-base"][1]))
    flat = np.column_stack([run.base_ref[:, :2], np.full(COUNT, -0.05)])  # on the ground
    assert away(found["trail-base-desired"], flat).max() < width
    assert base[:, 2] == pytest.approx(-0.05, abs=width)
    assert away(found["trail-tip-desired"], run.ee_ref).max() < width
    for name, path in (("base", flat), ("tip", run.ee_ref)):
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
        [golden.base[:, :2], golden.base_ref[:, :2], golden.ee[:, :2], golden.ee_ref[:, :2]]
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
        replace(tricycle, drive=drive), replace(golden, drive={**golden.drive, "ground": -0.5})
    )
    assert scene.lower[2] == pytest.approx(-0.5)
    trail = middles(trails(scene.commands)["trail-base"], COUNT)
    assert trail[:, 2] == pytest.approx(-0.5, abs=0.05)
    assert trail[:, 2].min() > -0.5


def test_clips_start_at_zero_and_long_ones_are_thinned(tricycle: Robot, golden: Run) -> None:
    late = replace(golden, t=golden.t + 7.0)
    scene = build_scene(tricycle, late)
    assert scene.times == pytest.approx(TIMES)
    assert scene.duration == pytest.approx(0.5)
    check_motion(scene.commands, tricycle, golden.q, "robot")
    for duration, count, frames_kept in ((2.01, 400, 62), (100.0, 2500, 1800), (0.1, 2, 2)):
        places = np.linspace(0, COUNT - 1, count).astype(int)
        arrays: dict[str, Any] = {
            n: a[places] for n, a in vars(golden).items() if isinstance(a, np.ndarray)
        }
        run = replace(golden, **{**arrays, "t": np.linspace(0.0, duration, count)})
        times = build_scene(tricycle, run).times
        assert len(times) == frames_kept  # 30 a second, 1800 at most, the ends among them
        assert (times[0], times[-1]) == (0.0, duration)


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
    # Where both follow one reference, it is drawn once, and the first run's is.
    same = replace(other, base_ref=golden.base_ref, ee_ref=golden.ee_ref)
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
    sunk = replace(other, drive={**other.drive, "ground": -0.3})
    merged = merge([golden, sunk], [scene, build_scene(tricycle, sunk)])
    assert heights(merged.commands, "/rpctl/ground", 0) == pytest.approx((-0.05, -0.05))


def test_columns_stand_on_the_ground_and_are_half_as_high_as_the_robot(
    tricycle: Robot, golden: Run
) -> None:
    """The robot is 0.55 m high, from the ground at -0.05 m to the box at its arm's end."""
    scene = build_scene(tricycle, among(golden, DISC))
    foot, top = heights(scene.commands, PATH, 0)
    assert foot == pytest.approx(-0.05, abs=0.01)
    assert top == pytest.approx(-0.05 + 0.5 * 0.55, abs=0.01)


def bend(curvature: float) -> ReferenceState:
    """Return a reference that drives a bend at 0.5 m/s, with its arm held out."""
    nothing = np.zeros(2)
    return ReferenceState(
        pose=np.array([1.0, 2.0, 0.4]),
        twist=np.array([0.5, 0.0, 0.5 * curvature]),
        twist_dot=np.zeros(3),
        joints=np.array([-0.3, 0.2]),
        joint_rates=nothing,
        joint_accelerations=nothing,
    )


@pytest.mark.parametrize("curvature", [0.5, -0.25])
def test_live_page_is_told_of_robot_and_reference(
    tricycle: Robot, golden: Run, curvature: float
) -> None:
    """P is 0.8 m behind the front wheel: in a bend that one steers by atan(0.8 κ)."""
    stream = Stream()
    Broadcast(tricycle, Unopened(), stream, 1.0)(0.0, golden.q[5], bend(curvature))
    ((t, count, *rest),) = frames(stream)
    names = ("x", "y", "heading", *list(tricycle.model.names)[2:])
    assert (t, count) == (0.0, len(names))
    robot = dict(zip(names, rest[: int(count)], strict=True))
    ghost = dict(zip(names, rest[int(count) :], strict=True))
    wheels = {"left_wheel_joint": 5.5, "right_wheel_joint": 4.5, "front_wheel_joint": -3.5}
    wheels = {name: float(np.angle(np.exp(1j * angle))) for name, angle in wheels.items()}
    arm = {"steer_joint": 0.5, "swing_joint": 1.0, "slide_joint": 0.25}
    expected = {"x": 1.0, "y": 0.75, "heading": 1.5, **arm, **wheels}
    assert robot == pytest.approx(expected, abs=1e-5)
    steer = float(np.arctan(0.8 * curvature))
    arm = {"steer_joint": steer, "swing_joint": -0.3, "slide_joint": 0.2}
    x, y = 1.0 + 0.1 * np.cos(0.4), 2.0 + 0.1 * np.sin(0.4)  # the root link is ahead of P
    expected = {"x": x, "y": y, "heading": 0.4, **arm, **wheels}
    assert ghost == pytest.approx(expected, abs=1e-5)


def test_simulation_is_announced_where_it_starts(tricycle: Robot) -> None:
    """Its page has the whole path, and the robot as the reference has it at the start."""

    def reference(t: float) -> ReferenceState:
        state = bend(0.5 - 0.1 * t)
        return state._replace(pose=np.array([1.0 + 0.5 * t, 2.0, 0.4]), joints=np.array([t, 0.2]))

    pages: list[str] = []

    def say(text: str) -> None:
        pages.append(ask(text.split()[0])[1].decode())

    with broadcast(tricycle, reference, 4.0, say):
        pass
    data = embedded(pages[0])
    shown = {joint["name"]: joint["position"] for joint in data["joints"]}
    assert shown["steer_joint"] == pytest.approx(np.arctan(0.8 * 0.5))
    assert (shown["swing_joint"], shown["slide_joint"]) == pytest.approx((0.0, 0.2))
    start = [1.0 + 0.1 * np.cos(0.4), 2.0 + 0.1 * np.sin(0.4), 0.4]
    assert data["start"] == pytest.approx(start)
    assert data["duration"] == 4.0
    dashes = trails(data["commands"])["trail-base-desired"]
    assert [dashes[:, 0].min(), dashes[:, 0].max()] == pytest.approx([1.0, 3.0], abs=0.3)


def test_live_page_has_the_desired_path_and_room_for_it(tricycle: Robot, golden: Run) -> None:
    show = Show("/events", golden.q[1], golden.base_ref, 0.5)
    data = embedded(robot_page(tricycle, show))
    found = trails(data["commands"])
    assert [*found] == ["trail-base-desired"]  # the actual one grows in the page
    flat = golden.base_ref * [1.0, 1.0, 0.0]
    assert away(found["trail-base-desired"] * [1.0, 1.0, 0.0], flat).max() < data["trail"]
    assert data["point"] == pytest.approx([-0.1, 0.0])
    assert data["start"] == pytest.approx([0.2, 0.03, 0.3])
    assert data["duration"] == 0.5
    low, high = np.array(data["area"])[:, :2]
    assert (low < golden.base_ref[:, :2].min(axis=0) - 0.5).all()
    assert (high > golden.base_ref[:, :2].max(axis=0) + 0.5).all()
    shown = {joint["name"]: joint["position"] for joint in data["joints"]}
    assert shown["steer_joint"] == pytest.approx(0.1)
    assert shown["slide_joint"] == pytest.approx(0.05)


def test_reference_robot_of_a_log_steers_by_the_reference(tricycle: Robot) -> None:
    """Its wheels roll along the reference too; the robot itself, off its path, does neither."""
    run = rpctl.track(tricycle, "eight", 0.4, (0.1, -0.1, 0.1))
    ahead = np.array([tricycle.joint_position(q, "steer_joint") for q in run.q_ref])
    heading, place = run.base_ref[:, 2], run.base_ref[:, :2]
    step = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = step > 1e-5
    middle = 0.5 * (ahead[1:] + ahead[:-1])[moving]
    assert moving.sum() > 50
    assert middle == pytest.approx(
        np.arctan(0.8 * np.diff(heading)[moving] / step[moving]), abs=1e-3
    )
    assert np.abs(ahead - run.steering[:, 0]).max() > 0.01
    for name, offset in (("left_wheel_joint", 0.3), ("right_wheel_joint", -0.3)):
        turned = np.unwrap([tricycle.joint_position(q, name) for q in run.q_ref])
        rolled = step.sum() - offset * (heading[-1] - heading[0])
        assert turned[-1] - turned[0] == pytest.approx(rolled / 0.1, rel=2e-2)
