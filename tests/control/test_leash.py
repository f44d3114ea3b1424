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
from rpctl import math as scalars
from rpctl.arrays import Array
from rpctl.control.error import SERIES_RADIUS
from rpctl.control.registry import kinematic_by_name
from rpctl.kernels.sheet import Evaluator, Sheet
from rpctl.reference.named import reference_by_name

LEASH = Leash(0.3, 0.7)
STEP = 1e-6
LEASHED = ("unified", "kanayama", "feedback-linearization")


@pytest.fixture(scope="module")
def leashed() -> Evaluator:
    """An error (3,) and its rate on the leash."""
    sheet, e, e_dot = Sheet(), *(scalars.SX.sym(name, 3) for name in ("e", "e_dot"))
    for k in range(3):
        sheet.moves(e[k], e_dot[k])
    found = LEASH(sheet, scalars.vertsplit(e))
    rates = [sheet.rate(each) for each in found]
    values = [scalars.vertcat(*part) for part in (found, rates)]
    return Evaluator(scalars.Function("leash", [e, e_dot], sheet.resolved(values)))


def test_the_error_stays_on_the_leash(leashed: Evaluator, rng: np.random.Generator) -> None:
    """Its direction stays, its length grows with the error and never beyond the leash."""
    for _ in range(20):
        e = rng.normal(size=3) * [3.0, 3.0, 2.0]
        near, _ = leashed(e, np.zeros(3))
        assert math.hypot(*near[:2]) == pytest.approx(0.3 * math.tanh(math.hypot(*e[:2]) / 0.3))
        assert near[0] * e[1] == pytest.approx(near[1] * e[0])
        assert near[:2] @ e[:2] > 0.0
        assert near[2] == pytest.approx(0.7 * math.tanh(e[2] / 0.7))


@pytest.mark.parametrize("size", [1e-9, 0.5 * SERIES_RADIUS, 2.0 * SERIES_RADIUS, 0.3, 3.0])
def test_the_rate_is_exact(leashed: Evaluator, size: float, rng: np.random.Generator) -> None:
    for _ in range(5):
        e, rate = size * rng.normal(size=3), rng.normal(size=3)
        step = STEP * max(size, 1e-3)
        ahead, behind = (leashed(e + s * rate, rate)[0] for s in (step, -step))
        np.testing.assert_allclose(leashed(e, rate)[1], (ahead - behind) / (2 * step), atol=1e-7)


def test_near_the_reference_it_leaves_the_error_as_it_is(
    leashed: Evaluator, rng: np.random.Generator
) -> None:
    """To third order: of an error of a thousandth of the leash a millionth."""
    e, rate = 1e-3 * rng.uniform(-1.0, 1.0, (2, 3)) * [0.3, 0.3, 0.7]
    near, near_rate = leashed(e, rate)
    np.testing.assert_allclose(near, e, rtol=1e-6)
    np.testing.assert_allclose(near_rate, rate, atol=3e-6 * np.abs(rate).max())
    still: list[Array] = leashed(np.zeros(3), rate)
    np.testing.assert_array_equal(still[0], np.zeros(3))
    np.testing.assert_allclose(still[1], rate, rtol=1e-15)


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
