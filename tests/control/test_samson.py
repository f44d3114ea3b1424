"""Samson's law: its Lyapunov function falls as published, from anywhere and near a heading of 0."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import Samson
from rpctl.arrays import Array
from tests.control.unicycle import asked, error_rate, follow, jacobian, steady, twist_of

LAW = Samson(b=9.0, zeta=0.6)


def gain(v: float, omega: float) -> float:
    return float(2.0 * LAW.zeta * np.sqrt(omega**2 + LAW.b * v**2))


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-9, 0.0])
def test_the_lyapunov_function_falls_as_published(size: float, rng: np.random.Generator) -> None:
    """V = ½ b (x1² + x2²) + ½ x3², V̇ = −b k x1² − k x3², by the chain rule."""
    for _ in range(20):
        (v, omega), e = rng.normal(size=2), rng.normal(size=3)
        e[2] *= size
        reference, k = steady(v, omega), gain(v, omega)
        e_dot = error_rate(e, reference, asked(LAW, reference, e))
        found = np.array([LAW.b * e[0], LAW.b * e[1], e[2]]) @ e_dot
        assert found == pytest.approx(-LAW.b * k * e[0] ** 2 - k * e[2] ** 2, abs=1e-12)


@pytest.mark.parametrize("omega", [0.0, 0.3, -2.0])
@pytest.mark.parametrize("v", [0.4, -1.3, 0.0])
def test_its_poles_are_those_of_the_book(v: float, omega: float) -> None:
    """(λ + 2 ζ a)(λ² + 2 ζ a λ + a²) with a = √(ω² + b v²)."""
    a, middle = np.hypot(omega, 3.0 * v), gain(v, omega)
    expected = np.convolve([1.0, middle], [1.0, middle, a**2])
    np.testing.assert_allclose(np.poly(jacobian(LAW, steady(v, omega))), expected, atol=1e-5)


@pytest.mark.parametrize(("v", "omega"), [(0.4, 0.0), (-0.4, 0.3), (0.0, 0.5)])
def test_it_converges_forward_backward_and_on_a_spin(v: float, omega: float) -> None:
    times = np.linspace(0.0, 60.0, 61)
    errors = follow(LAW, steady(v, omega), np.array([0.3, 0.5, 0.8]), times)
    values = errors**2 @ [LAW.b, LAW.b, 1.0]
    assert (np.diff(values) <= 1e-12).all()
    assert np.abs(errors[-1]).max() < 1e-5


@pytest.mark.parametrize("heading", [0.0, 1e-12, 9e-3, 1.1e-2])
def test_the_rate_is_exact_near_a_heading_of_0(heading: float) -> None:
    """Where v_r and x2 alone are not 0, x3 turns at −ω: sinc's slope is −x3/3 there."""
    e, reference = np.array([0.0, 0.2, heading]), steady(0.5, 0.0)
    own = np.array([0.5, 0.0, 0.7])
    e_dot, k = error_rate(e, reference, own), gain(0.5, 0.0)
    slope = -heading / 3.0 + heading**3 / 30.0
    sinc = 1.0 - heading**2 / 6.0
    expected = 4.5 * (e_dot[1] * sinc + 0.2 * slope * e_dot[2]) + k * e_dot[2]
    assert twist_of(LAW, reference, e, own).rate[2] == pytest.approx(expected, abs=1e-8)


def test_it_is_still_where_its_reference_is() -> None:
    found: list[Array] = list(twist_of(LAW, steady(0.0, 0.0), np.array([0.1, 0.2, 0.3])))
    assert not np.any(found)
