"""Stops: inelastic impacts, joints that rest, and joints that leave."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.motion import Outside
from rpctl.dynamics.stops import Stops, pivot, stopped, stopping_step
from tests.mechanisms import ELBOW_M, load_lift, load_two_bars
from tests.random_robots import random_robot
from tests.robots import write

DT = 0.002  # s
GRAVITY = 9.81  # m/s²
NONE = np.zeros(2)


def run(
    robot: Robot, q: Array, nu: Array, tau: Array, steps: int, outside: Outside | None = None
) -> list[tuple[Array, Array, Array]]:
    """Return q, ν, work and loss after each step."""
    dynamics, stops = ReducedDynamics(robot), Stops(robot)
    found: list[tuple[Array, Array, Array]] = []
    work = lost = 0.0
    for _ in range(steps):
        done = stopping_step(dynamics, stops, (q, nu), tau, DT, outside)
        q, nu, work, lost = done.q, done.nu, work + done.work, lost + done.lost
        found.append((q, nu, np.array([work, lost])))
    return found


def test_a_lift_falls_on_its_stop_and_rests(tmp_path: Path) -> None:
    """From .3 m it takes √(2 · .3/9.81) = .2473 s, and loses m g h = 6 · 9.81 · .3 = 17.66 J."""
    robot = load_lift(tmp_path)
    fall = run(robot, robot.configuration(joints={"lift": 0.3}), np.zeros(1), np.zeros(1), 200)
    height = np.array([robot.joint_position(q, "lift") for q, *_ in fall])
    t = DT * np.arange(1, 201)
    free = t < 0.2473
    np.testing.assert_allclose(height[free], 0.3 - 0.5 * GRAVITY * t[free] ** 2, atol=1e-12)
    assert (height[~free] == 0.0).all()
    assert all(nu[0] == 0.0 for _, nu, _ in fall[124:])
    assert fall[-1][2] == pytest.approx([0.0, 6.0 * GRAVITY * 0.3], abs=1e-9)


@pytest.mark.parametrize(("force", "rises"), [(58.8, False), (58.9, True), (-5000.0, False)])
def test_a_lift_leaves_when_it_is_pushed_up(tmp_path: Path, force: float, rises: bool) -> None:
    """It weighs 58.86 N. A motor that presses it against its stop does no work."""
    robot = load_lift(tmp_path)
    q, nu, balance = run(robot, robot.configuration(), np.zeros(1), np.array([force]), 5)[-1]
    assert (robot.joint_position(q, "lift") > 0.0, nu[0] > 0.0) == (rises, rises)
    if rises:
        assert nu[0] == pytest.approx(5 * DT * (force / 6.0 - GRAVITY), rel=1e-9)
    else:
        assert balance == pytest.approx([0.0, 0.0], abs=1e-12)


def test_impulse_goes_through_an_arm(tmp_path: Path) -> None:
    """Two point masses of 1 kg, 1 m from joint to joint to end, stretched out: M = [5 2; 2 1].

    The elbow meets its stop at 1 rad/s: of its momentum the shoulder takes 2/5 rad/s, and of ½ J
    there are ½ · 5 · .4² = .4 left.
    """
    robot = load_two_bars(tmp_path, elbow=(-2.0, 0.001))
    dynamics = ReducedDynamics(robot)
    straight = robot.configuration()
    np.testing.assert_allclose(dynamics.inertia(straight), ELBOW_M, atol=1e-5)
    q, nu, balance = run(robot, straight, np.array([0.0, 1.0]), NONE, 1)[0]
    np.testing.assert_allclose(nu, [0.4, 0.0], atol=1e-5)
    assert nu[1] == 0.0
    assert robot.joint_position(q, "elbow") == pytest.approx(0.001, abs=1e-15)
    assert balance == pytest.approx([0.0, 0.1], abs=1e-5)
    assert dynamics.energy(q, nu) == pytest.approx(0.4, abs=1e-5)


# Of M = [5 2; 2 1]: speeds before, sides of stops, speeds after, impulses; all by hand.
PAIRS = [
    ((0.0, 1.0), (0, -1), (0.4, 0.0), (0.0, -0.2)),
    ((1.0, 0.0), (-1, 0), (0.0, 2.0), (-1.0, 0.0)),
    ((-1.0, 0.5), (1, 1), (0.0, 0.0), (4.0, 1.5)),  # held alone, the first would throw the second
    ((-1.0, 3.0), (1, 1), (0.0, 1.0), (1.0, 0.0)),  # here it may
    ((1.0, 0.5), (1, 1), (1.0, 0.5), (0.0, 0.0)),
]


@pytest.mark.parametrize(("before", "sides", "after", "impulse"), PAIRS)
def test_impulses_of_two_stops(
    before: tuple[float, ...], sides: tuple[int, ...], after: tuple[float, ...], impulse: Array
) -> None:
    s = np.array(sides, dtype=float)
    x, push = stopped(ELBOW_M, ELBOW_M @ np.array(before), s, NONE)
    np.testing.assert_allclose(x, np.array(after), atol=1e-14)
    np.testing.assert_allclose(push, np.array(impulse), atol=1e-14)


def test_several_stops_at_once_do_what_the_one_right_choice_of_them_does(
    rng: np.random.Generator,
) -> None:
    """Of all choices of joints that are held, one has no pull and no speed into a stop."""
    for _ in range(60):
        n = int(rng.integers(1, 7))
        A = rng.normal(size=(n, n + 1))
        M, before, s = A @ A.T, rng.normal(size=n), rng.choice([-1.0, 0.0, 1.0], n)
        x, push = stopped(M, M @ before, s, np.zeros(n))
        fitting = []
        for choice in itertools.product([False, True], repeat=n):
            held = np.array(choice) & (s != 0.0)
            y, free = np.zeros(n), ~held
            y[free] = np.linalg.solve(M[np.ix_(free, free)], (M @ before)[free])
            if (s * y >= -1e-12).all() and (s * (M @ y - M @ before) >= -1e-10).all():
                fitting.append(y)
        assert any(np.allclose(x, y, rtol=1e-8, atol=1e-10) for y in fitting)
        assert (s * push >= -1e-10).all()
        assert x @ M @ x <= before @ M @ before * (1.0 + 1e-12)


def test_one_pivot_is_wrong_by_what_it_says() -> None:
    """With both held, M = [5 2; 2 1] and m = (1, 1): the second would be pulled, so it goes."""
    found = pivot(2)(ELBOW_M.ravel(), [-1.0, 1.0], [1.0, 1.0], [1.0, 1.0])
    x, push, following, going = (np.asarray(each).ravel().tolist() for each in found)
    assert (x, push, following, going) == ([0.0, 0.0], [1.0, -1.0], [1.0, 0.0], [1.0])


@pytest.mark.parametrize("seed", range(4))
def test_energy_only_falls_and_joints_stay_within_their_stops(seed: int, tmp_path: Path) -> None:
    """Of random robots, at their stops without motors, no step gains energy."""
    rng = np.random.default_rng(seed)
    robot = rpctl.load(write(tmp_path, random_robot(rng, joints=4)))
    dynamics, stops, met = ReducedDynamics(robot), Stops(robot), 0
    limits = [(j.name, j.lower, j.upper) for j in robot.joints if math.isfinite(j.upper - j.lower)]
    for _ in range(4):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        for name, *ends in limits:
            robot.set_joint(q, name, float(rng.choice(ends)))
        whole = dynamics.energy(q, nu)
        for _ in range(25):
            done = stopping_step(dynamics, stops, (q, nu), np.zeros(len(robot.actuators)), DT)
            size = dynamics.energy(done.q, 2.0 * nu) - dynamics.energy(done.q, 0.0 * nu)
            assert done.lost >= -1e-5 * size, f"seed {seed}"
            q, nu = done.q, done.nu
            for name, lower, upper in limits:
                assert lower - 1e-9 <= robot.joint_position(q, name) <= upper + 1e-9
            met += bool(stops.sides(q, stops.ends(q)).any())
        assert dynamics.energy(q, nu) <= whole + 1e-5 * abs(whole)
    assert met


def test_what_pushes_beside_a_joint_at_its_stop(tmp_path: Path) -> None:
    """The shoulder is turned by 10 N·m, so at 10/5 rad/s².

    To take the elbow along it needs 2 · 2 N·m; it is pressed on its stop by 6.
    """
    robot = load_two_bars(tmp_path, elbow=(-2.0, 0.0))
    start, pushed = robot.configuration(), np.array([10.0, 6.0])
    q, nu, balance = run(robot, start, NONE, NONE, 10, lambda q: pushed)[-1]
    np.testing.assert_allclose(nu, [10 * DT * 2.0, 0.0], atol=1e-6)
    assert robot.joint_position(q, "elbow") == 0.0
    # The work is what the shoulder has: 10 N·m over ½ · 2 · t².
    assert balance == pytest.approx([10.0 * (10 * DT) ** 2, 0.0], abs=1e-6)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_joint_that_begins_beyond_its_stop_may_only_come_back(
    side: float, tmp_path: Path
) -> None:
    """0.1 rad beyond ±1 and pressed on: it stays; drawn back, it does not go as far again."""
    robot = load_two_bars(tmp_path, elbow=(-1.0, 1.0))
    out, back = np.array([0.0, 2.0 * side]), np.array([0.0, -2.0 * side])
    q, nu, balance = run(robot, robot.configuration(joints={"elbow": 1.1 * side}), NONE, out, 5)[-1]
    assert robot.joint_position(q, "elbow") == pytest.approx(1.1 * side, abs=1e-12)
    assert nu[1] == 0.0
    assert balance[1] == pytest.approx(0.0, abs=1e-12)
    drawn, _, _ = run(robot, q, nu, back, 5)[-1]
    inner = abs(robot.joint_position(drawn, "elbow"))
    assert 1.0 < inner < 1.1 - 5e-5
    again, _, _ = run(robot, drawn, NONE, out, 50)[-1]
    assert abs(robot.joint_position(again, "elbow")) == pytest.approx(inner, abs=1e-9)
