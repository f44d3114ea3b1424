"""Each kinematic law against its equations typed once more."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from rpctl import FeedbackLinearization, Kanayama, PaperKinematic, Samson, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.control.twist_law import BaseLaw
from rpctl.reference.motion import ReferenceState
from tests.control.unicycle import NO_JOINTS, twist_of

Typed = Callable[[ReferenceState, Array, float], Array]  # of reference, error and own speed


def coupled(state: ReferenceState, e: Array, omega_d: float, b: float, h: float) -> Array:
    v, (x1, x2, x3) = state.twist[0], e
    v_d = v * math.cos(x3) + x2 * omega_d - b * (v * math.sin(x3) - x1 * omega_d)
    return np.array([v_d + (x1 - b * x2) / h, omega_d])


def paper(state: ReferenceState, e: Array, own: float) -> Array:
    omega_r = state.twist[2]
    return coupled(state, e, omega_r + e[2] / 0.8, 1.5 * omega_r / math.hypot(omega_r, 0.3), 0.8)


def unified(state: ReferenceState, e: Array, own: float) -> Array:
    assert state.direction is not None
    h, w, v, omega_r = 0.70125, 0.02, state.twist[0], state.twist[2]  # h = 11 · 51 ms/0.8
    p2 = e[1] + h * v * math.sin(e[2])
    a = 0.5 * h**2 * v * max(math.cos(e[2]), 0.0)
    d = (a * p2 + w * h * e[2]) / (a**2 + w * h**2)
    g_v, _, g_omega = state.direction[0]
    return coupled(state, e, omega_r + d, 1.25 * g_omega / math.hypot(g_omega, 0.5 * g_v), h)


def kanayama(state: ReferenceState, e: Array, own: float) -> Array:
    v_r, omega_r, sin = state.twist[0], state.twist[2], math.sin(e[2])
    turn = v_r * 16.0 * e[1] + abs(v_r) * 8.0 * sin
    return np.array([v_r * math.cos(e[2]) + 1.5 * e[0], omega_r + turn])


def samson(state: ReferenceState, e: Array, own: float) -> Array:
    v_r, omega_r = state.twist[[0, 2]]
    k = 1.4 * math.hypot(omega_r, 4.0 * v_r)
    turn = 16.0 * v_r * e[1] * np.sinc(e[2] / math.pi) + k * e[2]
    return np.array([v_r * math.cos(e[2]) + k * e[0], omega_r + turn])


def linearizing(state: ReferenceState, e: Array, own: float) -> Array:
    (v_r, _, omega_r), a_r = state.twist, state.twist_dot[0]
    cos, sin = math.cos(e[2]), math.sin(e[2])
    u2 = a_r * sin + v_r * omega_r * cos + 2.0 * v_r * sin + 1.0 * e[1]
    return np.array([own, u2 / own if abs(own) > 0.2 else u2 * own / 0.04])


CASES: list[tuple[BaseLaw, Typed]] = [
    (PaperKinematic(smoothing=0.3), paper),
    (UnifiedKinematic(), unified),
    (Kanayama(), kanayama),
    (Samson(), samson),
    (FeedbackLinearization(), linearizing),
]


@pytest.mark.parametrize(("law", "typed"), CASES)
def test_value(law: BaseLaw, typed: Typed, rng: np.random.Generator) -> None:
    for _ in range(20):
        e, twist, twist_dot, twice = rng.normal(size=(4, 3))
        twist[1] = twist_dot[1] = 0.0
        own, turn = rng.normal(size=2)
        direction = 0.7 * np.array([twist, twist_dot, twice])
        still, no = np.zeros(3), NO_JOINTS
        state = ReferenceState(still, twist, twist_dot, no, no, no, direction)
        found = twist_of(law, state, e, np.array([own, 0.0, turn])).value
        np.testing.assert_allclose(found[[0, 2]], typed(state, e, own), rtol=1e-12)
