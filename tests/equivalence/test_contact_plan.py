"""The plan of the contact trial: how far and how fast a robot is moved, and its servo."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.equivalence.contact import plan as contact_plan
from rpctl.robot.vary import set_limits


def planned(robot: Robot) -> contact_plan.ContactPlan:
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    return contact_plan.plan_motion(dynamics, contacts)


def swivelled(robot: Robot, **changes: float) -> Robot:
    """Return the robot with its first swivel changed."""
    first, *rest = robot.drive.swivels
    swivels = (dataclasses.replace(first, **changes), *rest)  # type: ignore[arg-type]
    return dataclasses.replace(robot, drive=dataclasses.replace(robot.drive, swivels=swivels))


def moved(robot: Robot) -> dict[str, float]:
    """Return how far the plan moves each joint at full pace, rad or m."""
    size = contact_plan._amplitudes(robot, contact_plan.Course(), 1.0).tolist()
    sizes = dict(zip(robot.quasi_velocities, size, strict=True))
    return {name: size for name, size in sizes.items() if name.endswith("_joint")}


def test_the_servo_pushes_towards_the_plan(paper: Robot) -> None:
    plan = planned(paper)
    at, rates = plan.targets[0][0], plan.targets[1][0]
    np.testing.assert_array_equal(plan.efforts(0, at, rates), plan.tau[0])
    behind = plan.efforts(0, at - [0.01, 0.0], rates) - plan.tau[0]
    slow = plan.efforts(0, at, rates - [0.01, 0.0]) - plan.tau[0]
    inertia = plan.inertia[0]
    np.testing.assert_allclose(behind[2:], 6400.0 * 0.01 * inertia[:, 0], atol=1e-12)
    np.testing.assert_allclose(slow[2:], 160.0 * 0.01 * inertia[:, 0], atol=1e-12)
    assert not behind[:2].any()  # wheels get what the plan says, whatever is measured
    np.testing.assert_allclose(plan.efforts(0, at + 2.0 * math.pi, rates), plan.tau[0], atol=1e-9)


def test_casters_start_behind_their_axes() -> None:
    robot = rpctl.load("casters")
    names = [swivel.joint for swivel in robot.drive.swivels]
    behind = contact_plan.start(robot)
    assert [robot.joint_position(behind, name) for name in names] == [0.0, 0.0]
    turned = contact_plan.start(swivelled(robot, heading=0.5, sign=-1.0))
    assert robot.joint_position(turned, names[0]) == pytest.approx(0.5)


def test_a_slower_motion_is_planned_where_wheels_are_slow(paper: Robot) -> None:
    """At full pace the right wheel turns at (1 + .8·.75/2…)/.15 rad/s at most; 3 rad/s halve it."""
    slow = set_limits(paper, velocity={"wheel_*": 3.0})
    index = [paper.velocity_index(wheel.joint) for wheel in paper.drive.wheels]
    full, tame = planned(paper).v[:, index], planned(slow).v[:, index]
    assert np.abs(full).max() > 0.8 * 3.0 >= np.abs(tame).max()
    np.testing.assert_allclose(tame[-1], full[-1] / 4.0, rtol=1e-6)


def test_a_base_that_moves_to_any_side_ends_up_moving_ahead_and_to_the_left() -> None:
    """At full pace 1 m/s and .4 m/s, halfway through half of it; the turn, .8 rad, is over."""
    robot = rpctl.load("mecanum")
    dynamics, plan = ReducedDynamics(robot), planned(robot)
    half = len(plan.tau) // 2
    for tick, expected in ((half, [0.5, 0.2, 0.8]), (-1, [1.0, 0.4, 0.0])):
        nu = np.linalg.lstsq(dynamics.basis(plan.q[tick]), plan.v[tick], rcond=None)[0]
        np.testing.assert_allclose(nu[:3], expected, atol=1e-9)
    assert robot.base_pose(plan.q[-1])[2] == pytest.approx(0.8)


def test_joints_move_a_tenth_of_their_range_at_most_and_to_its_wider_side() -> None:
    """Slides up to .05 m, turns up to .3 rad; a lift of .4 m, joints from -.8 to 1.2 rad, …"""
    assert moved(rpctl.load("mecanum")) == pytest.approx(
        {
            "lift_joint": 0.04,  # at .12 m of 0 to .4 m
            "arm_yaw_joint": 0.3,  # ±2.4 rad
            "shoulder_joint": 0.2,  # at 0 of -.8 to 1.2 rad
            "elbow_joint": -0.22,  # at 0 of -1.2 to 1 rad
            "wrist_joint": 0.3,
        }
    )
    paper = moved(rpctl.load("paper"))  # .6 m and 5.2 rad
    assert paper == pytest.approx({"arm_revolute_joint": 0.3, "arm_prismatic_joint": 0.05})


def test_steered_joints_move_half_of_their_limits_at_most_each_half_as_far_as_the_last() -> None:
    """The car's left one has ±.55 rad; of the swerve base's two that turn freely, .3 and -.15."""
    assert moved(rpctl.load("car"))["steering_left_joint"] == pytest.approx(0.275)
    swerve = moved(rpctl.load("swerve"))
    assert swerve["steering_front_left_joint"] == pytest.approx(0.3)
    assert swerve["steering_rear_left_joint"] == pytest.approx(-0.15)


def test_slow_joints_turn_at_four_fifths_of_their_speed() -> None:
    """At .1 rad/s: at most .08 rad/s, half of it on average, so .08 rad in 2 s."""
    joint = "steering_left_joint"
    robot = set_limits(rpctl.load("car"), velocity={joint: 0.1})
    plan = planned(robot)
    assert np.abs(plan.v[:, robot.velocity_index(joint)]).max() == pytest.approx(0.08)
    assert moved(robot)[joint] == pytest.approx(0.08)
