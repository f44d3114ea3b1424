from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import contact_point
from rpctl.view.scene.markers import build_markers

Array = np.ndarray[Any, Any]


def placed(robot: Robot, q: Array) -> dict[str, Array]:
    """Return the pose (4, 4) in the world of every marker."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return {
        node["name"]: data.oMi[joint].homogeneous @ np.array(node["matrix"]).reshape(4, 4).T
        for joint, nodes in build_markers(robot, 1.0).joint_nodes.items()
        for node in nodes
    }


@pytest.fixture(params=["paper", "mecanum", pytest.param("tiago", marks=pytest.mark.slow)])
def wheeled(request: pytest.FixtureRequest) -> Robot:
    return rpctl.load(request.param)


def test_frames_and_masses_are_those_of_the_links(wheeled: Robot, rng: np.random.Generator) -> None:
    q = wheeled.random_configuration(rng)
    poses = placed(wheeled, q)
    data = wheeled.model.createData()
    pin.framesForwardKinematics(wheeled.model, data, q)
    for index, link in enumerate(wheeled.description.links):
        frame = data.oMf[wheeled.model.getFrameId(link.name, pin.FrameType.BODY)].homogeneous
        assert poses[f"frame-{index}"] == pytest.approx(frame, abs=1e-12)
        if link.mass:
            centre = frame @ [*link.com, 1.0]
            assert poses[f"mass-{index}"][:, 3] == pytest.approx(centre, abs=1e-12)


def test_contacts_are_where_the_wheels_touch_the_ground(
    wheeled: Robot, rng: np.random.Generator
) -> None:
    q = wheeled.random_configuration(rng)
    poses = placed(wheeled, q)
    data = wheeled.model.createData()
    pin.forwardKinematics(wheeled.model, data, q)
    for index, wheel in enumerate(wheeled.drive.wheels):
        point = contact_point(wheeled, data, wheel)
        axle = data.oMi[wheeled.model.getJointId(wheel.joint)].rotation @ np.array(wheel.axis)
        contact = poses[f"contact-{index}"]
        assert contact[:3, 3] == pytest.approx(point, abs=1e-9)
        assert contact[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
        assert abs(contact[:3, 0] @ axle) < 1e-6  # a wheel rolls across its axle
    heading = wheeled.base_pose(q)
    assert poses["contact-P"][:2, 3] == pytest.approx(heading[:2])
    assert poses["contact-P"][:2, 0] == pytest.approx([np.cos(heading[2]), np.sin(heading[2])])


def test_wheels_roll_as_the_constraint_has_it(wheeled: Robot, rng: np.random.Generator) -> None:
    """Along each wheel's direction, contact and spin cancel for every motion that A allows."""
    dynamics = ReducedDynamics(wheeled)
    q = wheeled.configuration()
    v = dynamics.basis(q) @ rng.normal(size=wheeled.dof)
    poses, wheels = placed(wheeled, q), build_markers(wheeled, 1.0).wheels
    for entry, wheel in zip(wheels, wheeled.drive.wheels, strict=True):
        contact = poses[entry["node"]]
        x, y = contact[:2, 3]
        way = contact[:2, :2].T @ [v[0] - v[2] * y, v[1] + v[2] * x]
        (ax, ay, _), (dx, dy) = entry["axle"], entry["along"]
        spin = (way @ [dx, dy]) / (entry["radius"] * (ay * dx - ax * dy))
        assert spin == pytest.approx(v[wheeled.velocity_index(wheel.joint)], abs=1e-6)
