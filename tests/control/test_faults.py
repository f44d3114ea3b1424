"""What real robots give: clocks that are set, poses that jump, stops, and motors that fail."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import rpctl
from rpctl import Controller, Guards, ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.safeguards import Watchdog
from rpctl.control.sampling import JumpWatch, SampleReader
from rpctl.control.transition import Stop, Transition
from rpctl.errors import RpctlError
from rpctl.reference.load import load_reference
from rpctl.reference.motion import configuration_along
from tests.control.simulated import PERIOD, Simulated
from tests.grids import cells

RIGHT = 1  # number of the right wheel's motor


def started(robot: Robot, seconds: float, guards: Guards | None = None) -> Simulated:
    simulated = Simulated(Controller(robot, "eight", guards=guards))
    simulated.run(seconds)
    return simulated


def test_one_wrong_time_costs_one_sample(paper: Robot) -> None:
    """It was followed, with the reference a thousand seconds on, and all samples then refused."""
    robot = started(paper, 0.5)
    robot.run(PERIOD, lambda t, q, nu: (t + 1000.0, q, nu))
    assert robot.outputs[-1].status == "held"
    assert "1000 s later than the sample before: the clock was set" in robot.outputs[-1].reason
    robot.run(1.0)
    report = robot.controller.report()
    assert (report["held"], report["clock_changes"]) == (1, 0)
    assert robot.largest_jump(10) < 0.01
    assert np.abs(robot.error()).max() < 3e-3


@pytest.mark.parametrize("shift", [1000.0, -50.0])
def test_a_clock_that_is_set_is_taken_anew(paper: Robot, shift: float) -> None:
    robot = started(paper, 0.5)
    robot.run(1.0, lambda t, q, nu: (t + shift, q, nu))
    report = robot.controller.report()
    assert (report["held"], report["stopped"], report["clock_changes"]) == (2, 0, 1)
    assert robot.outputs[-1].status == "ok"
    assert robot.largest_jump(10) < 0.01
    assert np.abs(robot.error()).max() < 3e-3  # the reference goes on as if nothing had been


def test_the_clock_by_paper_and_pencil(paper: Robot) -> None:
    reader = SampleReader(paper, 0.1)
    q, nu = paper.configuration(), np.zeros(paper.dof)
    given = [7.0, 7.1, 7.1, 7.15, 9.0, 7.3, 3.0, 3.1, 3.2, 3.3]
    wrong, times = [], []
    for t in given:
        sample = reader.read(t, q, nu)
        wrong.append(isinstance(sample, str))
        times.append(reader.time)
    #        first | same: held, a period | not later than that | ahead | on | back, back, taken
    assert wrong == [False, False, True, True, True, True, True, True, False, False]
    np.testing.assert_allclose(times, 7.0 + 0.1 * np.arange(10))
    assert reader.clock_changes == 1


def test_a_pause_stops_on_the_way_and_a_resumed_reference_starts_smoothly(paper: Robot) -> None:
    """It was 1.46 m behind, and efforts jumped by twice their limit."""
    robot = started(paper, 2.0)
    before, way = robot.q[:2].copy(), 0.5 * float(robot.nu[0])  # ½ v for a second's stop
    robot.controller.pause()
    robot.run(1.2)
    assert np.abs(robot.nu).max() < 2e-3
    assert math.dist(robot.q[:2], before) == pytest.approx(way, rel=0.02)
    assert {o.reason for o in robot.outputs[1000:]} == {"paused"}
    stood = robot.q.copy()
    robot.run(0.4)
    np.testing.assert_allclose(robot.q, stood, atol=5e-4)
    robot.controller.resume()
    robot.run(5.5)
    assert robot.outputs[-1].status == "ok"
    assert robot.largest_jump(10) < 0.05
    # Paused for 1.6 s; the first second of the reference's time passes at half its pace.
    assert np.abs(robot.error(robot.t - 2.1)).max() < 5e-3
    assert robot.controller.report()["paused"] == 800


def test_motors_that_are_off_teach_nothing(paper: Robot) -> None:
    robot = started(paper, 1.0)
    kernel = robot.controller._both.kernel
    assert kernel is not None
    assert kernel._d is not None
    learnt = kernel._d.copy()
    robot.controller.pause(motors_off=True)
    robot.run(0.5, arriving=np.zeros_like)
    assert all((output.efforts == 0.0).all() for output in robot.outputs[500:])
    np.testing.assert_array_equal(kernel._d, learnt)
    robot.controller.resume()
    robot.run(PERIOD)
    np.testing.assert_array_equal(kernel._d, learnt)
    robot.run(3.0)
    assert robot.largest_jump(502) < 0.1  # its arm and base coast
    # It coasts on: the reference goes on about as fast, and 0.5 s later than it would have.
    assert np.abs(robot.error(robot.t - 0.6)).max() < 0.1


def test_bad_samples_move_no_motor_that_is_off(paper: Robot) -> None:
    """Neither the efforts of before go on, nor are there any that brake."""
    robot = started(paper, 1.0)
    robot.controller.pause(motors_off=True)
    robot.run(0.3, lambda t, q, nu: (t, q * np.nan, nu), arriving=np.zeros_like)
    assert all((output.efforts == 0.0).all() for output in robot.outputs[500:])
    assert {output.status for output in robot.outputs[500:]} == {"stopped"}


def test_what_brakes_held_is_held_before_the_first_sample_after_motors_were_off() -> None:
    """TIAGo's torso sank: zeros had been sent for long, and it was taken to have fallen."""
    tiago = rpctl.load("tiago", lock=["arm_*", "head_*"])
    controller, dynamics = Controller(tiago, "eight", period=PERIOD), ReducedDynamics(tiago)
    q, nu = tiago.configuration_at(np.zeros(3), tiago.home), np.zeros(tiago.dof)
    hold = dynamics.efforts(q, dynamics.bias(q, nu))
    controller.step(0.0, q, nu)
    controller.pause(motors_off=True)
    for k in range(1, 100):
        controller.step(k * PERIOD, q if k < 50 else q * np.nan, nu)
    controller.resume()
    for k in range(100, 110):
        output = controller.step(k * PERIOD, q * np.nan, nu)
        assert output.status == "stopped"
    np.testing.assert_allclose(output.efforts, hold, atol=1e-3 * np.abs(hold).max())


def test_a_pause_takes_over_from_motors_that_were_off_and_from_a_pose_that_jumps(
    paper: Robot,
) -> None:
    robot = started(paper, 1.0)
    robot.controller.pause(motors_off=True)
    robot.run(0.2, arriving=np.zeros_like)
    robot.controller.pause()
    robot.run(1.5)
    assert np.abs(robot.nu).max() < 2e-3
    stood = robot.q.copy()
    robot.run(0.4, lambda t, q, nu: (t, q + np.array([0.3, *[0.0] * (paper.nq - 1)]), nu))
    np.testing.assert_allclose(robot.q, stood, atol=5e-4)


def test_another_reference_is_come_to_smoothly(paper: Robot) -> None:
    robot = started(paper, 1.0)
    robot.controller.set_reference("line")
    robot.run(3.0)
    assert robot.largest_jump(10) < 0.15  # its arm moves, and this reference's does not
    assert robot.controller.reference(0.0).twist[2] == 0.0
    with pytest.raises(RpctlError, match="no reference"):
        robot.controller.set_reference("no reference")
    robot.controller.pause()
    robot.controller.set_reference("circle")
    robot.run(1.2)
    assert (robot.outputs[-1].status, robot.outputs[-1].reason) == ("stopped", "paused")
    assert np.abs(robot.nu).max() < 2e-3
    robot.controller.resume()
    robot.run(2.0)
    way = robot.controller._following.now
    assert isinstance(way, Transition)
    # Of the circle, which starts softly itself, from its time 0 on.
    assert way.time(robot.t)[0] == pytest.approx(2.0, abs=0.01)


def test_a_pose_that_jumps_is_let_in_slowly(paper: Robot) -> None:
    """Efforts jumped by 76 % of a limit."""
    robot = started(paper, 1.0)
    robot.run(4.5, lambda t, q, nu: (t, q + np.array([0.3, *[0.0] * (paper.nq - 1)]), nu))
    assert robot.controller.report()["jumps"] == 1
    assert robot.largest_jump(10) < 0.02
    corrected = robot.q.copy()
    corrected[0] += 0.3
    robot.q = corrected
    assert np.abs(robot.error()[:2]).max() < 0.02


def test_a_jump_by_paper_and_pencil() -> None:
    watch, ahead = JumpWatch(), [1.0, 0.0]
    assert not watch.jumps(0.0, [7.0, 0.0, *ahead])
    assert not watch.jumps(0.1, [7.1, 0.0, *ahead])  # 1 m/s
    assert not watch.jumps(0.2, [7.4, 0.0, *ahead])  # .3 of .05 + .1 (2 · 1 + 1) = .35
    assert watch.jumps(0.3, [7.4, 0.76, *ahead])  # .76 of .05 + .1 (2 · 3 + 1) = .75
    watch = JumpWatch()
    for k, turned in enumerate((3.1, -3.1)):  # 5° on, across π: .83 rad/s
        assert not watch.jumps(0.1 * k, [0.0, 0.0, math.cos(turned), math.sin(turned)])
    turned = -3.1 + 0.33  # of .05 + .1 (2 · .83 + 1) = .32
    assert watch.jumps(0.2, [0.0, 0.0, math.cos(turned), math.sin(turned)])


@pytest.mark.parametrize("tells", cells([False, True], slow=[False]))
def test_a_dead_wheel_ends_in_a_stop_and_leaves_the_arm_alone(paper: Robot, tells: bool) -> None:
    """The arm went at 5.95 rad/s of 2, status "ok"."""
    robot = started(paper, 3.0)

    def dead(tau: Array) -> Array:
        return np.where(np.arange(len(tau)) == RIGHT, 0.0, tau)

    fastest = 0.0
    for _ in range(40):
        robot.run(0.2, arriving=dead, tells=tells)
        fastest = max(fastest, float(np.abs(robot.nu[2]) / paper.velocity_limits[2]))
    assert fastest < 1.0  # of its limit
    assert {output.status for output in robot.outputs[-100:]} == {"lost"}
    assert "at its limits for 2 s" in robot.outputs[-1].reason
    assert "controller braked it: at its limits for 2 s" in robot.controller.notes()[-1]
    # With its left wheel at rest it may roll round on the dead one, which nothing brakes.
    rates = robot.dynamics.actuation(robot.q).T @ robot.nu
    assert abs(rates[0]) < 0.1
    assert np.abs(rates[2:]).max() < 0.1
    robot.controller.resume()
    robot.run(10.0)
    assert robot.outputs[-1].status == "ok"
    assert robot.largest_jump(5510) < 0.05


def test_efforts_that_do_not_arrive_teach_only_the_others(paper: Robot) -> None:
    """The arm's motor is dead: its own d stays, and the base learns that the arm does not turn."""

    def learnt(tells: bool) -> Array:
        robot = started(paper, 0.5)
        robot.run(0.5, arriving=lambda tau: np.where(np.arange(4) == 2, 0.0, tau), tells=tells)
        kernel = robot.controller._both.kernel
        assert kernel is not None
        assert kernel._d is not None
        return np.abs(kernel._d)

    told, silent = learnt(True), learnt(False)
    assert told[2] < 1e-3 * silent[2]
    assert told[1] > 1e-2


def test_what_a_robot_tells_raises_nothing(paper: Robot) -> None:
    robot = started(paper, 0.1)
    for told in (np.full(4, np.nan), np.zeros(3), "none", [object()] * 4, 10**400):
        output = robot.controller.step(robot.t, robot.q, robot.nu, applied=told)  # type: ignore[arg-type]
        assert output.status == "ok"
        assert np.isfinite(output.efforts).all()
        robot.t += PERIOD


def test_efforts_keep_their_rate(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight", guards=Guards(effort_rate=20.0)), (0.5, 0.3, 0.5))
    robot.run(5.0)
    assert robot.largest_jump() == pytest.approx(20.0 * PERIOD)  # of the limit
    free = Simulated(Controller(paper, "eight"), (0.5, 0.3, 0.5))
    free.run(0.1)
    assert free.largest_jump() > 0.1
    assert np.abs(robot.error()).max() < 0.02


def test_efforts_leap_at_first_and_where_motors_go_off_only(paper: Robot) -> None:
    """By paper and pencil: 100 limits/s are a fifth of a limit in 2 ms."""
    limits, signs = paper.effort_limits, itertools.cycle([1.0, -1.0])
    q, nu = paper.configuration(), np.zeros(4)
    robot = Controller(paper, "eight", dynamic=lambda *_: next(signs) * limits)
    sent = [robot.step(k * PERIOD, q, nu).efforts / limits for k in range(3)]
    sent.append(robot.step(3 * PERIOD, np.nan * q, nu).efforts / limits)  # held
    robot.pause(motors_off=True)
    sent.append(robot.step(4 * PERIOD, q, nu).efforts / limits)
    robot.resume()
    sent.append(robot.step(5 * PERIOD, q, nu).efforts / limits)
    expected = [1.0, 0.8, 1.0, 1.0, 0.0, -0.2]
    np.testing.assert_allclose(sent, np.outer(expected, np.ones(4)), atol=1e-12)


def test_a_lost_robot_by_paper_and_pencil() -> None:
    watchdog = Watchdog(2.0)
    falling = [(0.0, 1.0), (1.0, 0.9), (2.9, 0.9), (3.1, 0.9)]  # nearer at 1 s, and then not
    assert [watchdog.lost(t, True, e) for t, e in falling] == [False, False, False, True]
    assert not watchdog.lost(4.0, False, 0.9)
    assert not watchdog.lost(5.0, True, 0.9)
    assert not watchdog.lost(6.9, True, 2.0)
    assert not watchdog.lost(7.1, True, 0.29)  # near enough
    assert not watchdog.lost(7.2, True, 0.9)


@pytest.mark.parametrize("kind", ["transition", "stop"])
def test_rates_of_what_is_followed_are_those_of_its_positions(
    paper: Robot, kind: str, rng: np.random.Generator
) -> None:
    """By central differences; those of a base that is still beside its reference but for that."""
    eight = load_reference(paper, "eight")
    arm = np.array([0.0, 0.0, 0.0, 0.3, -0.1])
    pose, twist = rng.normal(size=3), np.array([0.7, 0.0, -0.9])
    followed = (
        Transition(eight, 2.0, 5.0, 0.2, 1.0, arm, 1.5)
        if kind == "transition"
        else Stop(2.0, pose, twist, rng.normal(size=2), rng.normal(size=2))
    )
    step = 1e-5
    for t in rng.uniform(2.01, 4.0, size=20):
        before, at, after = (followed(t + each) for each in (-step, 0.0, step))
        heading = at.pose[2]
        rate = (after.pose - before.pose) / (2.0 * step)
        cos, sin = math.cos(heading), math.sin(heading)
        own = [cos * rate[0] + sin * rate[1], cos * rate[1] - sin * rate[0], rate[2]]
        np.testing.assert_allclose(at.twist, own, atol=1e-8)
        for whole, derivative in (("twist", "twist_dot"), ("joints", "joint_rates"),
                                  ("joint_rates", "joint_accelerations")):  # fmt: skip
            change = getattr(after, whole) - getattr(before, whole)
            np.testing.assert_allclose(getattr(at, derivative), change / (2.0 * step), atol=1e-7)
    begins = followed(2.0)
    if kind == "transition":
        np.testing.assert_allclose(begins.pose, eight(5.0).pose)
        np.testing.assert_allclose(begins.joints, eight(5.0).joints + arm[3:])
        np.testing.assert_allclose(begins.twist, 0.2 * eight(5.0).twist)
        end = followed(4.0)  # 1 s at the mean of both paces, then 1 s at the last
        np.testing.assert_allclose(end.pose, eight(6.6).pose)
        np.testing.assert_allclose(end.joints, eight(6.6).joints)
    else:
        np.testing.assert_allclose(begins.pose, pose)
        np.testing.assert_allclose(followed(9.0).twist, 0.0)


def test_a_limit_that_binds_no_more_for_a_moment_saves_no_robot() -> None:
    """Its wheel swung from one limit to the other, and each time it counted as free."""
    watchdog = Watchdog(2.0)  # at 10 Hz, free each fifth time
    told = [watchdog.lost(0.1 * k, k % 5 != 4, 0.5) for k in range(30)]
    assert told.index(True) == 21
    watchdog = Watchdog(2.0)
    assert not any(watchdog.lost(0.1 * k, k % 5 < 2, 0.5) for k in range(30))


def test_a_lost_base_is_braked_and_the_laws_have_the_arm(paper: Robot) -> None:
    """A robot that is held needs no effort to brake its base, and its arm resists what holds it."""
    controller = Controller(paper, "eight", period=0.01)
    state = controller.reference(0.0)
    q, nu = configuration_along(paper, state, np.asarray(state.pose)), np.zeros(paper.dof)
    outputs = [controller.step(0.01 * k, q, nu) for k in range(800)]
    assert outputs[-1].status == "lost"
    np.testing.assert_allclose(outputs[-1].efforts[:2], 0.0, atol=1e-9)
    assert np.abs(outputs[-1].efforts[2:] / paper.effort_limits[2:]).min() > 1e-3
