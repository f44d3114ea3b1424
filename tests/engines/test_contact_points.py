"""Whose contact points are, and how fast a wheel's moves over the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rpctl
from rpctl.arrays import Array
from rpctl.description.records import rotation
from rpctl.engines.contact_points import LinkMotion, NamedContacts, wheel_slip
from rpctl.engines.engine import EngineFault
from rpctl.engines.rollers import refuse_rollers
from rpctl.engines.silence import captured
from rpctl.engines.switches import ALL_DEFAULT, ALL_MENDED, MENDED
from rpctl.engines.tie_rods import (
    BANDWIDTH,
    STABLE,
    TieRodPulls,
    follower_inertia,
    tie_rod_efforts,
)
from rpctl.robot.model import Robot

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def paper() -> Robot:
    return rpctl.load("paper")


def test_loads_go_to_the_wheel_or_the_nearest_support(paper: Robot) -> None:
    named = NamedContacts(paper)
    assert named.names == ("wheel_left_joint", "wheel_right_joint", "base_link")
    turn = rotation(UP, 0.5 * np.pi)
    frames = {"base_link": (turn, np.array([1.0, 2.0, 0.0]))}
    ball = np.array([1.0, 2.78, 0.0])  # .78 m ahead of a robot that looks along y
    points = [
        ("wheel_left_link", np.zeros(3), 100.0),
        ("wheel_left_link", np.ones(3), 20.0),
        ("base_link", ball, 150.0),
        ("base_link", np.array([1.0, 1.6, 0.0]), 7.0),  # the hull drags: nobody's
        ("arm_rail_link", ball, 9.0),
    ]
    assert named.loads(points, frames).tolist() == [120.0, 0.0, 150.0]


def motion(v: Array, omega: Array, turn: float = 0.0) -> LinkMotion:
    return LinkMotion(rotation(UP, turn), np.zeros(3), v, omega)


def test_a_wheel_that_rolls_does_not_slip_and_one_that_does_not_turn_drags(paper: Robot) -> None:
    left = paper.drive.wheels[0]  # radius .15, axle y
    heading = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    axle = np.cross(UP, heading)
    rolls = motion(0.3 * heading, 2.0 * axle + 0.7 * UP, 0.3)
    assert wheel_slip(paper, left, rolls) == pytest.approx((0.0, 0.0))
    assert wheel_slip(paper, left, motion(0.3 * heading, np.zeros(3), 0.3))[0] == pytest.approx(0.3)
    spins = motion(np.zeros(3), 2.0 * axle, 0.3)
    assert wheel_slip(paper, left, spins)[0] == pytest.approx(-0.3)
    slides = motion(0.2 * axle, np.zeros(3), 0.3)
    assert wheel_slip(paper, left, slides) == pytest.approx((0.0, 0.2))


def test_only_rollers_that_are_to_be_mended_are_refused() -> None:
    mecanum = rpctl.load("mecanum")
    refuse_rollers(mecanum, ALL_DEFAULT, "Drake")
    with pytest.raises(EngineFault, match="mecanum is not compared in Drake: it has no rollers"):
        refuse_rollers(mecanum, ALL_MENDED, "Drake")


SHORT = 1e-4  # s: a step at which tie rods are as stiff as they get


def test_rods_that_are_not_mended_add_nothing() -> None:
    """Losses may be mended alone: the swivels of a car are then left to its motors."""
    car = rpctl.load("car")
    leader, follower = car.drive.steered[0].joint, car.drive.followers[0].joint
    q, efforts = car.configuration(), {leader: 1.0}
    astray = {leader: (0.3, 0.0), follower: (0.0, 0.0)}
    left = TieRodPulls(car, q, replace(ALL_DEFAULT, losses=MENDED), SHORT)
    assert not left
    assert left.added(efforts, astray) == efforts
    tied = TieRodPulls(car, q, ALL_MENDED, SHORT)
    assert tied
    rods = tie_rod_efforts(car.drive, astray, follower_inertia(car, q), SHORT)
    assert tied.added(efforts, astray) == {leader: 1.0 + rods[leader], follower: rods[follower]}


def test_tie_rods_pull_to_their_place_and_do_no_work_along_it() -> None:
    car = rpctl.load("car")
    leader, follower = car.drive.steered[0].joint, car.drive.followers[0].joint
    q = car.configuration(joints={leader: 0.3})
    inertia = follower_inertia(car, q)
    place = car.joint_position(q, follower)
    still = {leader: (0.3, 0.0), follower: (place, 0.0)}
    assert tie_rod_efforts(car.drive, still, inertia, SHORT) == pytest.approx(
        {leader: 0, follower: 0}
    )
    ahead = {leader: (0.3, 0.0), follower: (place + 0.01, 0.0)}
    pull = tie_rod_efforts(car.drive, ahead, inertia, SHORT)
    assert pull[follower] == pytest.approx(-inertia[follower] * BANDWIDTH**2 * 0.01)
    nearby = car.configuration(joints={leader: 0.31})
    slope = (car.joint_position(nearby, follower) - place) / 0.01
    assert pull[leader] + slope * pull[follower] == pytest.approx(0.0, abs=0.01 * pull[leader])
    along = {leader: (0.3, 0.2), follower: (place, 0.2 * slope)}
    assert abs(tie_rod_efforts(car.drive, along, inertia, SHORT)[follower]) < 0.02 * abs(
        pull[follower]
    )
    lags = {leader: (0.3, 0.0), follower: (place, 1.0)}
    damped = tie_rod_efforts(car.drive, lags, inertia, SHORT)[follower]
    assert damped == pytest.approx(-2.0 * inertia[follower] * BANDWIDTH)


def test_tie_rods_yield_where_steps_are_long() -> None:
    """A damper that is pulled once a step takes away less than the rate that it damps."""
    car, step = rpctl.load("car"), 1.0 / 240.0
    leader, follower = car.drive.steered[0].joint, car.drive.followers[0].joint
    q = car.configuration(joints={leader: 0.3})
    inertia = follower_inertia(car, q)
    turns = {leader: (0.3, 0.0), follower: (car.joint_position(q, follower), 1.0)}
    change = tie_rod_efforts(car.drive, turns, inertia, step)[follower] * step / inertia[follower]
    assert change == pytest.approx(-2.0 * STABLE)
    assert 2.0 * BANDWIDTH * step > 1.5


def test_what_a_library_prints_is_kept(capfd: pytest.CaptureFixture[str]) -> None:
    import os

    print("before")
    with pytest.raises(ValueError, match="real"), captured() as lines:
        os.write(1, b"noise\n")
        os.write(2, b"more\n")
        raise ValueError("a real error")
    print("after")
    assert lines == ["noise", "more"]
    assert capfd.readouterr() == ("before\nafter\n", "")
