"""Bounds on the joints' accelerations, by the formulas of :class:`JointLimits`."""

from __future__ import annotations

import math as numbers
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, math, scale_limits
from rpctl.arrays import Array
from rpctl.control.joint_limits import (
    JointLimits,
)
from tests.control.referee import Bounds, joint_bounds

APPROACH_TIME, BRAKE_FRACTION, LIMIT_MARGIN = 0.06, 0.5, 1e-3  # s, and shares
PERIOD, H1 = 0.002, 0.15
DOWN, UP = 4.0, 16.0  # what the efforts can brake a joint with that rises, and one that falls
NAME = "arm_prismatic_joint"


@pytest.fixture(scope="module")
def quick(paper: Robot) -> ReducedDynamics:
    """The paper's robot, its rates all but without limits: positions are what binds."""
    return ReducedDynamics(scale_limits(paper, velocity=1e3))


def evaluated(limits: JointLimits, nq: int, doubt: bool = False) -> Any:
    """Return bounds, or whether they may be broken, as a function of q, ẋ, ẍ and brakes."""
    count = len(limits.names)
    sizes = {"q": nq, "rate": count, "acceleration": count, "down": count, "up": count}
    q, rate, acceleration, *brakes = inputs = [math.SX.sym(*size) for size in sizes.items()]
    if doubt:
        outputs = [limits.doubtful(q, rate, acceleration, H1)]
    else:
        pairs = list(zip(*map(math.vertsplit, brakes), strict=True))
        outputs = [math.densify(each) for each in limits.bounds(q, rate, pairs, H1)]
    return math.Function("bounds", inputs, outputs)


def bounds_at(dynamics: ReducedDynamics, x: float, rate: float) -> tuple[Bounds, int]:
    """Return the bounds where the prismatic joint is at x (m) and moves, and its index."""
    limits = JointLimits(dynamics.robot, PERIOD)
    rates, index = np.zeros(len(limits.names)), limits.names.index(NAME)
    rates[index] = rate
    q = dynamics.robot.configuration(joints={NAME: x})
    brakes = (np.full(len(rates), DOWN), np.full(len(rates), UP))
    found = evaluated(limits, len(q))(q, rates, rates, *brakes)
    return Bounds(*(each.full().ravel() for each in found)), index


@pytest.mark.parametrize("name", ["paper", pytest.param("car", marks=pytest.mark.slow)])
def test_bounds_and_where_they_may_be_broken(name: str, rng: np.random.Generator) -> None:
    """They are NumPy's; none is broken where there is no doubt, and mostly, there is no doubt."""
    robot = rpctl.load(name)
    limits = JointLimits(robot, PERIOD)
    count = len(limits.names)
    bounds, doubts = (evaluated(limits, robot.nq, doubt) for doubt in (False, True))
    broken = doubted = by_position = 0
    for k in range(120):
        at = robot.random_configuration(rng)
        if k % 4 == 1:
            at[4:] += 0.2 * rng.normal(size=robot.nq - 4)  # some beyond their limits
        v, a = (rng.choice([0.0, 0.1, 1.0]) * rng.normal(size=count) for _ in range(2))
        brakes = 10.0 ** rng.uniform(-2.0, 5.0, size=(2, count))
        wanted = joint_bounds(limits, at, v, (brakes[0], brakes[1]), H1)
        for mine, theirs in zip(bounds(at, v, a, *brakes), wanted, strict=True):
            given = np.asarray(theirs, float)
            np.testing.assert_allclose(mine.full().ravel(), given, rtol=1e-12, atol=1e-12)
        beyond = bool(((a < wanted.lower) | (a > wanted.upper)).any())
        doubtful = bool(doubts(at, v, a, *brakes))
        assert doubtful or not beyond
        broken, doubted = broken + beyond, doubted + doubtful
        by_position += int(wanted.by_lower.sum() + wanted.by_upper.sum())
    assert 10 < broken < doubted < 110
    assert by_position > 10


def ends(dynamics: ReducedDynamics) -> Array:
    """Return the joint's limits (2,), m, less the room that is kept free of them."""
    joint = dynamics.robot.description.joint[NAME]
    room = LIMIT_MARGIN * (joint.upper - joint.lower)
    return np.array([joint.lower + room, joint.upper - room])


def stop(gap: float, brake: float) -> float:
    """Return √(2a (g − ½ a h1²)), with the share of the brake that is counted on."""
    a = BRAKE_FRACTION * brake
    assert gap > a * H1**2
    return numbers.sqrt(2.0 * a * (gap - 0.5 * a * H1**2))


def test_a_joint_may_be_as_fast_as_it_can_still_be_braked(quick: ReducedDynamics) -> None:
    """Rising is braked by what pushes down, falling by what pushes up."""
    lower, upper = ends(quick)
    x = lower + 0.45 * (upper - lower)
    bounds, index = bounds_at(quick, x, 0.0)
    assert bounds.upper[index] == pytest.approx(stop(upper - x, DOWN) / APPROACH_TIME)
    assert bounds.lower[index] == pytest.approx(-stop(x - lower, UP) / APPROACH_TIME)
    assert bounds.by_lower[index]
    assert bounds.by_upper[index]


def test_near_a_limit_the_gap_closes_as_an_exponential(quick: ReducedDynamics) -> None:
    """stop(g) = g/h1 where g < a h1²; the gap is that at the end of the time looked ahead."""
    lower, upper = ends(quick)
    gap, rate = 0.01, 0.05
    bounds, index = bounds_at(quick, upper - gap, rate)
    ahead = gap - APPROACH_TIME * rate
    assert bounds.upper[index] == pytest.approx((ahead / H1 - rate) / APPROACH_TIME)
    bounds, index = bounds_at(quick, lower + gap, -rate)
    assert bounds.lower[index] == pytest.approx(-(ahead / H1 - rate) / APPROACH_TIME)


def test_no_more_is_asked_than_the_efforts_give(quick: ReducedDynamics) -> None:
    """Beyond a limit and on its way out, a joint is braked with all there is on that side."""
    lower, upper = ends(quick)
    bounds, index = bounds_at(quick, upper + 0.1, 5.0)
    assert bounds.upper[index] == -DOWN
    bounds, index = bounds_at(quick, lower - 0.1, -5.0)
    assert bounds.lower[index] == UP


def test_a_slow_joint_is_bound_by_its_rate(paper: Robot) -> None:
    """(1 − room) times the velocity limit either way, and the limit is called so."""
    dynamics = ReducedDynamics(scale_limits(paper, velocity=0.02))
    fastest = (1.0 - LIMIT_MARGIN) * dynamics.robot.description.joint[NAME].velocity
    rate = 0.5 * fastest
    bounds, index = bounds_at(dynamics, float(ends(dynamics).mean()), rate)
    assert bounds.upper[index] == pytest.approx((fastest - rate) / APPROACH_TIME)
    assert bounds.lower[index] == pytest.approx((-fastest - rate) / APPROACH_TIME)
    assert not bounds.by_upper[index]
    assert not bounds.by_lower[index]
