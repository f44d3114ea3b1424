"""What Drake and PyBullet share: whose contact points are, how wheels slip, and tie rods."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest

import rpctl
from rpctl.arrays import Array
from rpctl.description.records import rotation
from rpctl.engines.bullet import captured
from rpctl.engines.engine import (
    ALL_DEFAULT,
    ALL_MENDED,
    EngineFault,
    LinkMotion,
    Mended,
    Switch,
    wheel_slip,
)
from rpctl.engines.urdf_engine import (
    BANDWIDTH,
    NamedContacts,
    Point,
    UrdfEngine,
    UrdfRun,
)
from rpctl.equivalence.contact.mujoco_body import STABLE, tie_rod_efforts
from rpctl.robot.model import Robot

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def paper() -> Robot:
    return rpctl.load("paper")


@pytest.fixture(scope="module")
def car() -> Robot:
    return rpctl.load("car")


def motion(v: Array, omega: Array, turn: float = 0.0) -> LinkMotion:
    return LinkMotion(rotation(UP, turn), np.zeros(3), v, omega)


def test_loads_go_to_the_wheel_or_the_nearest_support(paper: Robot) -> None:
    named = NamedContacts(paper)
    assert named.names == ("wheel_left_joint", "wheel_right_joint", "base_link")
    base = replace(motion(UP, UP, 0.5 * np.pi), origin=np.array([1.0, 2.0, 0.0]))
    ball = np.array([1.0, 2.78, 0.0])  # .78 m ahead of a robot that looks along y
    points = [
        ("wheel_left_link", np.zeros(3), 100.0),
        ("wheel_left_link", np.ones(3), 20.0),
        ("base_link", ball, 150.0),
        ("base_link", np.array([1.0, 1.6, 0.0]), 7.0),  # the hull drags: nobody's
        ("arm_rail_link", ball, 9.0),
    ]
    assert named.loads(points, {"base_link": base}.__getitem__).tolist() == [120.0, 0.0, 150.0]


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


class StillRun(UrdfRun):
    """A robot that stands wherever its joints are put, and notes the efforts it gets."""

    steps = (1e-3, 1e-3)

    def __init__(self, robot: Robot, q: Array, mended: Mended, friction: float = 0.7) -> None:
        super().__init__(robot, q, mended)
        self.places = dict.fromkeys(robot.moving_joint_names, (0.0, 0.0))
        self.given: list[dict[str, float]] = []

    def joints(self) -> dict[str, tuple[float, float]]:
        return self.places

    def motion(self, link: str) -> LinkMotion:
        return motion(np.zeros(3), np.zeros(3))

    def points(self) -> list[Point]:
        return []

    def energy(self) -> float:
        return 0.0

    def exert(self, efforts: Mapping[str, float]) -> None:
        self.given.append(dict(efforts))


class StillEngine(UrdfEngine):
    """An engine that is always there."""

    name, tick, run, said = "Still", 1e-3, StillRun, {"cone": ("it slips", "grip")}
    module, distribution, extra = "math", "numpy", "still"

    def own_switches(self, robot: Robot) -> Iterator[Switch]:
        yield Switch("caster", "it drags", "oil it")


def test_only_rollers_that_are_to_be_mended_are_refused() -> None:
    mecanum, engine = rpctl.load("mecanum"), StillEngine()
    assert engine.start(mecanum, mecanum.configuration(), ALL_DEFAULT, 0.7).contacts
    with pytest.raises(EngineFault, match="mecanum cannot run in Still, which has no rollers"):
        engine.start(mecanum, mecanum.configuration(), ALL_MENDED, 0.7)


def test_rods_pull_anew_in_each_step_and_only_where_they_are_mended(car: Robot) -> None:
    """Losses may be mended alone: the swivels of a car are then left to its motors."""
    step = 1e-3
    leader, follower = car.drive.steered[0].joint, car.drive.followers[0].joint
    tau = np.array([1.0 if name == leader else 0.0 for name in car.actuators])
    for mended, count in ((frozenset({"losses"}), 1), (ALL_MENDED, 2)):
        run = StillRun(car, car.configuration(), mended)
        run.places |= {leader: (0.3, 0.0), follower: (0.0, 0.0)}
        run.advance(tau, 2.0 * step)
        assert len(run.given) == count and run.t == 2.0 * step
        astray = {name: run.places[name] for name in (leader, follower)}
        inertia, bandwidth = run.rods, min(BANDWIDTH, STABLE / step)
        rods = tie_rod_efforts(car.drive, astray, inertia, bandwidth) if inertia else {}
        assert run.given[0][leader] == 1.0 + rods.get(leader, 0.0)
        assert run.given[0].get(follower, 0.0) == rods.get(follower, 0.0)


def test_what_a_library_prints_is_kept(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with pytest.raises(ValueError, match="real"), captured() as lines:
        os.write(1, b"noise\n")
        os.write(2, b"more\n")
        raise ValueError("a real error")
    print("after")
    assert lines == ["noise", "more"]
    assert capfd.readouterr() == ("before\nafter\n", "")
