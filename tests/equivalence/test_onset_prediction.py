"""Predicted onsets are those of paper and pencil, and a fault in the model shifts them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.ground_reaction import Contacts, find_contacts, ground_reaction
from rpctl.dynamics.reduced import push_at, pushed_efforts
from rpctl.equivalence.onset.prediction import (
    SLIPS,
    TIPS,
    Manoeuvre,
    Predicted,
    SlipsFirst,
    circle_radius,
    find_onset,
    manoeuvres,
    predict,
)
from rpctl.equivalence.onset.trial import INSIDE, SAFE, WITHIN, WRONG, Onset
from rpctl.robot.load import load
from tests.equivalence import trolley as paper_and_pencil
from tests.equivalence.trolley import trolley

RESOLUTION = 2e-4  # of a predicted onset
MU = 0.7
GRIP = 100.0  # so that it tips and does not slip
CIRCLE, DRIVES, BRAKES, LEFT, AHEAD = range(5)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return trolley(tmp_path_factory.mktemp("trolley"))


def contacts_of(dynamics: ReducedDynamics, friction: float) -> Contacts:
    contacts = find_contacts(dynamics, friction)
    assert contacts is not None
    return contacts


def manoeuvre(dynamics: ReducedDynamics, which: int, ending: str) -> Manoeuvre:
    return list(manoeuvres(dynamics, contacts_of(dynamics, MU), 1.0, ending))[which]


def predicted(robot: Robot, which: int, ending: str = SLIPS, friction: float = MU) -> Predicted:
    dynamics = ReducedDynamics(robot)
    grip = contacts_of(dynamics, friction)
    return predict(dynamics, grip, manoeuvre(dynamics, which, ending))


def lifted(robot: Robot, scale: float) -> Robot:
    """Return the robot with the height of its root link's centre of mass scaled, in the model."""
    model = robot.model.copy()
    body = model.inertias[1]
    lever = body.lever * np.array([1.0, 1.0, scale])
    model.inertias[1] = pin.Inertia(body.mass, lever, body.inertia)
    return dataclasses.replace(robot, model=model)


@pytest.mark.slow
def test_slipping(robot: Robot) -> None:
    radius = circle_radius(robot, contacts_of(ReducedDynamics(robot), MU))
    expected = {
        CIRCLE: paper_and_pencil.circle_slip(MU, radius),
        DRIVES: paper_and_pencil.slipping_force(MU, 1),
        BRAKES: paper_and_pencil.slipping_force(MU, -1),
        LEFT: paper_and_pencil.pushed_aside(MU),
        AHEAD: paper_and_pencil.pushed_ahead(MU),
    }
    for which, value in expected.items():
        found = predicted(robot, which)
        assert found.would == pytest.approx(value, rel=5.0 * RESOLUTION), which
        assert found.could == found.equal == found.would


def test_tipping(robot: Robot) -> None:
    drives, left = (predicted(robot, which, TIPS, GRIP).would for which in (DRIVES, LEFT))
    assert drives == pytest.approx(paper_and_pencil.tipping_force(), rel=RESOLUTION)
    assert left == pytest.approx(paper_and_pencil.pushed_over(), rel=RESOLUTION)


def test_wheels_that_lift_do_not_brake(robot: Robot) -> None:
    """Tipping ahead it would stand on the ball alone, and its wheels slip before."""
    for which in (BRAKES, AHEAD):
        with pytest.raises(SlipsFirst, match="slips before"):
            predicted(robot, which, TIPS, GRIP)


def test_one_wheel_at_its_limit_slides_no_axle(robot: Robot) -> None:
    """The slip ratio of reports shares an axle's force by load, and so warns early."""
    dynamics = ReducedDynamics(robot)
    contacts, found = contacts_of(dynamics, MU), predicted(robot, CIRCLE).would
    radius = circle_radius(robot, contacts)
    q, nu = robot.configuration(), np.array([found, found / radius])
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, np.zeros(2)))
    ground = ground_reaction(dynamics, contacts, q, nu, tau)
    circles = np.sqrt((MU * ground.load[:2]) ** 2 - ground.longitudinal**2)
    assert circles.sum() == pytest.approx(abs(ground.lateral[0]), rel=1e-3)
    assert ground.slip_ratio.max() > 1.02


def test_a_fault_shifts_what_is_predicted(robot: Robot) -> None:
    """Wrong friction, a higher centre of mass, no load transfer: each is beyond the tolerance."""
    expected = paper_and_pencil.slipping_force(MU, 1), paper_and_pencil.tipping_force()
    faults = (
        (predicted(robot, DRIVES, SLIPS, 1.1 * MU).would, expected[0]),
        (predicted(lifted(robot, 0.0), DRIVES).would, expected[0]),
        (predicted(lifted(robot, 1.1), DRIVES, TIPS, GRIP).would, expected[1]),
        (predicted(lifted(robot, 0.9), DRIVES, TIPS, GRIP).would, expected[1]),
    )
    for would, measured in faults:
        assert row(would, would, would, measured).verdict == WRONG


def test_a_push_does_what_newton_says(robot: Robot) -> None:
    """Free wheels: F = m' a; the ground bears the push's moment, and not what moves the robot."""
    dynamics, push = ReducedDynamics(robot), np.array([20.0, 0.0, 0.0])
    q, still = robot.configuration(theta=0.0), np.zeros(2)
    felt = push_at(dynamics, q, "mast", push, np.zeros(3))
    np.testing.assert_allclose(felt.wrench, [20.0, 0.0, 0.0, 0.0, 20.0 * paper_and_pencil.MAST, 0])
    inertia = paper_and_pencil.MASS + 2.0 * paper_and_pencil.SPIN / paper_and_pencil.RADIUS**2
    a = 20.0 / inertia
    _, moved = dynamics.reaction(q, still, np.zeros(2), outside=felt)
    assert moved[0] == pytest.approx(paper_and_pencil.MASS * a - 20.0)
    held = pushed_efforts(dynamics, q, still, still, felt)
    np.testing.assert_allclose(held, -10.0 * paper_and_pencil.RADIUS)
    _, resting = dynamics.reaction(q, still, held, outside=felt)
    np.testing.assert_allclose(resting[:3], [-20.0, 0.0, paper_and_pencil.WEIGHT], atol=1e-9)


def test_a_push_is_one_of_the_world(robot: Robot) -> None:
    """The root link's axes turn with the robot."""
    dynamics, q = ReducedDynamics(robot), robot.configuration(1.0, -2.0, 0.5 * math.pi)
    felt = push_at(dynamics, q, "mast", np.array([0.0, 5.0, 0.0]), np.array([0.0, 0.0, 3.0]))
    np.testing.assert_allclose(
        felt.wrench, [5.0, 0, 0, 0, 5.0 * paper_and_pencil.MAST, 3.0], atol=1e-12
    )
    np.testing.assert_allclose(felt.push[:3], [5.0, 0.0, 3.0], atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["car", "mecanum"])
def test_more_contacts_leave_an_interval(name: str) -> None:
    found = predicted(load(name), CIRCLE)
    assert found.could < found.equal <= found.would


def row(could: float, equal: float, would: float, measured: float) -> Onset:
    return Onset("drives off", SLIPS, "N", MU, could, would, equal, measured)


def test_the_tolerance_of_a_speed_is_half_of_a_forces() -> None:
    speed = dataclasses.replace(row(1.03, 1.03, 1.03, 1.0), unit="m/s")
    assert speed.verdict == WRONG
    assert dataclasses.replace(speed, unit="N").verdict == WITHIN


def test_an_onset_is_found_or_there_is_none() -> None:
    assert find_onset(lambda value: value > 3.7, 1.0) == pytest.approx(3.7, rel=RESOLUTION)
    assert find_onset(lambda value: True, 1.0) == 0.0
    assert find_onset(lambda value: False, 1.0) == math.inf


@pytest.mark.parametrize(
    ("predicted_at", "measured", "verdict"),
    [
        ((100.0, 100.0, 100.0), 96.0, WITHIN),
        ((100.0, 100.0, 100.0), 94.0, WRONG),
        ((100.0, 100.0, 100.0), 108.0, WRONG),
        ((50.0, 70.0, 100.0), 90.0, INSIDE),
        ((50.0, 70.0, 100.0), 45.0, WRONG),
        ((50.0, 70.0, 100.0), 110.0, SAFE),
        ((math.inf, math.inf, math.inf), math.inf, WITHIN),
        ((math.inf, math.inf, math.inf), 90.0, WRONG),
        ((50.0, 70.0, 100.0), math.inf, SAFE),
        ((0.0, 70.0, math.inf), 5.0, INSIDE),
    ],
)
def test_verdicts(predicted_at: tuple[float, float, float], measured: float, verdict: str) -> None:
    found = row(*predicted_at, measured).to_dict()
    assert (found["verdict"], found["passed"]) == (verdict, verdict != WRONG)
    assert found["would"] == (predicted_at[2] if math.isfinite(predicted_at[2]) else None)
