"""Rates that nobody measures well, and efforts that act late: the state that laws are given."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Controller, Plant, ReducedDynamics, Robot, VelocityOutput
from rpctl.arrays import Array
from rpctl.control import estimation
from rpctl.control.estimation import WINDOW, LatticeWatch, StateEstimate
from rpctl.control.sampling import MeasuredSample
from rpctl.dynamics.motion import step
from rpctl.errors import DiffersError, RpctlError, UnknownNameError
from rpctl.simulation.config import Config
from rpctl.simulation.loop.backend import refusal
from tests.catalogue import robot_of
from tests.control.simulated import PERIOD, Simulated
from tests.grids import cells

BIT12 = 2.0 * math.pi / 4096  # rad
DELAY = 0.05  # s


class Late:
    """Makes efforts arrive so many periods late."""

    def __init__(self, periods: int, first: Array) -> None:
        self._sent = deque([first] * periods)

    def __call__(self, tau: Array) -> Array:
        self._sent.append(tau)
        return self._sent.popleft()


def late(robot: Robot, delay: float = DELAY) -> Late:
    return Late(round(delay / PERIOD), np.zeros(len(robot.actuators)))


def fast(**settings: Any) -> dict[str, Any]:
    """Return the default laws, of joints at 7.2 Hz, and settings."""
    config = Config().with_bandwidth(7.2)
    return {"kinematic": config.kinematic, "dynamic": config.dynamic, **settings}


def hidden(*kept: int) -> Callable[[float, Array, Array], tuple[float, Array, Array]]:
    """Return what measures no rates but those of some indices."""

    def measure(t: float, q: Array, nu: Array) -> tuple[float, Array, Array]:
        found = np.full_like(nu, math.nan)
        found[[*kept]] = nu[[*kept]]
        return t, q, found

    return measure


@pytest.mark.parametrize("kept", [(), (0, 1), (2, 3)], ids=["none", "base's", "arm's"])
def test_a_robot_that_lacks_rates_tracks(paper: Robot, kept: tuple[int, ...]) -> None:
    """Each sample was bad, and the robot was braked."""
    robot = Simulated(Controller(paper, "eight"))
    robot.run(1.2, hidden(*kept))
    assert {output.status for output in robot.outputs} == {"ok"}
    assert robot.controller.report()["estimated"] == len(robot.outputs)
    assert np.abs(robot.error()).max() < 2e-3
    assert robot.largest_jump(1) < 0.1
    assert any("they were missing" in note for note in robot.controller.notes())


@pytest.mark.parametrize("name", ["car", "mecanum"])
def test_the_rates_of_a_base_come_from_its_pose(name: str) -> None:
    """Steering turns as its joint does; what rolls goes as far as P does."""
    robot = robot_of(name)
    simulated = Simulated(Controller(robot, "eight", compiled=False))
    simulated.run(0.3, hidden())
    estimate = simulated.controller._measured
    assert estimate is not None
    np.testing.assert_allclose(estimate.nu, simulated.nu, atol=3e-4)
    assert np.abs(simulated.nu[0]) > 1e-3


def test_rates_of_a_robot_that_moves_are_known_after_some_samples(paper: Robot) -> None:
    """1 m/s, .5 rad/s, and joints that turn, of which the first sample tells nothing."""
    nu = np.array([1.0, 0.5, 0.4, -0.2])
    dynamics = ReducedDynamics(paper)
    q, nothing = paper.configuration(), np.zeros(4)
    estimate = StateEstimate(dynamics, PERIOD, 0.0, None, nothing, compiled=False)
    for k in range(20):
        found = estimate(MeasuredSample(k * PERIOD, q, np.full(4, math.nan)))
        q, nu, *_ = step(dynamics, q, nu, nothing, PERIOD)
        estimate.sent(k * PERIOD, nothing)
    np.testing.assert_allclose(found.nu, nu, atol=0.03)


def test_a_position_between_an_encoders_steps_is_known(paper: Robot) -> None:
    """A joint that turns on by itself at .05 rad/s is nearer to its estimate than to its count."""
    dynamics, nothing, off = ReducedDynamics(paper), np.zeros(4), []
    q, nu = paper.configuration(), np.array([0.0, 0.0, 0.05, 0.0])
    estimate = StateEstimate(dynamics, PERIOD, 0.0, None, nothing, compiled=False)
    for k in range(300):
        counted, angle = q.copy(), paper.joint_position(q, paper.joint_names[0])
        count = BIT12 * round(angle / BIT12)
        paper.set_joint(counted, paper.joint_names[0], count)
        found = estimate(MeasuredSample(k * PERIOD, counted, np.full(4, math.nan)))
        estimate.sent(k * PERIOD, nothing)
        known = paper.joint_position(found.q, paper.joint_names[0])
        off.append((abs(known - angle), abs(count - angle)))
        q, nu, *_ = step(dynamics, q, nu, nothing, PERIOD)
    estimated, counted_off = np.mean(off[100:], axis=0)
    assert estimated < 0.6 * counted_off


def test_rates_that_fail_on_the_way_are_gone_on_from(paper: Robot) -> None:
    """They are what they were, and no rest."""
    robot = Simulated(Controller(paper, "eight"))
    robot.run(1.0)
    robot.run(0.6, hidden())
    robot.run(0.6)
    assert robot.largest_jump(10) < 0.01
    assert np.abs(robot.error()).max() < 2e-3


def test_a_missing_rate_is_bad_where_rates_have_to_be_measured(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight", rates="measured", compiled=False))
    robot.run(2 * PERIOD, hidden())
    assert [output.status for output in robot.outputs] == ["held", "held"]
    robot = Simulated(Controller(paper, "eight", compiled=False))
    robot.run(PERIOD, lambda t, q, nu: (t, q * math.nan, nu))
    robot.run(PERIOD, lambda t, q, nu: (t, q, nu + math.inf))
    assert [output.status for output in robot.outputs] == ["held", "held"]


def test_a_silence_is_neither_remembered_nor_simulated(paper: Robot) -> None:
    """Of a robot whose sensors fail for 1.6 s; the memory of what was sent would grow for ever."""
    robot = Simulated(Controller(paper, "eight"))
    robot.run(0.2, hidden())
    robot.run(1.6, lambda t, q, nu: (t, q * math.nan, nu))
    memory = robot.controller._estimate
    assert memory._end - memory._first <= 502
    robot.run(0.2, hidden())
    estimate = robot.controller._measured
    assert estimate is not None
    np.testing.assert_allclose(estimate.nu, robot.nu, atol=0.02)


def test_a_pose_that_jumps_is_no_speed(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight"))
    robot.run(1.0, hidden())
    robot.q[0] += 0.3
    robot.run(0.2, hidden())
    assert robot.controller.report()["jumps"] == 1
    assert robot.largest_jump(10) < 0.1
    estimate = robot.controller._measured
    assert estimate is not None
    np.testing.assert_allclose(estimate.nu, robot.nu, atol=5e-3)


def test_speeds_are_sent_to_a_robot_that_lacks_rates(paper: Robot) -> None:
    """One that follows at once, whose rates are differences of places."""
    output = VelocityOutput()
    controller = Controller(paper, "line", output=output, compiled=False)
    dynamics, q = ReducedDynamics(paper), paper.configuration(joints={})
    q = paper.configuration_at(np.asarray(controller.reference(0.0).pose), paper.home)
    for k in range(500):
        sent = controller.step(k * PERIOD, q, np.full(4, math.nan))
        assert sent.status == "ok"
        q = dynamics.integrate(q, PERIOD * (dynamics.basis(q) @ sent.speeds))
    pose = controller.reference(500 * PERIOD).pose
    assert math.dist(paper.base_pose(q)[:2], pose[:2]) < 5e-3


def watch(robot: Robot, rates: Array) -> bool:
    """Return whether rates (n, dof), a period apart, are found to be on a lattice."""
    watching = LatticeWatch(ReducedDynamics(robot), PERIOD)
    return any(watching.takes(nu, PERIOD) for nu in rates)


def test_rates_on_a_lattice_are_told_from_smooth_from_noisy_and_from_fine_ones(
    paper: Robot,
) -> None:
    t, rng = PERIOD * np.arange(4 * WINDOW), np.random.default_rng(5)
    smooth = np.outer(np.sin(3.0 * t), [0.8, 0.5, 1.0, 0.1])
    where = np.outer(1.0 - np.cos(3.0 * t), [0.8, 0.5, 1.0, 0.1]) / 3.0
    coarse = smooth.copy()
    coarse[1:, 2] = np.diff(BIT12 * np.round(where[:, 2] / BIT12)) / PERIOD
    assert watch(paper, coarse)
    assert watch(paper, coarse.astype(np.float32))
    assert not watch(paper, smooth)
    assert not watch(paper, np.outer(t, [5.0, 5.0, 5.0, 5.0]))  # each change is the same
    assert not watch(paper, smooth + 0.05 * rng.normal(size=smooth.shape))
    assert not watch(paper, 1e-5 * np.round(smooth / 1e-5))  # as a driver writes it
    assert not watch(paper, 0.0 * smooth)


@pytest.mark.parametrize("period", [0.002, 0.01])
def test_encoders_do_not_make_efforts_leap(paper: Robot, period: float) -> None:
    """At 500 Hz they leapt by 105 % of a limit, and joints were .65 mrad off."""
    run = rpctl.track(
        paper, "eight", duration=1.5, control_period=period, plant=Plant(encoder_bits=12),
        collisions=False,
    )  # fmt: skip
    settled = run.t > 0.8
    leaps = np.abs(np.diff(run.tau[settled], axis=0)) / paper.effort_limits
    assert leaps.max() < 0.06
    assert np.abs(run.log.e[settled, 2:]).max() < 2e-3
    most = min(100.0 * period, 0.4)  # from the second sample on, found to be quantised or not
    assert (np.abs(np.diff(run.tau, axis=0)) / paper.effort_limits).max() < most + 1e-9
    assert any("they were found to be quantised" in note for note in run.notes)


@pytest.mark.parametrize("period", cells([0.002, 0.01], slow=[0.002]))
def test_encoders_do_not_make_efforts_of_a_light_wrist_leap(tiago: Robot, period: float) -> None:
    """At 500 Hz they leapt by 200 % of a limit each sample, and joints were 54 mrad off."""
    run = rpctl.track(
        tiago, "eight", duration=2.0, control_period=period, plant=Plant(encoder_bits=12),
        collisions=False,
    )  # fmt: skip
    settled = run.t > 1.0
    leaps = np.abs(np.diff(run.tau[settled], axis=0)) / tiago.effort_limits
    assert leaps.max() < 0.3
    assert np.abs(run.log.e[settled, 3:]).max() < 2e-3
    leaps = np.abs(np.diff(run.tau, axis=0)) / tiago.effort_limits
    assert leaps.max() < min(100.0 * period, 0.6) + 1e-9  # 75 % before they were found, at 500 Hz


def test_what_the_rate_of_efforts_holds_back_teaches_the_integral_nothing(paper: Robot) -> None:
    """Its joints went .11 m or rad off: what the rate lets through of pulses is their median."""
    run = rpctl.track(
        paper, "eight", duration=2.0, plant=Plant(encoder_bits=12), rates="measured", delay=0.0,
        collisions=False,
    )  # fmt: skip
    leaps = np.abs(np.diff(run.tau, axis=0)) / paper.effort_limits
    assert leaps.max() == pytest.approx(100.0 * 0.002)
    assert np.abs(run.log.e).max() < 0.01


@pytest.mark.parametrize("silence", [0.0, 1.02, 1e6])  # s
@pytest.mark.parametrize(
    ("name", "locked", "off"), [("paper", (), 1e-3), ("tiago", ("arm_[3-7]_*", "head_*"), 0.03)]
)
def test_the_foretold_motion_is_the_models(
    name: str, locked: tuple[str, ...], off: float, silence: float
) -> None:
    """Held efforts for 50 ms against the plant's own integration; TIAGo's joints have friction.

    The same after a silence of the sensors, in which efforts went on to act.
    """
    robot, rng = rpctl.load(name, lock=locked), np.random.default_rng(7)
    dynamics = ReducedDynamics(robot)
    q = robot.configuration_at(np.array([1.0, 2.0, 0.5]), robot.home)
    nu = 0.2 * rng.normal(size=robot.dof)
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, rng.normal(size=robot.dof)))
    compiled = silence > 0.0
    estimate = StateEstimate(dynamics, PERIOD, DELAY, "measured", tau, compiled)
    t = DELAY
    found = estimate(MeasuredSample(t, q, nu))
    for elapsed in (*rng.uniform(0.001, 0.02, 40), silence) if silence else ():
        estimate.sent(t, tau)
        t += elapsed
        found = estimate(MeasuredSample(t, q, nu))
    for _ in range(100):
        q, nu, *_ = step(dynamics, q, nu, tau, DELAY / 100)
    assert found.t == t
    np.testing.assert_allclose(found.nu, nu, atol=off)
    np.testing.assert_allclose(found.q, q, atol=DELAY * off)


def test_machine_code_that_differs_is_not_run(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    dynamics, nothing = ReducedDynamics(paper), np.zeros(4)
    sample = MeasuredSample(DELAY, paper.configuration(), np.array([0.3, 0.2, 0.1, -0.1]))
    known = StateEstimate(dynamics, PERIOD, DELAY, None, nothing, compiled=True)(sample)
    monkeypatch.setattr(estimation, "ROUGHLY", -1.0)
    estimation.state_kernel.cache_clear()
    with pytest.raises(DiffersError, match="moves paper otherwise than Pinocchio"):
        estimation.state_kernel(paper, efforts=True, compiled=True)
    found = StateEstimate(dynamics, PERIOD, DELAY, None, nothing, compiled=True)(sample)
    np.testing.assert_allclose(found.nu, known.nu, atol=1e-12)


@pytest.mark.parametrize("told", [0.7 * DELAY, DELAY, 1.3 * DELAY])
def test_a_told_delay_is_foretold_and_may_be_wrong(paper: Robot, told: float) -> None:
    """Untold, joints at 7.2 Hz swing by .3 rad."""
    robot = Simulated(Controller(paper, "eight", **fast(delay=told)))
    robot.run(1.5, arriving=late(paper))
    assert robot.largest_jump(100) < 0.02
    # δ of the reference's motion: it is tracked at the time at which efforts were to act.
    assert np.abs(robot.error(robot.t)).max() < 5e-3
    assert {output.status for output in robot.outputs} == {"ok"}


def test_a_delay_that_is_not_told_is_what_the_one_above_mends(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight", **fast()))
    robot.run(1.5, arriving=late(paper))
    assert np.abs(robot.error()).max() > 0.01


def test_the_integral_learns_from_the_efforts_that_acted(paper: Robot) -> None:
    """5 N·m besides on the right wheel: d = B 5/M, at once; none is learnt of the delay itself."""
    robot = Simulated(Controller(paper, "eight", delay=DELAY))
    kernel = robot.controller._both.kernel
    assert kernel is not None
    assert kernel._d is not None
    arriving, push = late(paper), np.array([0.0, 5.0, 0.0, 0.0])
    robot.run(0.5, arriving=arriving)
    assert np.abs(kernel._d).max() < 5e-3
    robot.run(1.5, arriving=lambda tau: arriving(tau) + push)
    still, q = np.zeros(4), robot.q
    expected = robot.dynamics.forward(q, still, push) - robot.dynamics.forward(q, still, 0 * push)
    np.testing.assert_allclose(kernel._d, expected, rtol=0.05, atol=5e-3)
    assert np.abs(robot.error()).max() < 0.02


def test_what_arrived_late_is_compared_with_what_was_sent_for_then(paper: Robot) -> None:
    """A robot that tells all that arrives, of efforts 50 ms old: nothing went astray."""
    robot = Simulated(Controller(paper, "eight", **fast(delay=DELAY)))
    kernel = robot.controller._both.kernel
    assert kernel is not None
    assert kernel._d is not None
    robot.run(2.0, arriving=late(paper), tells=True)
    assert np.abs(kernel._d).max() < 5e-3
    assert np.abs(robot.error()).max() < 3e-3


def test_a_dead_motor_that_is_told_teaches_nothing_behind_a_delay(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight", delay=DELAY))
    kernel = robot.controller._both.kernel
    assert kernel is not None
    assert kernel._d is not None
    arriving = late(paper)
    robot.run(1.0, arriving=arriving, tells=True)
    dead = np.array([1.0, 0.0, 1.0, 1.0])
    robot.run(0.5, arriving=lambda tau: dead * arriving(tau), tells=True)
    told = np.abs(kernel._d[:2]).max()
    untold = Simulated(Controller(paper, "eight", delay=DELAY))
    arriving = late(paper)
    untold.run(1.0, arriving=arriving)
    untold.run(0.5, arriving=lambda tau: dead * arriving(tau))
    kernel = untold.controller._both.kernel
    assert kernel is not None
    assert kernel._d is not None
    assert told < 0.3 * np.abs(kernel._d[:2]).max()


def test_a_pause_and_bad_samples_behind_a_delay(paper: Robot) -> None:
    robot = Simulated(Controller(paper, "eight", **fast(delay=DELAY)))
    arriving = late(paper)
    robot.run(1.0, arriving=arriving)
    robot.controller.pause()
    robot.run(1.2, arriving=arriving)
    assert np.abs(robot.nu).max() < 5e-3
    robot.controller.resume()
    robot.run(1.0, arriving=arriving)
    assert robot.largest_jump(10) < 0.05
    robot.run(0.9, lambda t, q, nu: (t, q * math.nan, nu), arriving=arriving)
    assert np.abs(robot.nu).max() < 0.05  # braked along the motion of when its efforts act
    assert robot.largest_jump(10) < 0.3
    robot.run(0.1, arriving=arriving)
    assert robot.outputs[-1].status == "ok"


def test_what_is_told_wrongly_is_refused(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="give dead_time of its VelocityOutput, --dead-time"):
        Controller(paper, "eight", output="velocity", delay=0.05)
    with pytest.raises(RpctlError, match="delay is -1 s; give a time from 0 to 2 s"):
        Controller(paper, "eight", delay=-1.0)
    with pytest.raises(UnknownNameError, match="'guessed' is not known"):
        Controller(paper, "eight", rates="guessed")


def test_a_told_delay_is_simulated_unless_the_plant_has_its_own(paper: Robot) -> None:
    told = Config().with_run(delay=0.05)
    assert told.delay == 0.05
    assert Config(plant=Plant(delay=0.03), run=told.run).delay == 0.03
    assert refusal(paper, told) == "the controller predicts over a delay"
    assert refusal(paper, Config().with_run(rates="estimated")) == "rates are estimated"
    run = rpctl.track(paper, "line", duration=0.2, delay=0.1, collisions=False)
    assert run.config.plant.delay == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "truth"),
    cells(
        product(("paper", "tiago", "car", "mecanum"), (0.7 * DELAY, DELAY, 1.3 * DELAY)),
        slow=[("car", 0.7 * DELAY), ("mecanum", 1.3 * DELAY)],
    ),
)
def test_every_drive_withstands_a_told_delay_with_quick_joints(name: str, truth: float) -> None:
    """Untold, joints at 7.2 Hz are .3 to 1.2 rad off."""
    run = rpctl.track(
        robot_of(name), "eight", config=Config().with_bandwidth(7.2), duration=2.0,
        control_period=0.004, delay=DELAY, plant=Plant(delay=truth), collisions=False,
    )  # fmt: skip
    settled = run.t > 1.0
    assert np.abs(run.log.e[settled]).max() < 5e-3
    assert np.abs(np.diff(run.tau[settled], axis=0) / run.robot.effort_limits).max() < 0.1
