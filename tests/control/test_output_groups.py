"""What robots take by groups: twist, wheel speeds, steering, positions; their times and bounds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Controller, Robot, RpctlError
from rpctl.control.group_commands import GroupCommands
from rpctl.control.output_groups import OutputGroup
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput, as_output
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.plants.rolling import VelocityPlant
from tests.catalogue import robot_of
from tests.grids import cells

PERIOD = 0.01


def commands(robot: Robot, output: Any) -> GroupCommands:
    settings = as_output(output)
    assert settings is not None
    return GroupCommands(settings.on(robot), ReducedDynamics(robot), PERIOD)


@pytest.mark.parametrize(
    ("name", "output", "told"),
    [
        ("paper", {"base": "twist"}, "arm_revolute_joint is in no group"),
        ("paper", {"*": "position"}, 'v is in no group of the output; .*"base": "twist"'),
        ("paper", {"base": "twist", "*": "position", "arm_p*": "velocity"}, "in the groups"),
        ("paper", {"base": "effort", "arm_*": "velocity"}, "efforts beside groups of the arm"),
        ("paper", {"base": "twist", "*": OutputGroup("effort", 0.1)}, "which act at once"),
        ("paper", {"base": "position", "*": "position"}, "a base does not take position"),
        (
            "paper",
            {"base": "twist", "*": "twist"},
            "joints of an arm; give velocity, position or effort",
        ),
        ("paper", {"base": "twist", "leg_*": "position"}, "leg_"),
        ("paper", "steering", "is differential: give twist"),
        ("swerve", "steering", "give wheel-speeds"),
        ("car", "twist", "nothing of its steering while it stands; give steering"),
        ("arm", "twist", "has a fixed base"),
        ("paper", "torque", "'torque' is not known"),
    ],
)
def test_what_a_robot_cannot_be_sent_is_refused(name: str, output: Any, told: str) -> None:
    with pytest.raises(RpctlError, match=told):
        Controller(robot_of(name), "eight", output=output, compiled=False)


def test_bounds_and_times_are_those_of_the_group(paper: Robot) -> None:
    group = OutputGroup(
        "twist", 0.1, 0.05, speeds={"v": 0.3}, accelerations={"*": 0.5}, jerks={"omega": 4.0}
    )
    groups = {"base": group, "*": OutputGroup("position", jerks={"*_prismatic_*": 9.0})}
    found = VelocityOutput(lag=0.02, groups=groups).on(paper)
    assert found.lag_of(paper.quasi_velocities).tolist() == [0.1, 0.1, 0.02, 0.02]
    assert found.dead_times_of(paper.quasi_velocities).tolist() == [0.05, 0.05, 0.0, 0.0]
    assert found.speeds == {"v": 0.3}
    assert found.accelerations == {"v": 0.5, "omega": 0.5}
    assert found.jerks == {"omega": 4.0, "arm_prismatic_joint": 9.0}
    assert found.on(paper) == found
    with pytest.raises(RpctlError, match="delta"):
        VelocityOutput(groups={**groups, "base": OutputGroup(speeds={"delta": 1.0})}).on(paper)


def test_wheels_turn_by_the_bases_speeds(paper: Robot) -> None:
    """v = .3 m/s and ω = .2 rad/s on wheels of .15 m, .75 m off: (.3 ∓ .15)/.15 = 1 and 3 rad/s."""
    make, sample = (
        commands(paper, "wheel-speeds"),
        MeasuredSample(0.0, paper.configuration(), np.zeros(paper.dof)),
    )
    nu = np.array([0.3, 0.2, 0.5, -0.1])
    make(0.0 * nu, sample, sample, False)
    base, arm = make(nu, sample, sample, False).values()
    assert base.kind == "wheel-speeds"
    assert base.speeds == pytest.approx({"wheel_left_joint": 1.0, "wheel_right_joint": 3.0})
    assert base.accelerations["wheel_right_joint"] == pytest.approx(3.0 / PERIOD)
    assert arm.speeds == {"arm_revolute_joint": 0.5, "arm_prismatic_joint": -0.1}
    twist = commands(paper, "twist")(nu, sample, sample, False)["base"]
    assert twist.speeds == {"v": 0.3, "omega": 0.2}


def test_one_angle_steers_a_car_and_each_wheel_has_its_own() -> None:
    """Ackermann: cot of the wheels' angles differ by track over wheelbase, about the single one's.

    The single wheel stands in the middle; the steered joint is at a + T δ̇ T_s from where it is.
    """
    robot = rpctl.load("car")
    left, right = (s for s in robot.drive.swivels)
    make = commands(robot, "steering")
    sample = MeasuredSample(0.0, robot.configuration(joints={left.joint: 0.3}), np.zeros(robot.dof))
    nu = np.zeros(robot.dof)
    nu[:2] = 0.5, 0.8
    found = make(nu, sample, sample, False)["base"]
    (x, y), (_, other) = left.pivot, right.pivot
    single = found.positions["steering"]
    wheelbase = x - robot.drive.point[0]
    cot = {name: 1.0 / math.tan(angle) for name, angle in found.positions.items()}
    assert found.positions[left.joint] == pytest.approx(0.3 + 0.8 * PERIOD)
    assert cot["steering"] - cot[left.joint] == pytest.approx(y / wheelbase)
    assert cot["steering"] - cot[right.joint] == pytest.approx(other / wheelbase)
    assert found.speeds["v"] == 0.5
    again = make(nu, sample, sample, False)["base"]
    rate = (again.positions["steering"] - single) / PERIOD
    assert again.speeds["steering"] == pytest.approx(rate)
    wheels = commands(robot, "wheel-speeds")(nu, sample, sample, False)["base"]
    assert set(wheels.positions) == {left.joint, right.joint}
    assert len(wheels.speeds) == 2


def test_a_commanded_position_goes_on_by_its_rate_and_waits_for_a_joint_that_is_held(
    paper: Robot,
) -> None:
    """At 1 rad/s with a lag of .1 s p is .1 rad ahead; held, it stays a leash of .1 s ahead."""
    output = {"base": "twist", "*": OutputGroup("position", lag=0.1)}
    make, nu = commands(paper, output), np.array([0.0, 0.0, 1.0, 0.0])
    name = "arm_revolute_joint"
    joint = paper.description.joint[name]
    q, moving = paper.state(joints={name: 0.2})[0], np.array([0.0, 0.0, 1.0, 0.0])
    first = make(nu, MeasuredSample(0.0, q, moving), MeasuredSample(0.0, q, moving), False)["*"]
    assert first.positions[name] == pytest.approx(0.2 + 0.1 + 0.01)
    assert first.speeds[name] == 1.0
    still = MeasuredSample(0.0, q, 0.0 * nu)
    unseen = make(nu, still, None, False)["*"]  # no new sample: it goes on
    assert unseen.positions[name] == pytest.approx(0.2 + 0.1 + 0.02)
    for _ in range(200):
        found = make(nu, still, still, False)["*"]
    leash = 0.1 * joint.velocity
    assert found.positions[name] == pytest.approx(min(0.2 + leash + PERIOD, joint.upper))
    off = make(0.0 * nu, still, None, True)["*"]
    assert off.positions[name] == pytest.approx(0.2)


def test_positions_stay_within_the_limits_of_a_joint(paper: Robot) -> None:
    name = "arm_prismatic_joint"
    upper = paper.description.joint[name].upper
    make = commands(paper, {"base": "twist", "*": "position"})
    sample = MeasuredSample(0.0, paper.configuration(joints={name: upper}), np.zeros(paper.dof))
    found = make(np.array([0.0, 0.0, 0.0, 5.0]), sample, sample, False)
    assert found["*"].positions[name] == upper


def test_what_a_controller_sends_is_told_by_group_also_when_it_stops(paper: Robot) -> None:
    output = {"base": "twist", "*": "position"}
    controller = Controller(paper, "eight", period=PERIOD, output=output, compiled=False)
    q, nu = paper.state((0.1, 0.1, 0.2))
    assert not controller.step(0.0, q[:-1], nu).commands
    sent = controller.step(0.01, q, nu)
    assert list(sent.commands["base"].speeds.values()) == sent.speeds[:2].tolist()
    held = controller.step(0.02, 0.0 * q, nu)
    assert held.status == "held"
    assert held.commands["base"].speeds == sent.commands["base"].speeds
    controller.pause(motors_off=True)
    off = controller.step(0.03, q, nu)
    assert off.commands["base"].speeds == {"v": 0.0, "omega": 0.0}
    joints = dict(zip(paper.joint_names, paper.joint_positions(q), strict=True))
    assert off.commands["*"].positions == pytest.approx(joints)


LATE = {
    "base": OutputGroup("twist", lag=0.1, dead_time=0.104),
    "*": OutputGroup("position", lag=0.02, dead_time=0.055),
}


def test_base_and_arm_follow_after_dead_times_of_their_own(paper: Robot) -> None:
    """Prediction is exact for the model; an arm given the base's reference is 21 mrad off."""
    run = rpctl.track(paper, "eight", output=LATE, control_period=PERIOD, duration=4.0,
                      collisions=False)  # fmt: skip
    error = np.abs(run.q - run.q_ref)[run.t > 3.0, :6]  # the wheels' angles have no reference
    assert error[:, :4].max() < 3e-4
    assert error[:, 4:].max() < 5e-5


@pytest.mark.parametrize(
    ("lag", "period", "speed"),
    cells(
        [(0.0, 0.05, 0.3), (0.1, 0.02, 0.3), (0.0, 0.05, 0.15)],
        [(0.1, 0.02, 0.3), (0.0, 0.05, 0.15)],
    ),
)
def test_bounds_of_jerk_hold_on_the_way_to_a_speed_and_none_is_overshot(
    lag: float, period: float, speed: float
) -> None:
    """Of the motion, from beside a reference of up to .2 m/s; within .15 m/s it is left behind."""
    robot = robot_of("mecanum")
    most = np.array([[speed, speed, 1.0], [0.3, 0.3, 1.0], [1.0, 1.0, 3.0]])
    speeds, accelerations, jerks = ({"v?": row[0], "omega": row[2]} for row in most.tolist())
    bounds = {"speeds": speeds, "accelerations": accelerations, "jerks": jerks}
    output = {"base": OutputGroup("twist", lag, 0.0, **bounds), "*": OutputGroup("velocity")}
    run = rpctl.track(robot, "eight", output=output, initial_error=(0.3, 0.2, 0.4),
                      control_period=period, duration=10.0, speed=0.2, size=1.0,
                      collisions=False)  # fmt: skip
    a = np.diff(run.nu[:, :3], axis=0) / period
    j = np.diff(a, axis=0, prepend=np.zeros((1, 3))) / period
    largest = [np.abs(x).max(axis=0) for x in (run.nu[:, :3], a, j)]
    assert (np.array(largest) <= (1.0 + 1e-6) * most).all()
    assert (largest[2] > [0.99, 0.99, 2.9]).all()
    assert {("omega", "jerk"), ("vx", "speed")} <= set(run.bound_limits) or speed > 0.2
    assert np.abs(run.q[-1, :4] - run.q_ref[-1, :4]).max() < 0.02 or speed < 0.2


@pytest.mark.parametrize(("lag", "period"), cells([(0.0, 0.05), (0.1, 0.02)], [(0.0, 0.05)]))
def test_stops_and_gaps_are_within_the_bounds_of_jerk(lag: float, period: float) -> None:
    """Of the motion: lost samples, a second of them, a pause, and after an emergency stop.

    Brakes stop the robot then, in 1 s; that is their own jerk.
    """
    robot = robot_of("mecanum")
    most = np.array([[0.3, 0.3, 1.0], [0.4, 0.4, 1.0], [2.0, 2.0, 6.0]])
    speeds, accelerations, jerks = ({"v?": row[0], "omega": row[2]} for row in most.tolist())
    bounds = {"speeds": speeds, "accelerations": accelerations, "jerks": jerks}
    output = {"base": OutputGroup("twist", lag, 0.0, **bounds), "*": OutputGroup("velocity")}
    controller = Controller(robot, "eight", period=period, output=output, compiled=False)
    lags = np.where(np.arange(robot.dof) < 3, lag, 0.0)
    plant = VelocityPlant(ReducedDynamics(robot), lags, 0.0, period, period)
    q, nu, rows, statuses = robot.state((0.1, 0.05, 0.2))[0], np.zeros(robot.dof), [], set()
    for k in range(round(14.0 / period)):
        t = k * period
        bad = t % 0.5 < 2.5 * period or 4.0 < t < 5.0
        if abs(t - 7.0) < 0.5 * period or abs(t - 12.0) < 0.5 * period:
            controller.pause(motors_off=t > 10.0)
        if abs(t - 9.0) < 0.5 * period or abs(t - 13.0) < 0.5 * period:
            controller.resume()
        sent = controller.step(t, q * (math.nan if bad else 1.0), nu)
        statuses.add(sent.status)
        plant.send(sent.speeds)
        q, nu, *_ = plant.advance(q, nu)
        rows.append(nu[:3])
    a = np.diff(rows, axis=0, prepend=np.zeros((1, 3))) / period
    j = np.diff(a, axis=0, prepend=np.zeros((1, 3))) / period
    free = np.abs(np.arange(len(j)) * period - 12.5) > 0.5 + 2.5 * period
    for found, limit in zip((np.array(rows), a, j), most, strict=True):
        assert (np.abs(found[free]).max(axis=0) <= (1.0 + 1e-6) * limit).all()
    assert statuses == {"ok", "held", "stopped"}


def test_a_map_that_jumps_turns_nothing_while_the_rates_are_the_bodys(paper: Robot) -> None:
    """The pose is in a map turned by 90° and jumps by .3 m; the twist is odometry's."""
    north = rpctl.as_reference(lambda t: (0.0, 0.15 * t, 0.5 * np.pi), joints=paper.home)
    output = {"base": "twist", "*": "position"}
    controller = Controller(paper, north, period=PERIOD, output=output, compiled=False)
    joints = dict(zip(paper.joint_names, paper.home, strict=True))
    pose, nu, sent = np.array([-0.05, 0.02, 0.5 * math.pi - 0.1]), np.zeros(4), []
    for k in range(400):
        seen = pose + np.array([0.3, 0.0, 0.0]) * (k >= 300)
        q, measured = paper.state(seen.tolist(), nu[:2].tolist(), joints=joints)
        sent.append(controller.step(k * PERIOD, q, measured).speeds)
        nu = sent[-1] * [1.0, 1.0, 0.0, 0.0]
        heading = pose[2] + 0.5 * PERIOD * nu[1]
        pose += PERIOD * np.array([nu[0] * np.cos(heading), nu[0] * np.sin(heading), nu[1]])
    assert controller.report()["jumps"] == 1
    changes = np.abs(np.diff(np.array(sent)[250:, :2], axis=0)).max(axis=0)
    assert (changes < [0.005, 0.02]).all()


def test_a_twist_along_the_worlds_axes_is_turned_into_the_bodys() -> None:
    """Heading north, .4 m/s north is ahead, and .2 m/s west is to the left."""
    north, robot = (0.0, 0.0, 0.5 * math.pi), rpctl.load("mecanum")
    _, nu = robot.state(north, (-0.2, 0.4, 0.3), twist_frame="world")
    np.testing.assert_allclose(nu[:3], [0.4, 0.2, 0.3], atol=1e-12)
    _, nu = rpctl.load("car").state(north, (-0.2, 0.4, 0.3), twist_frame="world")
    np.testing.assert_allclose(nu[:2], [0.4, 0.3], atol=1e-12)
    with pytest.raises(RpctlError, match="'map' is not known"):
        robot.state(north, (0.0, 0.0, 0.0), twist_frame="map")
    with pytest.raises(RpctlError, match="'world' is not known"):
        rpctl.load("swerve").state(north, (), twist_frame="world")
