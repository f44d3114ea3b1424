"""Steered wheels: on the reference they keep to it, off it they lead back, within their limits."""

from __future__ import annotations

import math as numbers
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError, UnifiedKinematic, math, summarize, track
from rpctl.arrays import Array
from rpctl.control.error import Tracking
from rpctl.control.law import Command
from rpctl.control.steering import (
    Measured,
    base_command,
    max_deviation,
)
from rpctl.drive.steering import steering_limits, turning_radius
from rpctl.kernels.sheet import Sheet
from rpctl.reference.motion import ReferenceState, direction, reference_rates, steering
from rpctl.reference.named import reference_by_name
from tests.grids import cells
from tests.robots import write
from tests.vehicles import vehicle

STEERED = ["car-like", "parallel", "tricycle", "bicycle", "steered", "twin"]
EXACT = [kind for kind in STEERED if kind != "tricycle"]  # whose trailing wheel lags a little
ANGLE_MARGIN, BRAKE_TIME = 0.02, 0.3  # rad, s
RATE_FRACTION, STEERING_HORIZON_RATIO = 0.9, 0.25
STEP = 1e-6
# A thousand samples take less in Python than machine code takes to build.
IN_PYTHON: dict[str, Any] = {"control_period": 0.01, "plant_step": 0.01}
IN_PYTHON |= {"backend": "pinocchio", "collisions": False}
GRID = list(product(STEERED, ("line", "reverse", "circle", "eight")))
IN_CI = {("car-like", "eight")}


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind)))


def on(robot: Robot, state: ReferenceState) -> Array:
    return robot.configuration_at(state.pose, state.joints, steering(robot, state)[0])


@pytest.mark.parametrize(
    ("kind", "name"),
    cells(
        zip(EXACT, cycle(("circle", "eight", "reverse")), strict=False),
        [("car-like", "circle"), ("parallel", "eight"), ("steered", "circle")],
    ),
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


@pytest.mark.parametrize("kind", cells(EXACT, ["car-like", "steered"]))
def test_on_the_reference_the_law_asks_for_the_reference(tmp_path: Path, kind: str) -> None:
    robot = load(tmp_path, kind)
    reference, dynamics = reference_by_name(robot, "eight"), ReducedDynamics(robot)
    for t in (1.0, 5.0, 9.0):
        state = reference(t)
        q, rates = on(robot, state), reference_rates(robot, state)
        nu_d, nu_d_dot = UnifiedKinematic()(dynamics, reference, t, q, rates.nu)
        np.testing.assert_allclose(nu_d, rates.nu, atol=1e-9)
        np.testing.assert_allclose(nu_d_dot, rates.nu_dot, atol=1e-8)


def backwards(t: float) -> tuple[float, float, float]:
    """Round a circle of 2 m, the rear ahead."""
    turn = -0.2 * t
    return 2.0 * numbers.sin(turn), 2.0 - 2.0 * numbers.cos(turn), turn


@pytest.mark.parametrize(
    ("kind", "name"),
    cells(
        [*((kind, "eight") for kind in (*STEERED, "articulated")), ("articulated", "back")],
        [
            *((kind, "eight") for kind in ("car-like", "tricycle", "steered")),
            ("articulated", "back"),
        ],
    ),
)
def test_what_is_asked_for_changes_as_it_says(
    tmp_path: Path, kind: str, name: str, rng: np.random.Generator
) -> None:
    """The speed, along an actual motion that has nothing to do with the reference."""
    robot = load(tmp_path, kind)
    reference = (
        rpctl.as_reference(backwards, joints=robot.home)
        if name == "back"
        else reference_by_name(robot, name)
    )
    dynamics = ReducedDynamics(robot)
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


def test_an_articulated_base_goes_back_rear_axle_first(tmp_path: Path) -> None:
    """From beside a circle: steered from the front its error would grow at first, and stay."""
    robot = load(tmp_path, "articulated")
    reference = rpctl.as_reference(backwards, joints=robot.home)
    off = (0.05, -0.1, 0.1)
    coarse = {**IN_PYTHON, "control_period": 0.02, "plant_step": 0.02}
    figures = summarize(track(robot, reference, duration=9.0, initial_error=off, **coarse))
    assert (figures.outcome, figures.limits_violated) == ("tracked", ())
    assert figures.final_base_error < 4e-3


@pytest.mark.parametrize(("kind", "name"), cells(GRID, slow=IN_CI))
def test_they_track(tmp_path: Path, kind: str, name: str) -> None:
    robot = load(tmp_path, kind)
    off = (0.1, -0.1, 0.1)
    run = track(robot, name, duration=10.0, initial_error=off, **IN_PYTHON)
    figures = summarize(run)
    assert figures.final_base_error < (0.02 if kind == "tricycle" else 3e-3)
    assert not figures.limits_violated
    assert figures.constraint_residual < 1e-12


@pytest.mark.parametrize("kind", cells(["steered", "twin"], slow=["steered"]))
def test_swerves_turn_on_the_spot(tmp_path: Path, kind: str) -> None:
    robot = load(tmp_path, kind)
    run = track(
        robot,
        "spin",
        duration=10.0,
        initial_error=(0.1, -0.1, 0.1),
        **IN_PYTHON,
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
        **IN_PYTHON,
    )
    index = [robot.velocity_index(name) + 1 for name in ("steer_left", "steer_right")]
    assert np.abs(run.q[:, index]).max() < 1.2
    assert summarize(run).final_lateral_error < 0.1


def test_a_reference_without_a_direction_leaves_the_wheels_ahead() -> None:
    still = ReferenceState(*np.zeros((3, 3)), *np.empty((3, 0)))
    np.testing.assert_array_equal(direction(still), [[1, 0, 0], [0, 0, 0], [0, 0, 0]])


H = 0.6  # s, of the law
RANGE = 'lower="-1.2" upper="1.2"'  # of every limited joint that the vehicles have
LIMITS = f'{RANGE} effort="40" velocity="6"'


def bicycle(folder: Path, lower: float, upper: float, velocity: float = 6.0) -> Robot:
    """Return a bicycle; its steering axis points down, so that positive steers to the right."""
    limits = f'lower="{lower}" upper="{upper}" effort="40" velocity="{velocity}"'
    arm, _, steering = vehicle("bicycle").rpartition(LIMITS)
    return rpctl.load(write(folder, arm + limits + steering))


def asked(robot: Robot, angle: float, rate: float, omega: float) -> Array:
    """Return δ̇_d and δ̈_d (2,) for a bend that takes far more steering than there is."""
    sheet = Sheet()
    twist, direction, none = [0.5, 0.0, omega], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]
    measured = Measured(none, none, [], [], [math.SX(angle)], [math.SX(rate)])
    at = Tracking(sheet, direction, none, direction, none, none, none)
    symbols = math.SX.sym("twist", 3)
    parts = base_command(sheet, robot, at, math.vertsplit(symbols), measured, H)
    (value,) = sheet.resolved([math.vertcat(*(part[1] for part in parts))])
    return np.asarray(math.Function("asked", [symbols], [value])(twist)).ravel()


@pytest.mark.parametrize(("omega", "limit"), [(-20.0, 0.7), (20.0, -0.4)])
def test_it_comes_to_rest_a_margin_before_its_limit(
    tmp_path: Path, omega: float, limit: float
) -> None:
    """(limit − margin − δ)/brake on the way out, and what is beyond comes back as δ always does."""
    robot = bicycle(tmp_path, -0.4, 0.7)
    end, side, rate = (
        limit - numbers.copysign(ANGLE_MARGIN, limit),
        numbers.copysign(1.0, limit),
        0.1,
    )
    for gap, time in ((0.2, BRAKE_TIME), (0.001, BRAKE_TIME), (-0.01, STEERING_HORIZON_RATIO * H)):
        got = asked(robot, end - side * gap, side * rate, omega)
        np.testing.assert_allclose(got, [side * gap / time, -side * rate / time], atol=1e-12)


@pytest.mark.parametrize(("omega", "limit"), [(-20.0, 0.7), (20.0, -0.4)])
def test_it_turns_no_faster_than_a_share_of_its_limit(
    tmp_path: Path, omega: float, limit: float
) -> None:
    robot = bicycle(tmp_path, -0.4, 0.7, velocity=0.5)
    got = asked(robot, 0.0, 0.1, omega)
    np.testing.assert_allclose(got, [numbers.copysign(RATE_FRACTION * 0.5, limit), 0.0], atol=1e-12)


def test_within_its_limits_it_is_of_first_order(tmp_path: Path) -> None:
    """Where the twist is the reference's, ahead: δ̇_d = −δ/h_s, δ̈_d = −δ̇/h_s."""
    robot = bicycle(tmp_path, -0.4, 0.7)
    got = asked(robot, 0.03, 0.1, 0.0)
    np.testing.assert_allclose(
        got, [-0.03 / (STEERING_HORIZON_RATIO * H), -0.1 / (STEERING_HORIZON_RATIO * H)], atol=1e-12
    )


def car(folder: Path, left: str, right: str) -> Robot:
    """Return a car whose right front wheel follows the left one, with the limits of each."""
    arm, first, second, rest = vehicle("car-like").split(RANGE)
    return rpctl.load(write(folder, arm + RANGE + first + left + second + right + rest))


@pytest.mark.parametrize(
    ("own", "followers", "bound"),
    [((-0.9, 1.0), (-0.3, 0.5), (0, 1)), ((-0.9, 1.0), (-0.5, 0.2), (0, 1)),
     ((-0.1, 0.2), (-1.0, 1.1), ()), ((-0.1, 1.0), (-0.3, 0.9), (1,))],
)  # fmt: skip
def test_a_leader_keeps_its_followers_limits(
    tmp_path: Path,
    own: tuple[float, float],
    followers: tuple[float, float],
    bound: tuple[int, ...],
) -> None:
    """Ackermann: cot δ_R − cot δ_L = w/L. The right axis points down: δ_R is minus its position."""
    L, w = 0.7, 0.5
    said = [f'lower="{low}" upper="{high}"' for low, high in (own, followers)]
    robot = car(tmp_path, *said)
    limits = steering_limits(robot.drive, robot.description.joint)
    for side, found in enumerate((limits.lower[0], limits.upper[0])):
        expected = own[side]
        if side in bound:
            right = -followers[1 - side]
            expected = numbers.atan(1.0 / (1.0 / numbers.tan(right) - w / L))
        step = abs(own[side]) / 250
        assert abs(expected) - step - 1e-9 <= abs(found) <= abs(expected) + 1e-9
        assert found * expected > 0.0


def test_the_tightest_bend_is_that_of_the_side_that_steers_less(tmp_path: Path) -> None:
    """P's radius is L/tan δ of the lesser limit, and half the track more for a wheel beside."""
    robot = bicycle(tmp_path, -0.4, 0.7)
    radius = turning_radius(robot.drive, robot.description.joint)
    assert radius == pytest.approx(0.8 / numbers.tan(0.4))
    robot = car(tmp_path, 'lower="-0.6" upper="0.9"', 'lower="-1.2" upper="1.2"')
    expected = 0.7 / numbers.tan(0.6) + 0.25
    assert turning_radius(robot.drive, robot.description.joint) == pytest.approx(expected)


def test_how_far_off_the_reference_wheels_may_point(tmp_path: Path) -> None:
    """With an axle up to 45°; without one a share of how far P is from the line of the two that
    lead, 0.3 m here, in lengths of how far the furthest of them is, 0.5 m."""
    assert max_deviation(bicycle(tmp_path, -0.4, 0.7).drive) == 1.0
    corners = rpctl.load(write(tmp_path, vehicle("steered")))
    assert max_deviation(corners.drive) == pytest.approx(0.8 * 0.3 / 0.5)
