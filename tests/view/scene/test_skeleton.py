from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.description.records import rotation
from rpctl.view.scene.markers import joints, skeleton
from tests.view.samples import write_gripper

Pose = np.ndarray[Any, Any]


def walk(
    robot: Robot, q: Pose, root: dict[str, Any], entries: list[dict[str, Any]]
) -> dict[str, Pose]:
    """Return the pose (4, 4) of every group as a scene graph has it, moved as the page moves it."""
    motion: dict[str, Pose] = {"bone-1": np.eye(4)}
    x, y, cos, sin = q[:4]
    motion["bone-1"][:2] = [[cos, -sin, 0.0, x], [sin, cos, 0.0, y]]
    for joint in entries:
        position = robot.joint_position(q, joint["name"])
        step = np.eye(4)
        if joint["slides"]:
            step[:3, 3] = position * np.array(joint["axis"])
        else:
            step[:3, :3] = rotation(np.array(joint["axis"]), position)
        motion[f"bone-{joint['node']}"] = step
    poses: dict[str, Pose] = {}

    def enter(node: dict[str, Any], above: Pose) -> None:
        own = np.array(node["matrix"]).reshape(4, 4).T if "matrix" in node else motion[node["name"]]
        poses[node["name"]] = above @ own
        for child in node["children"]:
            enter(child, poses[node["name"]])

    enter(root, np.eye(4))
    return poses


@pytest.mark.parametrize("name", ["paper", "mixed_chain", "mecanum"])
def test_groups_stand_where_pinocchio_places_the_joints(
    name: str, rng: np.random.Generator
) -> None:
    robot = rpctl.load(name)
    root, entries = skeleton(robot, "bone", {}), joints(robot, robot.configuration())
    data = robot.model.createData()
    for _ in range(5):
        q = robot.random_configuration(rng)
        pin.forwardKinematics(robot.model, data, q)
        poses = walk(robot, q, root, entries)
        for j in range(1, robot.model.njoints):
            assert poses[f"bone-{j}"] == pytest.approx(data.oMi[j].homogeneous, abs=1e-12)


def test_joint_that_follows_tells_whom(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    free = rpctl.load(path, free="*")
    locked = rpctl.load(path, lock={"left_finger_joint": 0.4}, free="*")
    for robot in (free, locked):
        entries = joints(robot, robot.configuration())
        names = [joint["name"] for joint in entries]
        mimic = entries[names.index("right_finger_joint")]["mimic"]
        assert (mimic["name"], mimic["multiplier"], mimic["offset"]) == (
            "left_finger_joint", -0.5, 0.1,
        )  # fmt: skip
        if robot is free:
            assert names[mimic["follows"]] == "left_finger_joint"
        else:
            assert mimic["follows"] is None
            assert entries[names.index("right_finger_joint")]["position"] == pytest.approx(-0.1)
