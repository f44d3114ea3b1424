"""The leash on the tracking error: what it bounds, what it leaves, and that its rate is exact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl import (
    Leash,
    ReducedDynamics,
    Robot,
)
from rpctl.control.error import SERIES_RADIUS, Tracking
from rpctl.control.registry import kinematic_by_name
from rpctl.reference.named import reference_by_name
from tests.control.unicycle import steady

LEASH = Leash(0.3, 0.7)
STATE = steady(0.4, 0.2)
STEP = 1e-6
LEASHED = ("unified", "kanayama", "feedback-linearization")


def test_the_error_stays_on_the_leash(rng: np.random.Generator) -> None:
    """Its direction stays, its length grows with the error and never beyond the leash."""
    for _ in range(20):
        e = rng.normal(size=5) * [3.0, 3.0, 2.0, 1.0, 1.0]
        near = LEASH(Tracking(STATE, e, np.zeros(5))).e
        assert math.hypot(*near[:2]) == pytest.approx(0.3 * math.tanh(math.hypot(*e[:2]) / 0.3))
        assert near[0] * e[1] == pytest.approx(near[1] * e[0])
        assert near[:2] @ e[:2] > 0.0
        assert near[2] == pytest.approx(0.7 * math.tanh(e[2] / 0.7))
        np.testing.assert_array_equal(near[3:], e[3:])


@pytest.mark.parametrize("size", [1e-9, 0.5 * SERIES_RADIUS, 2.0 * SERIES_RADIUS, 0.3, 3.0])
def test_the_rate_is_exact(size: float, rng: np.random.Generator) -> None:
    for _ in range(5):
        e, rate = size * rng.normal(size=4), rng.normal(size=4)
        step = STEP * max(size, 1e-3)
        ahead, behind = (LEASH(Tracking(STATE, e + s * rate, rate)).e for s in (step, -step))
        found = LEASH(Tracking(STATE, e, rate)).e_dot
        np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-7)


def test_near_the_reference_it_leaves_the_error_as_it_is(rng: np.random.Generator) -> None:
    """To third order: of an error of a thousandth of the leash a millionth."""
    e, rate = 1e-3 * rng.uniform(-1.0, 1.0, (2, 3)) * [0.3, 0.3, 0.7]
    near = LEASH(Tracking(STATE, e, rate))
    np.testing.assert_allclose(near.e, e, rtol=1e-6)
    np.testing.assert_allclose(near.e_dot, rate, atol=3e-6 * np.abs(rate).max())
    still = LEASH(Tracking(STATE, np.zeros(3), rate))
    np.testing.assert_array_equal(still.e, np.zeros(3))
    np.testing.assert_allclose(still.e_dot, rate, rtol=1e-15)


@pytest.mark.parametrize("name", LEASHED)
def test_a_far_start_asks_for_bounded_speeds(paper: Robot, name: str) -> None:
    """Without a leash v_d grows with the square of the error, or with the error."""
    dynamics = ReducedDynamics(paper)
    law = kinematic_by_name(name).start(dynamics, 0.01)
    reference = reference_by_name(paper, "reverse")
    pose, nu = reference(4.0).pose, np.array([-0.3, 0.0, 0.0, 0.0])
    for far in (3.0, 1e3):
        for angle in np.linspace(-math.pi, math.pi, 9):
            q = paper.configuration(pose[0] + far, pose[1] - far, angle)
            nu_d, nu_d_dot = law(dynamics, reference, 4.0, q, nu)
            assert np.abs(nu_d).max() < 6.0
            assert np.isfinite(nu_d_dot).all()
