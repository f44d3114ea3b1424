"""Dynamic feedback linearisation: linear error dynamics, and what its singularity needs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import rpctl
from rpctl import FeedbackLinearization, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import eight
from tests.control.unicycle import StateOverTime, Twist, along, error_rate, steady, twist_of

LAW = FeedbackLinearization(kp=2.0, kd=3.0, leash=None)


def ask(law: FeedbackLinearization, state: ReferenceState, e: Array, v: float) -> Twist:
    """Return what the law asks of a robot with the speed v."""
    return twist_of(law, state, e, np.array([v, 0.0, 0.3]))


def drive(law: FeedbackLinearization, motion: StateOverTime, x: Array, times: Array) -> Array:
    """Return errors and speed (K, 4) of a base that takes v̇_d and ω_d without delay."""

    def rate(t: float, x: Array) -> Array:
        state, (value, change) = motion(t), ask(law, motion(t), x[:3], x[3])
        twist = np.array([x[3], 0.0, value[2]])
        return np.append(error_rate(x[:3], state, twist), change[0])

    solution = solve_ivp(rate, (0.0, times[-1]), x, t_eval=times, rtol=1e-11, atol=1e-12)
    return np.asarray(solution.y.T)


def position_error(state: ReferenceState, x: Array) -> tuple[Array, Array]:
    """Return z and ż (2,) in the world's axes."""
    heading_r, heading = state.pose[2], state.pose[2] - x[2]
    cos, sin = math.cos(heading), math.sin(heading)
    z = np.array([cos * x[0] - sin * x[1], sin * x[0] + cos * x[1]])
    speed_r = state.twist[0] * np.array([math.cos(heading_r), math.sin(heading_r)])
    return z, speed_r - x[3] * np.array([cos, sin])


def test_the_error_is_linear() -> None:
    """z̈ + kd ż + kp z = 0 on an eight, in the world's axes."""
    motion, times = along(eight(), 0.4), np.linspace(0.0, 6.0, 25)
    start = np.array([0.1, -0.1, 0.2, motion(0.0).twist[0]])
    path = drive(LAW, motion, start, times)
    assert np.abs(path[:, 3]).min() > LAW.slowest
    loop = np.array([[0.0, 1.0], [-LAW.kp, -LAW.kd]])
    first = np.array(position_error(motion(0.0), start))
    for t, x in zip(times, path, strict=True):
        z = np.array(position_error(motion(t), x))
        np.testing.assert_allclose(z, expm(loop * t) @ first, atol=1e-8)


@pytest.mark.parametrize("v", [0.3, -0.3])
def test_the_robots_own_speed_is_the_laws_state(v: float) -> None:
    """v_d = v: a dynamic law then has v̇_d alone to follow."""
    twist = ask(LAW, steady(v, 0.2), np.array([0.2, -0.3, 0.4]), 0.17)
    assert twist.value[0] == pytest.approx(0.17)


def test_below_the_slowest_speed_it_does_not_blow_up() -> None:
    """ω_d goes on where it left off at v₀, and is zero at rest."""
    state, e = steady(0.3, 0.0), np.array([0.0, 0.2, 0.1])
    above, below = (ask(LAW, state, e, LAW.slowest + s).value[2] for s in (1e-9, -1e-9))
    assert above == pytest.approx(below, abs=1e-6)
    rates = [abs(ask(LAW, state, e, v).value[2]) for v in np.linspace(0.0, LAW.slowest, 9)]
    assert rates[0] == 0.0
    assert max(rates) == pytest.approx(abs(above), abs=1e-6)


def test_a_spin_is_refused(paper: Robot) -> None:
    with pytest.raises(RpctlError, match=r"turns on the spot.*--kinematic unified"):
        rpctl.track(paper, "spin", duration=1.0, kinematic=FeedbackLinearization())
