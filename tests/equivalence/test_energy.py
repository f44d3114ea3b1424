"""The rows of the energy: what a fault of a known size makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, draw_state
from rpctl.dynamics.motion import rk4_step
from rpctl.equivalence.energy import energy_rate, power_balance
from rpctl.equivalence.state import efforts, find_rounding_scales, force_state
from tests.equivalence.fault_injection import in_method
from tests.equivalence.ill_scaled import NASTY

PERCENT = in_method("energy", lambda original, *arguments: 1.01 * original(*arguments))


@pytest.mark.parametrize("name", ["mixed_chain", "1 mm long"])
def test_a_hundredth_more_energy_has_its_residual(tmp_path: Path, name: str) -> None:
    """Ė is a hundredth more than the power P, relative to the larger of what E and P are made of.

    The floor of the scale is 1 J, or the kinetic energy where that is less.
    """
    robot = rpctl.load(name) if name == "mixed_chain" else NASTY[name](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, 0)
    q, nu = state.q, state.nu
    forced = force_state(dynamics, state, find_rounding_scales(dynamics, state, None))
    terms = nu * (dynamics.actuation(q) @ forced.tau)
    kinetic = 0.5 * nu @ dynamics.inertia(q) @ nu
    with PERCENT(robot):
        found = energy_rate(dynamics, forced)
        total = abs(dynamics.energy(q, nu))
    scale = max(min(1.0, kinetic), np.abs(terms).sum(), total)
    assert found.residual == pytest.approx(0.01 * abs(terms.sum()) / scale, rel=1e-3)
    assert not found.passed


def test_a_hundredth_more_energy_over_a_motion(paper: Robot) -> None:
    """0.1 s in steps of 1.25 ms: the same work, five times the resolution."""
    dynamics, state = ReducedDynamics(paper), draw_state(paper, 0, 1)
    q, nu = state.q, 0.1 * state.nu
    tau = efforts(dynamics, q, nu, 0.1 * state.push)
    start = float(0.5 * nu @ dynamics.inertia(q) @ nu)
    with PERCENT(paper):
        found = power_balance(dynamics, state)
    works = []
    for _ in range(80):
        q, nu, work, _ = rk4_step(dynamics, q, nu, tau, 1.25e-3)
        works.append(work)
    assert min(works) > 0.0  # so that it is all of one sign
    scale = max(sum(works), min(1.0, start + sum(works)))
    assert found.residual == pytest.approx(0.01 * abs(sum(works)) / scale, rel=1e-6)
