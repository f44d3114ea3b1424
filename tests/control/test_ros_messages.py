"""Messages of ROS as samples, and commands as messages, without ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Controller, ReducedDynamics, Robot
from rpctl.control.ros_messages import Readings, commands_of, fill, topic

WHEELS = "wheel_left_joint", "wheel_right_joint"
ARM = "arm_revolute_joint", "arm_prismatic_joint"
MS = 1_000_000  # ns
TODAY = 1_700_000_000_123_456_789  # ns since 1970: more digits than a float has


def header(at: int, frame: str = "odom") -> Any:
    stamp = SimpleNamespace(sec=at // 10**9, nanosec=at % 10**9)
    return SimpleNamespace(stamp=stamp, frame_id=frame)


def joint_state(
    at: int, names: Sequence[str], positions: Sequence[float], rates: Sequence[float] = ()
) -> Any:
    return SimpleNamespace(header=header(at), name=names, position=positions, velocity=rates)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return SimpleNamespace(x=x, y=y, z=z)


def heading(theta: float) -> Any:
    return SimpleNamespace(x=0.0, y=0.0, z=math.sin(theta / 2), w=math.cos(theta / 2))


def odometry(
    at: int, pose: Sequence[float], twist: Sequence[float] = (0.0, 0.0, 0.0),
    frame: str = "odom", child: str = "base_link",
) -> Any:  # fmt: skip
    x, y, theta = pose
    vx, vy, omega = twist
    there = SimpleNamespace(position=vector(x, y), orientation=heading(theta))
    moving = SimpleNamespace(linear=vector(vx, vy), angular=vector(z=omega))
    return SimpleNamespace(
        header=header(at, frame),
        child_frame_id=child,
        pose=SimpleNamespace(pose=there),
        twist=SimpleNamespace(twist=moving),
    )


def transforms(at: int, pose: Sequence[float]) -> Any:
    x, y, theta = pose
    other = SimpleNamespace(translation=vector(9.0), rotation=heading(1.0))
    own = SimpleNamespace(translation=vector(x, y), rotation=heading(theta))
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(header=header(at), child_frame_id="laser", transform=other),
            SimpleNamespace(header=header(at), child_frame_id="base_link", transform=own),
        ]
    )


def test_a_sample_has_each_joint_by_its_name_in_any_order(paper: Robot) -> None:
    """Wheels of .15 m at ∓.75 m turn at 2 and 4 rad/s: v = .45 m/s, ω = .2 rad/s."""
    readings = Readings(paper)
    names = [ARM[1], "gripper", WHEELS[1], ARM[0], WHEELS[0]]
    readings.take_joints(joint_state(5 * MS, names, [0.1, 7, 3, 0.4, 1], [0.3, 0, 4, -0.2, 2]))
    readings.take_odometry(odometry(5 * MS, (1.0, 2.0, 0.5)))
    found = readings.sample(5 * MS)
    assert found is not None
    t, q, nu = found
    joints = {ARM[0]: 0.4, ARM[1]: 0.1}
    assert t == 0.0
    np.testing.assert_allclose(paper.state_of(q, nu).pose, (1.0, 2.0, 0.5))
    assert paper.joint_positions(q) == pytest.approx([joints[name] for name in paper.joint_names])
    np.testing.assert_allclose(nu, [0.45, 0.2, -0.2, 0.3], atol=1e-12)
    assert readings.refused == {"gripper: not asked for": 1}


def test_nothing_is_sampled_before_all_is_known(paper: Robot) -> None:
    readings = Readings(paper, "map", "base_footprint")
    pose = "the pose of base_footprint in map"
    assert readings.missing() == [ARM[1], ARM[0], pose]
    readings.take_odometry(odometry(0, (0, 0, 0)))
    assert readings.refused == {"the pose of base_link in odom: not asked for": 1}
    readings.take_odometry(odometry(0, (0, 0, 0), frame="map", child="base_footprint"))
    readings.take_joints(joint_state(0, ARM[:1], [0.0]))
    assert readings.missing() == [ARM[1]]
    assert readings.sample(0) is None


def test_rates_that_are_not_told_are_unknown_but_wheels_are_differences(paper: Robot) -> None:
    """A wheel that turns on through π goes .2 rad in 10 ms; what the arm does, nobody says."""
    readings = Readings(paper)
    readings.take_odometry(odometry(TODAY, (0, 0, 0)))
    readings.take_joints(joint_state(TODAY, [*WHEELS, *ARM], [math.pi - 0.1, 3.0, 0.2, 0.1]))
    first = readings.sample(TODAY)
    assert first is not None
    np.testing.assert_array_equal(first[2], [0.0, 0.0, math.nan, math.nan])  # by its odometry
    assert np.isfinite(first[1]).all()
    readings.take_joints(
        joint_state(TODAY + 10 * MS, [*WHEELS, *ARM], [0.1 - math.pi, 3.2, 0.21, 0.1])
    )
    second = readings.sample(TODAY + 10 * MS)
    assert second is not None
    assert second[0] == 0.01
    np.testing.assert_allclose(second[2], [20 * 0.15, 0, math.nan, math.nan], atol=1e-9)


def test_the_bases_twist_stands_in_for_wheels_that_tell_nothing(paper: Robot) -> None:
    readings = Readings(paper)
    readings.take_joints(joint_state(0, ARM, [0.0, 0.0], [0.5, 0.1]))
    readings.take_odometry(odometry(0, (0, 0, 0), (0.3, 0.0, -0.4)))
    found = readings.sample(0)
    assert found is not None
    np.testing.assert_allclose(found[2], [0.3, -0.4, 0.5, 0.1], atol=1e-12)


def test_by_transforms_the_speeds_are_the_wheels_or_unknown(paper: Robot) -> None:
    readings = Readings(paper)
    readings.take_transforms(transforms(0, (1.0, -1.0, 0.3)))
    readings.take_joints(joint_state(0, ARM, [0.0, 0.0], [0.0, 0.0]))
    blind = readings.sample(0)
    assert blind is not None
    np.testing.assert_array_equal(blind[2], [math.nan, math.nan, 0.0, 0.0])
    readings.take_joints(joint_state(0, WHEELS, [0.0, 0.0], [2.0, 2.0]))
    found = readings.sample(0)
    assert found is not None
    np.testing.assert_allclose(paper.state_of(*found[1:]).pose, (1.0, -1.0, 0.3))
    assert found[2][0] == pytest.approx(0.3)


def test_a_pose_is_moved_on_to_now_and_not_into_the_past(paper: Robot) -> None:
    """1 m/s and 2 rad/s for 50 ms along an arc of .5 m radius."""
    readings = Readings(paper)
    rates = [1.0 / 0.15 - 2.0 * 0.75 / 0.15, 1.0 / 0.15 + 2.0 * 0.75 / 0.15, 0, 0]
    readings.take_joints(joint_state(50 * MS, [*WHEELS, *ARM], [0, 0, 0, 0], rates))
    readings.take_odometry(odometry(0, (1.0, 2.0, math.pi / 2)))
    for now, turn in ((50 * MS, 0.1), (-50 * MS, 0.0)):
        found = readings.sample(now)
        assert found is not None
        x, y = 1.0 - 0.5 * (1 - math.cos(turn)), 2.0 + 0.5 * math.sin(turn)
        np.testing.assert_allclose(paper.state_of(*found[1:]).pose, (x, y, math.pi / 2 + turn))


def test_old_readings_make_a_bad_sample(paper: Robot) -> None:
    readings = Readings(paper)
    readings.take_odometry(odometry(60 * MS, (0, 0, 0)))
    readings.take_joints(joint_state(0, [*WHEELS, *ARM], [0, 0, 0, 0], [0, 0, 0, 0]))
    good, bad = readings.sample(100 * MS), readings.sample(101 * MS)
    assert good is not None
    assert bad is not None
    assert np.isfinite(good[1]).all()
    assert np.isnan(bad[1]).all()


def test_readings_out_of_order_or_not_finite_change_nothing(paper: Robot) -> None:
    readings = Readings(paper)
    readings.take_odometry(odometry(20 * MS, (0, 0, 0)))
    readings.take_joints(joint_state(20 * MS, [*WHEELS, *ARM], [0, 0, 0.1, 0.2], [0, 0, 0, 0]))
    readings.take_odometry(odometry(10 * MS, (5, 0, 0)))
    readings.take_odometry(odometry(30 * MS, (math.nan, 0, 0)))
    readings.take_joints(joint_state(20 * MS, ARM, [0.9, 0.9], [0, 0]))
    readings.take_joints(joint_state(30 * MS, ARM[:1], [math.inf], [0]))
    found = readings.sample(20 * MS)
    assert found is not None
    assert paper.joint_positions(found[1]) == pytest.approx([0.1, 0.2])
    assert found[1][0] == 0.0
    assert sum(readings.refused.values()) == 5


def test_steered_wheels_are_needed_and_their_rates_are_quasi_velocities() -> None:
    robot = rpctl.load("car")
    still = dict.fromkeys(robot.joint_names, 0.0)
    q, nu = robot.state(
        (0.0, 0.0, 0.0), (0.6, 0.2), joints={"steering_left_joint": 0.3}, rates=still
    )
    rates = ReducedDynamics(robot).actuation(q).T @ nu
    positions = [robot.joint_position(q, name) for name in robot.actuators]
    readings = Readings(robot)
    assert "steering_left_joint" in readings.missing()
    readings.take_odometry(odometry(0, (0, 0, 0), child=robot.description.root))
    readings.take_joints(joint_state(0, robot.actuators, positions, rates.tolist()))
    found = readings.sample(0)
    assert found is not None
    np.testing.assert_allclose(found[1], q, atol=1e-12)
    np.testing.assert_allclose(found[2], nu, atol=1e-12)


def test_a_pose_in_a_map_is_that_of_the_odometry_moved_by_the_localisation(paper: Robot) -> None:
    """odom lies at (3, 1) in the map, turned by 90°; the base at (.5, .2) of odom, turned by .3."""
    readings = Readings(paper, "map")
    readings.take_joints(joint_state(0, [*WHEELS, *ARM], [0.0] * 4, [2.0, 2.0, 0.0, 0.0]))
    readings.take_odometry(odometry(0, (0.5, 0.2, 0.3), (0.3, 0.0, 0.0)))
    assert readings.missing() == ["the pose of base_link in map"]
    own = transforms(MS, (9.0, 9.0, 9.0)).transforms  # of the tree that odometry itself sends
    moved = SimpleNamespace(translation=vector(3.0, 1.0), rotation=heading(0.5 * math.pi))
    map_to_odom = SimpleNamespace(header=header(0, "map"), child_frame_id="odom", transform=moved)
    readings.take_transforms(SimpleNamespace(transforms=[map_to_odom, *own]))
    found = readings.sample(0)
    assert found is not None
    pose = paper.state_of(*found[1:]).pose
    np.testing.assert_allclose(pose, (2.8, 1.5, 0.3 + 0.5 * math.pi))
    assert found[2][0] == pytest.approx(0.3)
    readings.take_odometry(odometry(20 * MS, (0.7, 0.2, 0.3)))
    found = readings.sample(20 * MS)  # as the map was, with the odometry of now
    assert found is not None
    np.testing.assert_allclose(paper.state_of(*found[1:]).pose[:2], (2.8, 1.7))


class Message(SimpleNamespace):
    """A message whose fields are made as they are written to."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "header":
            raise AttributeError(name)
        made = Message()
        setattr(self, name, made)
        return made


def published(robot: Robot, output: Any, q: Any, period: float = 0.01) -> dict[str, Any]:
    """Return what the groups of a first sample are sent."""
    controller = Controller(robot, "line", period=period, output=output, compiled=False)
    sent = controller.step(0.0, q, np.zeros(robot.dof))
    messages = {}
    for name, command in commands_of(sent).items():
        messages[name] = Message()
        fill(messages[name], Message(), command, controller.period)
    return {"sent": sent, **messages}


def test_efforts_stand_in_the_order_of_the_actuators(paper: Robot) -> None:
    found = published(paper, "effort", paper.state((0.1, -0.2, 0.1))[0])
    assert found[""].data == found["sent"].efforts.tolist()


def test_speeds_become_a_twist_and_a_point_of_a_trajectory(paper: Robot) -> None:
    """A period of 1.5 s, in which the arm goes 1.5 times its rates."""
    q = paper.state((0.1, -0.2, 0.1), joints={ARM[0]: 0.5, ARM[1]: 0.6})[0]
    found = published(paper, {"base": "twist", "*": "position"}, q, 1.5)
    v, omega, one, two = found["sent"].speeds
    twist = found["base"].twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (v, 0.0, omega)
    assert found["*"].joint_names == list(ARM)
    (point,) = found["*"].points
    assert point.positions == pytest.approx([0.5 + 1.5 * one, 0.6 + 1.5 * two])
    assert point.velocities == [one, two]
    assert point.accelerations == [0.0, 0.0]
    assert (point.time_from_start.sec, point.time_from_start.nanosec) == (1, 500 * MS)


def test_a_car_is_sent_the_angle_of_one_wheel_and_a_swerve_all_of_its_wheels() -> None:
    car = rpctl.load("car")
    found = published(car, "steering", car.state(joints={"steering_left_joint": 0.3})[0])
    drive, command = found["base"].drive, found["sent"].commands["base"]
    assert drive.speed == found["sent"].speeds[0]
    assert drive.steering_angle == command.positions["steering"]
    assert drive.steering_angle_velocity == 0.0  # of what was sent before it nothing is known
    swerve = rpctl.load("swerve")
    found = published(swerve, "wheel-speeds", swerve.state()[0])
    command = found["sent"].commands["base"]
    assert found["base"].data == [*command.speeds.values(), *command.positions.values()]
    assert len(found["base"].data) == 8


def test_groups_have_topics_of_their_own() -> None:
    assert topic("base", "twist") == "~/cmd_vel"
    assert topic("*", "position") == "~/joint_trajectory"
    assert topic("arm_left_*", "position") == "~/joint_trajectory/arm_left_"
