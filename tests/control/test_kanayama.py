"""Kanayama's law: its Lyapunov function falls as published, and the gains damp critically."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl import Kanayama
from rpctl.arrays import Array
from tests.control.unicycle import asked, error_rate, follow, jacobian, steady

LAW = Kanayama()


def lyapunov(e: Array) -> float:
    return float(0.5 * (e[0] ** 2 + e[1] ** 2) + (1.0 - math.cos(e[2])) / LAW.ky)


def test_the_lyapunov_function_falls_as_published(rng: np.random.Generator) -> None:
    """V̇ = −Kx x1² − |v_r| Kθ sin² x3/Ky, V̇ by the chain rule."""
    for _ in range(20):
        (v, omega), e = rng.normal(size=2), rng.normal(size=3)
        reference = steady(v, omega)
        e_dot = error_rate(e, reference, asked(LAW, reference, e))
        gradient = np.array([e[0], e[1], math.sin(e[2]) / LAW.ky])
        expected = -LAW.kx * e[0] ** 2 - abs(v) * LAW.ktheta * math.sin(e[2]) ** 2 / LAW.ky
        assert gradient @ e_dot == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("v", [0.4, -0.4])
def test_it_converges_forward_and_backward(v: float) -> None:
    times = np.linspace(0.0, 30.0, 301)
    errors = follow(LAW, steady(v, 0.3), np.array([0.3, 0.5, 0.8]), times)
    assert (np.diff([lyapunov(e) for e in errors]) <= 1e-12).all()
    assert np.abs(errors[-1]).max() < 1e-6


@pytest.mark.parametrize("v", [0.4, -1.3])
def test_the_gains_damp_critically(v: float) -> None:
    """On a line x2 and x3 share a double pole at −√Ky |v|."""
    pole = -math.sqrt(LAW.ky) * abs(v)
    found = np.poly(jacobian(LAW, steady(v, 0.0)))
    np.testing.assert_allclose(found, np.poly([-LAW.kx, pole, pole]), rtol=1e-6)


def test_a_spin_keeps_its_heading_error() -> None:
    last = follow(LAW, steady(0.0, 0.5), np.array([0.1, 0.1, 0.4]), np.array([0.0, 9.0]))
    assert last[-1, 2] == pytest.approx(0.4)
