"""Steered wheels: on the reference they keep to it, off it they lead back, and fast enough."""

from __future__ import annotations

from itertools import cycle, product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError, UnifiedKinematic, summarize, track
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.reference.motion import ReferenceState, direction, reference_rates, steering
from rpctl.reference.named import reference_by_name
from tests.grids import cells
from tests.robots import write
from tests.vehicles import vehicle

STEERED = ["car-like", "parallel", "tricycle", "bicycle", "steered", "twin"]
EXACT = [kind for kind in STEERED if kind != "tricycle"]  # whose trailing wheel lags a little
STEP = 1e-6
GRID = list(product(STEERED, ("line", "reverse", "circle", "eight")))
IN_CI = {("car-like", "eight"), ("tricycle", "line"), ("steered", "reverse")}


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind)))


def on(robot: Robot, state: ReferenceState) -> Array:
    return robot.configuration_at(state.pose, state.joints, steering(robot, state)[0])


@pytest.mark.parametrize(
    ("kind", "name"), zip(EXACT, cycle(("circle", "eight", "reverse")), strict=False)
)
def test_a_reference_moves_as_the_robot_can(tmp_path: Path, kind: str, name: str) -> None:
    """Its twist is S ν, its rates are their differences, its wheels do not slip."""
    robot = load(tmp_path, kind)
    reference, dynamics = reference_by_name(robot, name), ReducedDynamics(robot)
    for t in (0.4, 2.0, 7.0, 13.0):
        state = reference(t)
        q, (nu, nu_dot) = on(robot, state), reference_rates(robot, state)
        np.testing.assert_allclose(dynamics.twist(q, nu), state.twist, atol=1e-12)
        ahead, behind = (reference_rates(robot, reference(t + s)).nu for s in (STEP, -STEP))
        np.testing.assert_allclose((ahead - behind) / (2 * STEP), nu_dot, atol=2e-6)
        places = [steering(robot, reference(t + s))[0] for s in (STEP, -STEP)]
        turned = (places[0] - places[1]) / (2 * STEP)
        np.testing.assert_allclose(turned, steering(robot, state)[1], atol=1e-7)


@pytest.mark.parametrize("kind", EXACT)
def test_on_the_reference_the_law_asks_for_the_reference(tmp_path: Path, kind: str) -> None:
    robot = load(tmp_path, kind)
    reference, dynamics = reference_by_name(robot, "eight"), ReducedDynamics(robot)
    for t in (1.0, 5.0, 9.0):
        state = reference(t)
        q, rates = on(robot, state), reference_rates(robot, state)
        nu_d, nu_d_dot = UnifiedKinematic()(dynamics, reference, t, q, rates.nu)
        np.testing.assert_allclose(nu_d, rates.nu, atol=1e-9)
        np.testing.assert_allclose(nu_d_dot, rates.nu_dot, atol=1e-8)


@pytest.mark.parametrize("kind", STEERED)
def test_what_is_asked_for_changes_as_it_says(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """The speed, along an actual motion that has nothing to do with the reference."""
    robot = load(tmp_path, kind)
    reference, dynamics = reference_by_name(robot, "eight"), ReducedDynamics(robot)
    law = UnifiedKinematic(approach=None).start(dynamics, 0.002)
    nu, rates = 0.2 * rng.normal(size=robot.dof), np.zeros(robot.dof)
    start = on(robot, reference(4.0))
    q = pin.integrate(robot.model, start, 0.1 * dynamics.basis(start) @ nu)
    v = dynamics.basis(q) @ nu

    def asked(s: float) -> Command:
        at = pin.integrate(robot.model, q, s * v)
        return law(dynamics, reference, 4.0 + s, at, nu + s * rates)

    count = len(robot.drive.steered)
    for _ in range(3):  # steering accelerates as it is asked to
        rates[1 : 1 + count] = asked(0.0).nu_d_dot[1 : 1 + count]
    slope = (asked(STEP).nu_d[0] - asked(-STEP).nu_d[0]) / (2 * STEP)
    assert slope == pytest.approx(asked(0.0).nu_d_dot[0], abs=1e-5)


@pytest.mark.parametrize(("kind", "name"), cells(GRID, slow=IN_CI))
def test_they_track(tmp_path: Path, kind: str, name: str) -> None:
    robot = load(tmp_path, kind)
    off = (0.1, -0.1, 0.1)
    run = track(robot, name, duration=10.0, initial_error=off, control_period=0.01, plant_step=0.01)
    figures = summarize(run)
    assert figures.final_base_error < (0.02 if kind == "tricycle" else 3e-3)
    assert not figures.limits_violated
    assert figures.constraint_residual < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["steered", "twin"])
def test_swerves_turn_on_the_spot(tmp_path: Path, kind: str) -> None:
    robot = load(tmp_path, kind)
    run = track(
        robot,
        "spin",
        duration=10.0,
        initial_error=(0.1, -0.1, 0.1),
        control_period=0.01,
        plant_step=0.01,
    )
    assert summarize(run).final_base_error < 1e-3


@pytest.mark.parametrize("kind", ["car-like", "tricycle", "bicycle"])
def test_others_say_that_they_cannot(tmp_path: Path, kind: str) -> None:
    with pytest.raises(RpctlError, match="does not turn on the spot"):
        reference_by_name(load(tmp_path, kind), "spin")


@pytest.mark.slow
def test_steering_stays_inside_its_limits(tmp_path: Path) -> None:
    """Even where the error asks for far more."""
    robot = load(tmp_path, "car-like")
    run = track(
        robot,
        "line",
        duration=10.0,
        initial_error=(0.2, 0.8, 1.2),
        control_period=0.01,
        plant_step=0.01,
    )
    index = [robot.velocity_index(name) + 1 for name in ("steer_left", "steer_right")]
    assert np.abs(run.q[:, index]).max() < 1.2
    assert summarize(run).final_lateral_error < 0.1


def test_a_reference_without_a_direction_leaves_the_wheels_ahead() -> None:
    still = ReferenceState(*np.zeros((3, 3)), *np.empty((3, 0)))
    np.testing.assert_array_equal(direction(still), [[1, 0, 0], [0, 0, 0], [0, 0, 0]])
