"""Robots that lean on a ground in MuJoCo: where they touch, how they fall, what holds them up."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, RpctlError
from rpctl.arrays import Array
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.robot.leaning import LeaningRobot
from rpctl.simulation.plants.contact import LeaningMotion
from rpctl.simulation.plants.rolling import RollingMotion
from rpctl.simulation.plants.settings import Wrench
from tests.grids import cells
from tests.leaning import OWN, leaning, pushed_on_an_eight

pytest.importorskip("mujoco")

MU, G = 0.7, 9.81
PERIOD = 2e-3  # s
PUSHED = Wrench("base_link", (6.0, 9.0, 0.0), (1.0, 2.0, 0.0))
AHEAD = Wrench("base_link", (6.0 * math.cos(0.5), 6.0 * math.sin(0.5), 0.0))  # at a heading of .5


def placed(robot: LeaningRobot, tilt: float) -> Array:
    """Return q of a robot at home at (1, 2, .5), with a tilt."""
    return robot.configuration_at(np.array([1.0, 2.0, 0.5]), robot.home, tilt=tilt)


def start(robot: LeaningRobot, tilt: float = 0.0) -> LeaningMotion:
    return LeaningMotion(robot, ContactSettings(), MU, placed(robot, tilt))


@pytest.mark.parametrize("name", OWN)
def test_it_settles_where_it_is_put_and_the_ground_bears_its_weight(name: str) -> None:
    robot = leaning(name)
    motion = start(robot, 0.1)
    np.testing.assert_allclose(robot.seen(motion.q), [1.0, 2.0, 0.5, 0.1], atol=2e-4)
    assert np.abs(motion.nu).max() < 1e-9
    ground = motion.ground()
    assert ground.load.sum() == pytest.approx(G * robot.mass, rel=2e-3)
    assert np.abs(ground.slip).max() < 1e-9


@pytest.mark.parametrize("section", [0.0, 0.05, 0.3])
def test_its_tyres_reach_as_low_as_they_are_said_to(section: float) -> None:
    """An ellipsoid reaches (1 − ρ/r) ρ φ⁴/8 lower than a torus, and 1 mm wide at most w² s²/2r."""
    robot = leaning("whipple")
    wheels = tuple(replace(w, tyre=section * w.radius) for w in robot.drive.wheels)
    robot = replace(robot, drive=replace(robot.drive, wheels=wheels))
    motion = start(robot)
    motion.put(robot.configuration(tilt=0.4, joints={"steering_joint": 0.2}), 0.0)
    motion.mujoco.mj_forward(motion.mjm, motion.data)
    for wheel, geom in zip(robot.drive.wheels, motion.owner, strict=True):
        R, size = motion.data.geom_xmat[geom].reshape(3, 3), motion.mjm.geom_size[geom]
        gap = math.hypot(*(size * R[2])) - motion.data.geom_xpos[geom][2]
        more = (1.0 - section) * wheel.tyre * math.asin(R[2, 2]) ** 4 / 8.0
        assert gap == pytest.approx(more, rel=0.2, abs=1e-6)


def moved(motion: LeaningMotion | RollingMotion, robot: LeaningRobot) -> Array:
    """Return ν after a tenth of a second under efforts and a push, from rest.

    On legs that part, friction holds each wheel to its side, but rolling holds their mean: it is
    pushed straight ahead, and its legs give way alike.
    """
    tau = np.full(len(robot.actuators), 0.0 if robot.legs else 0.3)
    tau[1::2] *= -1.0
    for _ in range(50):
        motion.advance(tau, PERIOD, (AHEAD if robot.legs else PUSHED,))
    return motion.nu


@pytest.mark.parametrize("name", OWN)
def test_it_falls_as_the_model_that_rolls(name: str) -> None:
    """A push, efforts, and its own weight: .1 s later the rates are the reduced model's."""
    robot = leaning(name)
    ideal = RollingMotion(ReducedDynamics(robot), placed(robot, 0.1), 1e-3)
    real, wanted = moved(start(robot, 0.1), robot), moved(ideal, robot)
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(real, wanted, atol=0.02 * np.abs(wanted).max())


@pytest.mark.parametrize("name", OWN)
def test_its_quasi_velocities_are_the_rates_of_what_is_seen(name: str) -> None:
    robot = leaning(name)
    motion = start(robot, 0.1)
    moved(motion, robot)
    before, nu = np.array(robot.seen(motion.q)), motion.nu
    motion.advance(np.zeros(len(robot.actuators)), 1e-4)
    rate, mean = (np.array(robot.seen(motion.q)) - before) / 1e-4, 0.5 * (nu + motion.nu)
    theta = before[2]
    ahead = rate[0] * math.cos(theta) + rate[1] * math.sin(theta)
    seen = [ahead, rate[3]] if robot.rolls_sideways else [ahead, rate[2], rate[3]]
    assert np.abs(seen).max() > 0.05
    np.testing.assert_allclose(mean[: len(seen)], seen, atol=2e-3)


@pytest.mark.parametrize("name", OWN)
def test_a_fall_turns_height_into_speed(name: str) -> None:
    """What a push and efforts do is in the robot's energy, but for what soft contacts take."""
    robot = leaning(name)
    motion = start(robot, 0.1)
    idle = np.zeros(len(robot.actuators))
    steps = [motion.advance(idle, PERIOD, (PUSHED,)) for _ in range(75)]
    dynamics = ReducedDynamics(robot)
    kinetic = 0.5 * motion.nu @ dynamics.inertia(motion.q) @ motion.nu
    assert abs(sum(step.lost for step in steps)) < 0.03 * kinetic


def test_props_are_refused() -> None:
    robot = leaning("balancer")
    with pytest.raises(RpctlError, match="leans on two wheels, so props would hold"):
        LeaningMotion(robot, ContactSettings(props=True), MU, placed(robot, 0.0))


@pytest.mark.parametrize("name", cells(OWN, ["balancer"], ["wheel_legs"]))
def test_it_stays_upright_on_contact(name: str) -> None:
    robot = leaning(name)
    run = rpctl.track(robot, "line", duration=1.0, plant=Plant(kind="contact"), collisions=False)
    assert max(abs(robot.tilt(q)) for q in run.q[::50]) < 0.3
    assert np.abs(run.log.e[-1, :3]).max() < 0.2


LATE = ("balancer", 0.02), ("whipple", 0.02)


@pytest.mark.parametrize(("name", "delay"), cells(product(OWN, (0.0, 0.02)), slow=LATE))
def test_it_follows_an_eight_on_contact_late_and_pushed(name: str, delay: float) -> None:
    plant = Plant(kind="contact", delay=delay)
    run = pushed_on_an_eight(name, plant, 3.0, duration=8.0, collisions=False)
    figures = rpctl.summarize(run)
    assert figures.outcome != "fell", figures.outcome_sentence
    assert figures.final_base_error < 1.0


@pytest.mark.slow
def test_what_nobody_balances_falls_on_contact() -> None:
    push = Wrench("base_link", moment=(0.0, 1500.0, 0.0), start=0.5, end=0.6)
    plant = Plant(kind="contact", wrenches=(push,))
    run = rpctl.track(leaning("balancer"), "line", duration=8.0, plant=plant, collisions=False)
    assert rpctl.summarize(run).outcome == "fell" and run.t[-1] < 5.0
