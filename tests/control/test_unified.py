"""The unified law: least cost, the gains it says, and the limits of its closed loop."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from rpctl import PaperKinematic, Robot, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.reference.named import reference_by_name
from rpctl.reference.paths import eight
from tests.control.unicycle import (
    NO_JOINTS,
    along,
    asked,
    follow,
    jacobian,
    sampled_step,
    steady,
    twist_of,
)

LAW = UnifiedKinematic(horizon=0.4, beta=1.5, bend=0.1, weight=0.01)
PAPER = PaperKinematic(0.4, 1.5)
FAR = np.array([0.3, 0.5, 0.8])


def gains(law: UnifiedKinematic, v: float) -> tuple[float, float]:
    """Return K2 and K3 as the law's description has them."""
    h, w = law.numbers()["horizon"], law.weight
    size = 0.25 * h**2 * v**2 + w
    return 0.5 * v / size, (0.5 * h * v**2 + w / h) / size


def test_the_closed_form_minimises_the_cost(rng: np.random.Generator) -> None:
    """x2 by its first two derivatives, as the error kinematics have them where x1 = 0."""
    for _ in range(20):
        v, omega, x2 = rng.normal(size=3)
        x3 = rng.uniform(-1.5, 1.5)
        h, w = 0.2 + rng.random(), 0.1 * np.exp(rng.normal())

        def cost(d: float, v: float = v, x2: float = x2, x3: float = x3, h: float = h,
                 w: float = w) -> float:  # fmt: skip
            rate, bend = v * math.sin(x3), -v * math.cos(x3) * d
            return float((x2 + h * rate + 0.5 * h**2 * bend) ** 2 + w * (x3 - h * d) ** 2)

        law = UnifiedKinematic(horizon=h, weight=w)
        d = asked(law, steady(v, omega), np.array([0.0, x2, x3]))[2] - omega
        best = minimize_scalar(cost, bracket=(d - 1.0, d + 1.0), tol=1e-12)
        assert d == pytest.approx(best.x, abs=1e-6 * (1 + abs(d)))


GRID = list(itertools.product((-1.5, 0.0, 0.05, 0.6), (-1.2, 0.0, 0.8), (0.1, 2.0), (1e-4, 1.0)))


@pytest.mark.parametrize(("v", "omega", "horizon", "weight"), GRID)
def test_poles_are_those_of_the_gains(
    v: float, omega: float, horizon: float, weight: float
) -> None:
    """−1/h, and those of [[−β s ω, v], [−K2, −K3]]: in the left half where (v, ω) ≠ 0."""
    law = UnifiedKinematic(horizon=horizon, weight=weight)
    k2, k3 = gains(law, v)
    turning = law.beta * omega**2 / math.hypot(omega, law.bend * v) if omega else 0.0
    block = np.linalg.eigvals([[-turning, v], [-k2, -k3]])
    expected = np.poly([-1.0 / horizon, *block])
    found = np.poly(jacobian(law, steady(v, omega)))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    if v or omega:
        assert block.real.max() < 0.0
    else:
        assert block.real.max() == 0.0


def test_figures_on_a_line() -> None:
    """v_r = 0.7 m/s from the first moment on: after 20 s the paper's law keeps 0.60 m."""
    times, line = np.array([0.0, 20.0]), steady(0.7, 0.0)
    lateral = abs(follow(LAW, line, FAR, times, (1e-6, 1e-24))[-1, 1])
    assert lateral == pytest.approx(2.6e-19, rel=0.05)
    assert abs(follow(PAPER, line, FAR, times)[-1, 1]) == pytest.approx(0.596, abs=5e-4)


def test_figures_on_an_eight() -> None:
    """x = 2 sin s, y = sin 2s, one lap in 20 s without a soft start: rms position error."""
    times, motion = np.linspace(0.0, 20.0, 2001), along(eight(2.0, 1.0), 2.0 * math.pi / 20.0)

    def rms(e: Array) -> float:
        return float(np.sqrt(np.mean(e[:, 0] ** 2 + e[:, 1] ** 2)))

    accuracy = (1e-7, 1e-9)
    assert rms(follow(LAW, motion, FAR, times, accuracy)) == pytest.approx(0.057, abs=5e-4)
    assert rms(follow(PAPER, motion, FAR, times, accuracy)) == pytest.approx(0.474, abs=5e-4)


@pytest.mark.parametrize(
    ("v", "omega", "e0"),
    [
        (0.3, 0.0, (0.3, 0.5, 0.8)),
        (-0.3, 0.0, (-0.3, -0.5, -2.0)),
        (0.0, 0.5, (0.0, 1.0, 0.0)),
        (0.4, 0.4, (1.0, 0.0, 3.0)),
    ],
)
def test_it_converges_everywhere(v: float, omega: float, e0: tuple[float, float, float]) -> None:
    """Lines, reverse and spins, also from the wrong heading, with the settings as they come."""
    last = follow(UnifiedKinematic(), steady(v, omega), np.array(e0), np.array([0, 80.0]))
    assert np.abs(last[-1]).max() < 1e-6


def amplitude(law: UnifiedKinematic, reference: ReferenceState, period: float) -> float:
    """Return the size of a small error after many samples."""
    e = 1e-6 * np.array([0.0, -0.5, 0.7])
    for _ in range(4000):
        e = sampled_step(law, reference, e, period)
        if np.abs(e).max() > 1e-3:
            break
    return float(np.abs(e).max())


@pytest.mark.parametrize("v", [0.1, 0.4, -1.5])
def test_the_sampled_limit_of_a_line_brackets_stability(v: float) -> None:
    limit = 2.0 / gains(LAW, v)[1]
    assert 0.4 <= limit <= 0.8
    assert amplitude(LAW, steady(v, 0.0), 0.99 * limit) < 1e-9
    assert amplitude(LAW, steady(v, 0.0), 1.01 * limit) > 1e-3


def test_nothing_jumps_when_a_motion_starts(paper: Robot) -> None:
    """From standstill on the share of the lateral error is that of the curve to come."""
    reference = reference_by_name(paper, "circle")
    law = UnifiedKinematic()
    still, soon = (reference(t)._replace(joint_rates=NO_JOINTS) for t in (0.0, 1e-3))
    first = asked(law, still, FAR)
    np.testing.assert_allclose(first, asked(law, soon, FAR), atol=1e-6)
    blind = asked(law, still._replace(direction=None), FAR)
    assert abs(blind[0] - first[0]) > 0.1


def test_without_a_bend_the_sign_is_the_papers(rng: np.random.Generator) -> None:
    """And without speed the turn is: both laws then are one."""
    state, e = steady(0.0, 0.7), rng.normal(size=3)
    laws, own = (UnifiedKinematic(0.4, beta=1.5, bend=0.0), PAPER), rng.normal(size=3)
    ours, theirs = (twist_of(law, state, e, own) for law in laws)
    np.testing.assert_allclose(ours.value, theirs.value, atol=1e-12)
    np.testing.assert_allclose(ours.rate, theirs.rate, atol=1e-12)
