"""Bounds on the joints' accelerations, by the formulas of :class:`JointLimits`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot, scale_limits
from rpctl.arrays import Array
from rpctl.control.joint_limits import (
    APPROACH_TIME,
    BRAKE_FRACTION,
    LIMIT_MARGIN,
    JointBounds,
    JointLimits,
)
from rpctl.control.law import Limit

PERIOD, H1 = 0.002, 0.15
DOWN, UP = 4.0, 16.0  # what the efforts can brake a joint with that rises, and one that falls
NAME = "arm_prismatic_joint"


@pytest.fixture(scope="module")
def quick(paper: Robot) -> ReducedDynamics:
    """The paper's robot, its rates all but without limits: positions are what binds."""
    return ReducedDynamics(scale_limits(paper, velocity=1e3))


def bounds_at(dynamics: ReducedDynamics, x: float, rate: float) -> tuple[JointBounds, int]:
    """Return the bounds where the prismatic joint is at x (m) and moves, and its index."""
    limits = JointLimits(dynamics, PERIOD, H1)
    rates, index = np.zeros(len(limits.names)), limits.names.index(NAME)
    rates[index] = rate
    q = dynamics.robot.configuration(joints={NAME: x})
    brakes = (np.full(len(rates), DOWN), np.full(len(rates), UP))
    return limits.bounds(q, rates, brakes), index


def ends(dynamics: ReducedDynamics) -> Array:
    """Return the joint's limits (2,), m, less the room that is kept free of them."""
    joint = dynamics.robot.description.joint[NAME]
    room = LIMIT_MARGIN * (joint.upper - joint.lower)
    return np.array([joint.lower + room, joint.upper - room])


def stop(gap: float, brake: float) -> float:
    """Return √(2a (g − ½ a h1²)), with the share of the brake that is counted on."""
    a = BRAKE_FRACTION * brake
    assert gap > a * H1**2
    return math.sqrt(2.0 * a * (gap - 0.5 * a * H1**2))


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


def test_a_limit_has_its_name(quick: ReducedDynamics) -> None:
    lower, upper = ends(quick)
    limits = JointLimits(quick, PERIOD, H1)
    bounds, index = bounds_at(quick, 0.5 * (lower + upper), 0.0)
    assert limits.limit(index, bounds, True) == Limit(NAME, "upper")
    assert limits.limit(index, bounds, False) == Limit(NAME, "lower")


def test_a_slow_joint_is_bound_by_its_rate(paper: Robot) -> None:
    """(1 − room) times the velocity limit either way, and the limit is called so."""
    dynamics = ReducedDynamics(scale_limits(paper, velocity=0.02))
    fastest = (1.0 - LIMIT_MARGIN) * dynamics.robot.description.joint[NAME].velocity
    limits = JointLimits(dynamics, PERIOD, H1)
    rate = 0.5 * fastest
    bounds, index = bounds_at(dynamics, float(ends(dynamics).mean()), rate)
    assert bounds.upper[index] == pytest.approx((fastest - rate) / APPROACH_TIME)
    assert bounds.lower[index] == pytest.approx((-fastest - rate) / APPROACH_TIME)
    assert limits.limit(index, bounds, True) == Limit(NAME, "velocity")
    assert limits.limit(index, bounds, False) == Limit(NAME, "velocity")
