"""Gains of base and joints: the margins they leave at a period, and what is told of them."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from rpctl import (
    BoundedDynamic,
    EndEffector,
    IntegralDynamic,
    PaperDynamic,
    ReducedDynamics,
    Robot,
    UnifiedKinematic,
)
from rpctl.control.bandwidth import at_bandwidth, gains_of, knowing_delay, usual_gains
from rpctl.control.registry import law_sentences

PERIODS = [0.001, 0.002, 0.01, 0.05, 0.2]


def poles(period: float) -> tuple[float, float, float]:
    """Return 1/h, 1/h1 and k."""
    _, h, h1, k = usual_gains(period)
    return 1.0 / h, 1.0 / h1, k


@pytest.mark.parametrize("period", PERIODS)
def test_half_a_period_and_50_ms_leave_27_degrees_of_phase(period: float) -> None:
    """74° − 0.8 rad at the bandwidth, which is 2 % below the crossover."""
    a, b, k = poles(period)

    def open_loop(w: float) -> complex:
        s = 1j * w
        loop = ((a + b + k) * s**2 + (a * b + b * k + a * k) * s + a * b * k) / s**3
        return loop * cmath.exp(-s * (0.5 * period + 0.05))

    crossover = brentq(lambda w: abs(open_loop(w)) - 1.0, 0.5 * (a + b + k), 2.0 * (a + b + k))
    margin = math.degrees(cmath.phase(-open_loop(crossover)))
    assert 26.0 < margin < 29.0
    bandwidth = usual_gains(period).bandwidth
    assert crossover == pytest.approx(2.0 * math.pi * bandwidth, rel=0.05)


def test_base_and_joints_have_the_gains_of_their_period_where_none_are_set(tiago: Robot) -> None:
    """At 50 ms Ω = 0.8/(0.025 + 0.05) = 32/3; its parts are 1/11, 4/11 and 6/11."""
    dynamics, law, count = ReducedDynamics(tiago), IntegralDynamic(), len(tiago.joints)
    numbers = law.numbers_on(dynamics, 0.05)
    np.testing.assert_allclose(1.0 / numbers["time"], np.full(2 + count, 128.0 / 33.0))
    assert numbers["horizon_dyn"] == numbers["time"][0]
    np.testing.assert_allclose(numbers["gain"], np.full(2 + count, 64.0 / 11.0))
    asked = UnifiedKinematic().numbers_on(dynamics, 0.05)
    np.testing.assert_allclose(asked["joint_horizons"], np.full(count, 33.0 / 32.0))
    assert asked["horizon"] == pytest.approx(33.0 / 32.0)
    law = IntegralDynamic(15.0, joint_gain=5.0)
    base, *joints = law.numbers_on(dynamics, 0.05)["gain"][1:]
    assert (base, *joints) == (15.0, *[5.0] * count)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize(
    ("inertia", "stable"), [(0.5, True), (1.0, True), (10.0, True), (20.0, False)]
)
def test_the_sampled_loop_stands_another_inertia(
    period: float, inertia: float, stable: bool
) -> None:
    """ẍ = u held, u as law and integral have it: all eigenvalues lie within the unit circle."""
    a, b, k = poles(period)
    T, g = period, 1.0 / inertia
    hold = np.array([[1.0, T, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    asked = -np.array([a * b + a * k, a + b + k, k * b])  # of x, ẋ and ∫(ẋ + a x)
    step = hold + np.outer([0.5 * g * T**2, g * T, 0.0], asked)
    step[2] += [a * T, T, 0.0]
    assert (np.abs(np.linalg.eigvals(step)).max() < 1.0) == stable


def test_a_bandwidth_reaches_the_joints_of_all_laws() -> None:
    _, h, h1, k = gains_of(5.0)
    law = at_bandwidth(IntegralDynamic(gain=8.0), 5.0)
    assert law == IntegralDynamic(8.0, BoundedDynamic(joint_horizon_dyn=h1), k)
    assert at_bandwidth(UnifiedKinematic(), 5.0) == UnifiedKinematic(joint_horizon=h)
    within = at_bandwidth(EndEffector(base=UnifiedKinematic()), 5.0)
    assert within == EndEffector(base=UnifiedKinematic(joint_horizon=h))
    assert at_bandwidth(len, 5.0) is len


def test_the_gains_are_told_and_what_a_law_ignores(paper: Robot) -> None:
    dynamics, law = ReducedDynamics(paper), UnifiedKinematic()
    (told,) = law_sentences(dynamics, law, IntegralDynamic(), 0.002)
    assert told == (
        "gains: 2.5 Hz (h 0.7 s, h1 0.18 s, k 8.6 1/s), as half a period and 50 ms of delay allow"
    )
    (late,) = law_sentences(dynamics, law, IntegralDynamic(), 0.05)
    assert late.startswith("gains: 1.7 Hz (h 1 s, h1 0.26 s, k 5.8 1/s)")
    partly = UnifiedKinematic(joint_horizon=0.3), IntegralDynamic(15.0, joint_gain=5.0)
    as_set = "; as set: joints h 0.3 s, base k 15 1/s, joints k 5 1/s"
    assert law_sentences(dynamics, *partly, 0.002) == (f"{told}{as_set}",)
    within = BoundedDynamic(joint_horizon_dyn=0.05)
    for by_hand in (within, IntegralDynamic(inner=within)):
        assert law_sentences(dynamics, law, by_hand, 0.002) == (
            f"{told}; as set: joints h1 0.05 s",
        )
    assert law_sentences(dynamics, law, None, 0.002) == ()
    (ignored,) = law_sentences(dynamics, law, PaperDynamic(), 0.002)
    assert "limits of efforts, rates and positions" in ignored
    assert "and the sampling" in ignored
    assert "sampling" not in law_sentences(dynamics, law, PaperDynamic(midpoint=True), 0.002)[0]


def test_joints_are_quicker_where_a_delay_is_told() -> None:
    """Ω is .8 over half a period, 16 ms and .3 of the delay: 47.1, and 25 1/s at 50 ms."""
    law = IntegralDynamic(inner=BoundedDynamic(joint_horizon_dyn=0.1))
    assert knowing_delay(law, 0.002, None) is law
    found = knowing_delay(law, 0.002, 0.0)
    assert found.joint_gain == pytest.approx(0.8 / 0.017 * 6.0 / 11.0)
    assert (found.gain, found.inner.joint_horizon_dyn, found.inner.horizon_dyn) == (15.0, 0.1, None)
    assert knowing_delay(law, 0.002, 0.1).gain == pytest.approx(0.8 / 0.047 * 6.0 / 11.0)
    asked = knowing_delay(UnifiedKinematic(), 0.002, 0.05)
    assert asked.joint_horizon == pytest.approx(11.0 / 25.0)
    assert asked.horizon is None
    end = knowing_delay(EndEffector(base=UnifiedKinematic()), 0.002, 0.05)
    assert end.base.joint_horizon == asked.joint_horizon
