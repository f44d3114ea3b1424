"""Somebody pushes and pulls the robot: its motion, its energy and its ground know of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import PaperDynamic, Plant, ReducedDynamics, Robot, RpctlError, summarize, track
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.dynamics.reduced import outside_at
from rpctl.errors import UnknownNameError
from rpctl.simulation.plants.interfaces import pushes
from rpctl.simulation.plants.rolling import RollingMotion, SlippingMotion
from rpctl.simulation.plants.settings import Slipping, Wrench
from tests.robots import SET_A, add_losses, ball, platform, write

MASS = SET_A["m_c"] + 2.0 * SET_A["m_w"]


@pytest.fixture
def standing(tmp_path: Path) -> Robot:
    """The platform on two casters, before and behind."""
    casters = ball(0.8) + ball(-0.4, name="hind")
    return rpctl.load(write(tmp_path, platform(SET_A, extra=casters)))


def test_a_pull_against_damping_ends_at_a_steady_speed(standing: Robot) -> None:
    """2 d v/r² = F; then what it does in a second is what damping takes in it."""
    d, force, r = 0.4, 30.0, SET_A["r"]
    lossy = add_losses(standing, dict.fromkeys(standing.actuators, d), {})
    dynamics = ReducedDynamics(lossy)
    motion = RollingMotion(dynamics, lossy.configuration(), 0.02)
    pull = (Wrench("base", (force, 0.0, -5.0)),)
    motion.advance(np.zeros(2), 10.0, pull)
    steady = force * r * r / (2.0 * d)
    assert motion.nu[0] == pytest.approx(steady, rel=3e-5)
    step = motion.advance(np.zeros(2), 1.0, pull)
    assert step.work == pytest.approx(force * steady, rel=3e-5)
    assert step.lost == pytest.approx(step.work, rel=3e-5)


def test_what_a_push_does_to_a_robot_on_tyres_is_work(standing: Robot) -> None:
    """Force times way, and moment times turn."""
    q = standing.configuration()
    motion = SlippingMotion(standing, Slipping(), 0.7, q, 0.002)
    step = motion.advance(np.zeros(2), 0.1, (Wrench("base", (40.0, 0.0, 0.0)),))
    assert step.work == pytest.approx(40.0 * (motion.q[0] - q[0]), rel=1e-3)
    assert step.work > 0.01


def test_the_ground_holds_against_a_push(standing: Robot) -> None:
    """Of a robot at rest: its force and loads balance push and weight about P, by hand."""
    dynamics = ReducedDynamics(standing)
    q, force, moment = standing.configuration(1.0, -2.0, 0.7), (6.0, 9.0, -20.0), (2.0, -3.0, 0.0)
    outside = outside_at(dynamics, q, [Wrench("ball", force, moment)])
    hold = -dynamics.at(q).S.T @ outside.push
    tau = dynamics.efforts(q, hold)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    found = ground_reaction(dynamics, contacts, q, np.zeros(2), tau, outside)
    np.testing.assert_allclose(found.force, [-6.0, -9.0, MASS * 9.81 + 20.0], rtol=1e-9)
    cos, sin = math.cos(0.7), math.sin(0.7)
    turned = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local = turned @ moment + np.cross([0.8, 0.0, 0.05], turned @ force)
    ahead, left = found.load @ contacts.points  # moments of the loads about the root link
    np.testing.assert_allclose(left + local[0], 0.0, atol=1e-9)
    weight = SET_A["m_c"] * SET_A["d"] * 9.81
    np.testing.assert_allclose(-ahead + local[1] + weight, 0.0, atol=1e-9)


@pytest.mark.parametrize("lossy", [False, True])
def test_the_work_of_a_push_enters_the_balance(paper: Robot, lossy: bool) -> None:
    """What came in is what it stored and lost; before and after the push its ground is unmoved."""
    robot = add_losses(paper, dict.fromkeys(paper.entries, 0.3), {}) if lossy else paper
    tool = robot.end_effector or ""
    plant = Plant(
        wrenches=(Wrench(tool, (20.0, -10.0, -15.0), (0.0, 0.0, 1.0), start=0.05, end=0.1013),)
    )
    law = PaperDynamic()
    run, plain = (
        track(robot, "line", duration=0.16, plant=p, dynamic=law, collisions=False)
        for p in (plant, None)
    )
    assert summarize(run).energy_residual < (1e-4 if lossy else 1e-6)
    assert run.log.work[-1] > plain.log.work[-1] + 0.005
    np.testing.assert_array_equal(run.q[:26], plain.q[:26])
    assert np.abs(run.q[30] - plain.q[30]).max() > 1e-5
    weight = run.log.contact_load.sum(axis=1) - plain.log.contact_load.sum(axis=1)
    np.testing.assert_allclose(weight[:25], 0.0, atol=1e-6)
    np.testing.assert_allclose(weight[26:50], 15.0, atol=0.2)


def test_pushes_begin_and_end_between_samples() -> None:
    one, two = Wrench("a", start=0.001, end=0.0035), Wrench("b", start=0.0035)
    found = list(pushes((one, two), 0.0, 0.005))
    durations, acting = zip(*found, strict=True)
    np.testing.assert_allclose(durations, [0.001, 0.0025, 0.0015])
    assert acting == ((), (one,), (two,))
    ((duration, nobody),) = pushes((), 1.0, 0.1)
    assert duration == pytest.approx(0.1)
    assert nobody == ()


def test_a_push_is_on_a_link_and_ends_after_it_begins(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="the push on a lasts from 2 to 1 s"):
        Wrench("a", start=2.0, end=1.0)
    with pytest.raises(RpctlError, match="the force on a is"):
        Wrench("a", (math.inf, 0.0, 0.0))
    with pytest.raises(UnknownNameError, match="link 'hook' is not known"):
        track(
            paper, "line", duration=0.01, plant=Plant(wrenches=(Wrench("hook"),)), collisions=False
        )
