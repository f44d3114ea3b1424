"""What a trial is made of: efforts that hold what is driven, sizes that bound what is summed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot, draw_state, load
from rpctl.equivalence.state import (
    efforts,
    inertia_spread,
    inverse,
)
from rpctl.errors import RpctlError
from tests.equivalence.ill_scaled import NASTY
from tests.robots import SET_A, platform, write


@pytest.mark.parametrize("name", ["front wheel drives alone", "nothing driven but the arm"])
def test_efforts_hold_what_is_driven_and_no_more(tmp_path: Path, name: str) -> None:
    """Held, the actuators' own joints do not accelerate; of one pushed, its own does as told."""
    robot = NASTY[name](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, 0)
    q, nu, B = state.q, state.nu, dynamics.actuation(state.q)
    still = np.zeros(len(robot.actuators))
    held = dynamics.forward(q, nu, efforts(dynamics, q, nu, still))
    np.testing.assert_allclose(B.T @ held, 0.0, atol=1e-10)
    assert np.abs(held).max() > 0.01  # what nothing drives moves on
    for k in range(len(still)):
        push = np.where(np.arange(len(still)) == k, 0.7, 0.0)
        pushed = dynamics.forward(q, nu, efforts(dynamics, q, nu, push))
        assert B[:, k] @ (pushed - held) == pytest.approx(0.7, abs=1e-10)


def test_an_inertia_of_any_units_is_inverted(paper: Robot) -> None:
    M = ReducedDynamics(paper).inertia(paper.configuration())
    units = np.array([1e8, 1e-3, 1.0, 1e-9])
    np.testing.assert_allclose(
        inverse(M * np.outer(units, units)) * np.outer(units, units), np.linalg.inv(M), atol=1e-12
    )
    with pytest.raises(RpctlError, match="not positive definite"):
        inverse(np.diag([1.0, -1.0]))
    with pytest.raises(RpctlError, match="not positive definite"):
        inverse(np.diag([1.0, 0.0]))


def test_the_spread_of_a_platform_is_its_wheels(tmp_path: Path) -> None:
    """Seen from P, at the wheels' height: two wheels, √m_w b/r of v each, and b of that of ω."""
    robot = load(write(tmp_path, platform(SET_A)))
    b, r, m = SET_A["b"], SET_A["r"], SET_A["m_w"]
    spread = inertia_spread(ReducedDynamics(robot), robot.configuration(), np.array([0.0, 0.0, r]))
    np.testing.assert_allclose(spread, 2.0 * np.sqrt(m) * b / r * np.array([1.0, b]), rtol=1e-12)
