"""Between two plans: a plan says where it leads, the robot comes back to it, and bounds hold."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, Run, summarize
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.planner import Asked, Follower, HorizonPlan, Planner, Planning
from rpctl.control.horizon.simulated import Delays
from rpctl.control.obstacles import Disc
from rpctl.reference.motion import configuration_along, reference_rates
from rpctl.reference.named import reference_by_name
from tests.control.tight_limits import limited
from tests.grids import cells

BEGIN, STEP = 5.0, 0.005  # s
OLD = Plant(computing_time=0.05)  # plans are 50 to 100 ms old
CLOSE = 5e-3  # m: what bounds that are linear, and kept at steps, may be missed by


def planned(robot: Robot, dynamics: ReducedDynamics) -> tuple[HorizonPlan, Array]:
    """Return a plan along a figure-eight, and where it starts."""
    reference = reference_by_name(robot, "eight")
    state = reference(BEGIN)
    q, nu = configuration_along(robot, state), reference_rates(robot, state).nu
    planning = Planning(Planner(Horizon(), dynamics))
    plan = planning(reference, Asked(BEGIN, q, nu, 0.0, np.zeros(robot.dof))).plan
    assert plan is not None
    return plan, q


def followed(
    dynamics: ReducedDynamics, plan: HorizonPlan, q: Array, duration: float, sees: bool
) -> tuple[Array, Array]:
    """Return q and ν of a robot that does what it is told for a time (s)."""
    follower = Follower(dynamics.robot)
    follower.begin(BEGIN, np.zeros(dynamics.robot.dof))
    for t in (BEGIN + STEP * np.arange(round(duration / STEP))).tolist():
        command = follower(plan, t, q if sees else None)
        middle = command.nu_d + 0.5 * STEP * command.nu_d_dot
        q = pin.integrate(dynamics.robot.model, q, STEP * dynamics.basis(q) @ middle)
    return q, command.nu_d + STEP * command.nu_d_dot


def test_a_plan_says_where_it_leads() -> None:
    """Its accelerations in small steps come to the same state."""
    car = rpctl.load("car")
    dynamics = ReducedDynamics(car)
    plan, start = planned(car, dynamics)
    assert plan.feedback is not None
    c = plan.feedback.motion
    np.testing.assert_allclose((c[0] + 0.1 * (c[1] + 0.1 * c[2]))[:-1], c[0, 1:], atol=1e-12)
    q, nu = followed(dynamics, plan, start, 0.5, sees=False)
    joints = car.joint_position(q, car.drive.steered[0].joint), *car.joint_positions(q)
    np.testing.assert_allclose([*car.base_pose(q), *joints, *nu], c[0, 5], atol=1e-4)
    np.testing.assert_allclose(followed(dynamics, plan, start, 0.5, sees=True)[0], q, atol=1e-3)


@pytest.mark.parametrize("name", cells(["paper", "car", "omni"], ["car", "omni"]))
def test_a_robot_beside_its_plan_comes_back(name: str) -> None:
    robot = rpctl.load(name)
    dynamics = ReducedDynamics(robot)
    plan, start = planned(robot, dynamics)
    assert plan.feedback is not None
    beside = start.copy()
    beside[:2] += 0.04, -0.03
    q, nu = followed(dynamics, plan, beside, 1.9, sees=True)
    wanted = plan.feedback.motion[0, 19]
    assert np.hypot(*(robot.base_pose(q) - wanted[:3])[:2]) < 0.015  # of 50 mm
    np.testing.assert_allclose(nu, wanted[-robot.dof :], atol=0.06)
    q, _ = followed(dynamics, plan, beside, 1.9, sees=False)
    assert np.hypot(*(robot.base_pose(q) - wanted[:3])[:2]) > 0.03


def test_what_a_plan_allows_is_not_exceeded(paper: Robot) -> None:
    dynamics = ReducedDynamics(paper)
    plan, start = planned(paper, dynamics)
    assert plan.feedback is not None
    start[:2] += 50.0, -50.0
    follower = Follower(paper)
    follower.begin(BEGIN, np.zeros(4))
    found = np.abs(follower(plan, BEGIN, start).nu_d_dot)
    assert (found <= plan.feedback.largest).all()
    assert found[:2].max() == plan.feedback.largest[:2].max()


def test_a_robot_far_past_its_samples_gains_no_speed(paper: Robot) -> None:
    """ν_d beside the plan's is what corrections add up to, of a step at most."""
    plan, start = planned(paper, ReducedDynamics(paper))
    start[0] += 0.1
    follower = Follower(paper)
    follower.begin(BEGIN - 30.0, np.zeros(4))
    follower(plan, BEGIN, start)
    assert plan.feedback is not None
    assert (np.abs(follower.beside) <= 0.1 * 2.0 * plan.feedback.largest).all()
    assert np.abs(follower.beside[:2]).max() > 0.1


def test_the_delay_to_expect_is_one_that_few_exceed() -> None:
    delays = Delays()
    assert delays.expected == 0.0
    for k in range(40):
        delays.add(0.01 * (k % 20 + 1))
    assert delays.expected == pytest.approx(0.16)
    assert delays.largest == pytest.approx(0.2)


def track(robot: Robot, law: Horizon, duration: float, plant: Plant) -> Run:
    return rpctl.track(
        robot, "line", duration=duration, kinematic=law, plant=plant,
        control_period=0.01, plant_step=0.01, collisions=False,
    )  # fmt: skip


def test_bounds_hold_between_old_plans(paper: Robot) -> None:
    """Of an obstacle on the way, and of wheels and motors that are just quick enough."""
    disc, robot = Disc(0.9, 0.05, 0.3), limited(paper, effort=0.6, speed=0.6)
    law = Horizon(base_obstacles=(disc,), base_radius=0.3)
    runs = [track(robot, law, duration, OLD) for duration in (6.5, 1.5)]
    summary, log = summarize(runs[0]), runs[0].log
    assert disc.distance(log.base[:, :2]).min() > 0.3 - CLOSE
    assert log.base[-1, 0] > 1.5  # beyond it
    assert summary.limits_violated == ()
    report = summary.kinematic_report
    assert report["fallbacks"] == 0
    assert report["largest_delay"] == pytest.approx(0.05)
    assert 0.05 < report["largest_age"] <= 0.11
    assert any("plans of the horizon law took up to 50 ms" in note for note in runs[0].notes)
    again = runs[1].log.tau[:-1]  # each run has the same numbers
    np.testing.assert_array_equal(log.tau[: len(again)], again)


def test_what_is_corrected_meanwhile_is_not_corrected_twice(paper: Robot) -> None:
    """Plans that take .2 s begin where feedback will have brought the robot by then."""
    run = rpctl.track(
        paper, "eight", duration=4.0, initial_error=(0.05, -0.05, -0.05), kinematic=Horizon(),
        control_period=0.01, plant_step=0.01, plant=Plant(computing_time=0.2), collisions=False,
    )  # fmt: skip
    assert np.abs(run.log.e[300:, :2]).max() < 0.02
