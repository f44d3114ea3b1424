"""What is drawn of a run that is known on paper: who stands where, and which trail is whose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from rpctl import Robot, Run
from rpctl.view.scene.scene import Scene, build_scene
from tests.golden import COUNT, TIMES
from tests.runs import vary
from tests.view.readers import Array, drawn_by, middles, path_distances, tracks, trails
from tests.view.samples import numbers

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
        "trail-base-desired": 0x6B7480,
        "trail-base": 0x0072B2,
        "trail-tip-desired": 0x6B7480,
        "trail-tip": 0xD55E00,
    }


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


def heights(commands: Sequence[bytes], path: str, number: int) -> tuple[float, float]:
    """Return the least and the largest height of a geometry, m."""
    geometry = drawn_by(commands)[path]["object"]["geometries"][number]
    points = numbers(geometry["data"]["attributes"]["position"]["array"]).reshape(-1, 3)
    return float(points[:, 2].min()), float(points[:, 2].max())
