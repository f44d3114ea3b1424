"""``Robot``: names, configurations, locks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import DescriptionError, UnknownNameError
from tests.robots import SET_A, platform, write
from tests.vehicles import Parts


def test_configurations_hold_the_root_and_the_pose_is_of_p(
    mixed_chain: Robot, rng: np.random.Generator
) -> None:
    q = mixed_chain.configuration(1.0, 2.0, 0.5, joints={"lift_joint": 0.1})
    np.testing.assert_allclose(q[:4], [1.0, 2.0, np.cos(0.5), np.sin(0.5)])
    assert mixed_chain.joint_position(q, "lift_joint") == 0.1
    pose, joints = rng.normal(size=3), rng.uniform(-0.1, 0.1, len(mixed_chain.joints))
    q = mixed_chain.configuration_at(pose, joints)
    np.testing.assert_allclose(mixed_chain.base_pose(q), pose, atol=1e-15)
    np.testing.assert_allclose(mixed_chain.joint_positions(q), joints)
    # P lies between the wheels' axles, as Pinocchio places them.
    data = mixed_chain.model.createData()
    pin.forwardKinematics(mixed_chain.model, data, q)
    wheels = [data.oMi[mixed_chain.model.getJointId(w.joint)] for w in mixed_chain.drive.wheels]
    middle = 0.5 * (wheels[0].translation + wheels[1].translation)
    np.testing.assert_allclose(middle[:2], pose[:2], atol=1e-12)


def test_poses_at_once_are_those_of_pinocchio(robot: Robot, rng: np.random.Generator) -> None:
    q = np.array([robot.random_configuration(rng) for _ in range(9)])
    data, tip = robot.model.createData(), robot.model.njoints - 1
    found = robot.joint_poses(q, [tip])
    assert set(found) == set(robot.model.supports[tip])
    for k, each in enumerate(q):
        pin.forwardKinematics(robot.model, data, each)
        for joint, poses in found.items():
            expected = data.oMi[joint].homogeneous[:3]
            np.testing.assert_allclose(poses[:, :, k], expected, atol=1e-13)
    if robot.end_effector is not None:
        expected = [robot.end_effector_pose(data, each).homogeneous for each in q]
        np.testing.assert_allclose(robot.end_effector_poses(q), expected, atol=1e-13)


def test_random_configurations_respect_limits(robot: Robot, rng: np.random.Generator) -> None:
    for _ in range(20):
        q = robot.random_configuration(rng)
        assert np.hypot(q[2], q[3]) == pytest.approx(1.0)
        for joint, position in zip(robot.joints, robot.joint_positions(q), strict=True):
            assert joint.lower <= position <= joint.upper


def test_locks_freeze_at_their_value(tiago: Robot) -> None:
    free = tiago
    locked = rpctl.load("tiago", lock={"torso_lift_joint": 0.2, "head_*": 0.0})
    assert locked.dof == free.dof - 3
    joints = dict(zip((j.name for j in locked.joints), locked.home, strict=True))
    q_locked = locked.configuration(0.3, -0.2, 0.7, joints=joints)
    q_free = free.configuration(0.3, -0.2, 0.7, joints={**joints, "torso_lift_joint": 0.2})
    there = locked.end_effector_pose(locked.model.createData(), q_locked)
    here = free.end_effector_pose(free.model.createData(), q_free)
    np.testing.assert_allclose(there.homogeneous, here.homogeneous, atol=1e-12)
    # The frozen joints' masses stay: the inertia seen by what is left is the same.
    M = rpctl.ReducedDynamics(free).inertia(q_free)
    keep = [free.quasi_velocities.index(name) for name in locked.quasi_velocities]
    np.testing.assert_allclose(
        rpctl.ReducedDynamics(locked).inertia(q_locked), M[np.ix_(keep, keep)], atol=1e-12
    )


def drum(tmp_path: Path) -> Robot:
    """Return a platform with a drum that turns without end, and a slide that it drives."""
    parts = Parts([])
    parts.link("drum", 1.0)
    parts.joint("turn", "continuous", ("base", "drum"), "0 0 0.5", "0 0 1")
    parts.link("slide", 1.0)
    follows = '<mimic joint="turn" multiplier="0.5" offset="0.1"/>'
    limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'
    parts.joint("push", "prismatic", ("base", "slide"), "0 0 0.6", "1 0 0", limit + follows)
    return rpctl.load(write(tmp_path, platform(SET_A, extra="".join(parts.xml))))


def test_a_mimic_follows_a_continuous_joint_past_half_a_turn(tmp_path: Path) -> None:
    """0.5 · 3.5 + 0.1 and 0.5 · (−7) + 0.1, not those of the same angle within a turn."""
    robot = drum(tmp_path)
    for turned, pushed in ((3.5, 1.85), (-7.0, -3.4), (0.0, 0.1)):
        q = robot.configuration(joints={"turn": turned})
        assert robot.joint_position(q, "push") == pytest.approx(pushed)
        q = robot.configuration_at(np.zeros(3), np.array([turned]))
        assert robot.joint_position(q, "push") == pytest.approx(pushed)
    assert robot.joint_position(robot.configuration(), "push") == pytest.approx(0.1)


def test_a_massless_mover_is_refused_with_the_way_out(tmp_path: Path) -> None:
    finger = """<link name="finger"/>
      <joint name="grip" type="revolute"><parent link="base"/><child link="finger"/>
      <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>"""
    path = write(tmp_path, platform(SET_A, extra=finger))
    with pytest.raises(DescriptionError, match=r':\d+: error: link "finger" has no <inertial>'):
        rpctl.load(path)
    assert rpctl.load(path, lock=["grip"]).dof == 2


def test_an_end_effector_can_be_chosen(paper: Robot) -> None:
    other = paper.joints[0].child
    assert rpctl.load("paper", end_effector=other).end_effector == other != paper.end_effector
    with pytest.raises(UnknownNameError, match=f"link '{other}s'"):
        rpctl.load("paper", end_effector=f"{other}s")


def test_a_mover_without_inertia_is_refused(tmp_path: Path) -> None:
    """A point mass on its own axis has a mass, but nothing that resists the joint."""
    spinner = """<link name="tip"><inertial><mass value="1"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
      <joint name="twist" type="revolute"><parent link="base"/><child link="tip"/>
      <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>"""
    path = write(tmp_path, platform(SET_A, extra=spinner))
    with pytest.raises(DescriptionError, match=r'joint "twist" moves links of no or negative'):
        rpctl.load(path)


def test_a_robot_says_what_it_is_in_three_lines(paper: Robot) -> None:
    first, wheels, speeds = repr(paper).splitlines()
    assert first == "<Robot paper: differential drive, paper"
    assert wheels == " wheels: wheel_left_joint, wheel_right_joint; end effector: tool_link"
    assert speeds == f" quasi-velocities: {', '.join(paper.quasi_velocities)}>"
