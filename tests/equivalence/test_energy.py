"""The rows of the energy: what a fault of a known size makes of them, and what RK4 does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import rpctl
from rpctl import ReducedDynamics, Robot, draw_state
from rpctl.dynamics.motion import rk4_step
from rpctl.equivalence import energy
from rpctl.equivalence.energy import energy_rate, power_balance
from rpctl.equivalence.forced_state import efforts, find_rounding_scales, force_state
from tests.equivalence.fault_injection import in_method
from tests.equivalence.ill_scaled import NASTY

PERCENT = in_method("energy", lambda original, *arguments: 1.01 * original(*arguments))


@pytest.mark.parametrize("name", ["mixed_chain", "1 mm long", "tip of 1e5 kg"])
@pytest.mark.parametrize("sample", range(3))
def test_a_hundredth_more_energy_has_its_residual(tmp_path: Path, name: str, sample: int) -> None:
    """Ė is a hundredth more than the power P, relative to the larger of what E and P are made of.

    The floor of the scale is 1 J, or the kinetic energy where that is less.
    """
    robot = rpctl.load(name) if name == "mixed_chain" else NASTY[name](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, sample)
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
    moved = float(np.abs(np.reshape(works, (energy.POWER_ATTEMPTS, -1)).sum(axis=1)).sum())
    scale = max(moved, min(1.0, start + moved))
    assert found.residual == pytest.approx(0.01 * abs(sum(works)) / scale, rel=1e-6)


def test_truncation_is_extrapolated_away(tmp_path: Path) -> None:
    """What is left of the energy's gap in a step is far less than in the two halves alone."""
    robot = NASTY["chain of 30"](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, 0)
    q, nu, step = state.q, state.nu, 4e-3
    tau = efforts(dynamics, q, nu, state.push)
    pair = energy._pair(dynamics, q, nu, tau, step)
    half = rk4_step(dynamics, q, nu, tau, 0.5 * step)
    end = rk4_step(dynamics, half.q, half.nu, tau, 0.5 * step)
    whole = rk4_step(dynamics, q, nu, tau, step)
    plain = dynamics.energy(*end[:2]) - dynamics.energy(q, nu) - half.work - end.work
    assert abs(pair.gap) < abs(plain) / 12.0
    assert pair.work == half.work + end.work
    gap, size = np.abs(end.nu - whole.nu).max(), np.abs(end.nu).max() + np.abs(end.nu - nu).max()
    assert pair.error == gap / size


@pytest.mark.slow
def test_a_motion_too_fast_for_the_step_is_followed_in_shorter_ones(tmp_path: Path) -> None:
    """Unscaled, the chain's first step of 4 ms breaks down; followed, it keeps its energy."""
    robot = NASTY["chain of 100"](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, 0)
    tau = efforts(dynamics, state.q, 0.1 * state.nu, 0.1 * state.push)
    pair = energy._pair(dynamics, state.q, 0.1 * state.nu, tau, energy.MAX_POWER_STEP_S)
    assert pair.error > energy.MAX_STEP_ERROR
    assert power_balance(dynamics, state).residual < 1e-9


def test_the_first_step_of_a_fast_robot_turns_its_joints_little(tmp_path: Path) -> None:
    robot = NASTY["1 mm long"](tmp_path)
    dynamics, state = ReducedDynamics(robot), draw_state(robot, 0, 0)
    tau = efforts(dynamics, state.q, state.nu, state.push)
    rates = np.abs(dynamics.basis(state.q) @ state.nu).sum()
    rates += energy.MAX_POWER_STEP_S * np.abs(dynamics.forward(state.q, state.nu, tau)).sum()
    step = energy._first_step(dynamics, state.q, state.nu, tau)
    assert step == pytest.approx(energy.MAX_FIRST_TURN / rates, rel=1e-12)
    assert step < 0.1 * energy.MAX_POWER_STEP_S
    still = energy._first_step(dynamics, state.q, 0.0 * state.nu, 0.0 * tau)
    assert still <= energy.MAX_POWER_STEP_S


def test_losses_take_little_of_the_speeds_in_the_first_step(tiago: Robot) -> None:
    """A speed decays by exp(−λ t), λ the largest root of SᵀDS − λ M: dry friction at rest is D."""
    dynamics, state = ReducedDynamics(tiago), draw_state(tiago, 0, 0)
    losses, S, M = tiago.losses, dynamics.basis(state.q), dynamics.inertia(state.q)
    assert losses is not None
    rest, hold = np.zeros(tiago.dof), efforts(dynamics, state.q, 0.0 * state.nu, 0.0 * state.push)
    steepest = losses.damping + losses.friction / losses.rate
    decay = eigh(S.T @ (steepest[:, None] * S), M, eigvals_only=True)[-1]
    step = energy._first_step(dynamics, state.q, rest, hold)
    assert step == pytest.approx(energy.MAX_FIRST_DECAY / decay, rel=1e-9)


def test_most_steps_of_a_stiff_motion_count(tiago: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first one is short enough, or nearly: attempts that fail follow no motion."""
    dynamics, errors, pair = ReducedDynamics(tiago), [], energy._pair

    def noted(*arguments: Any) -> Any:
        found = pair(*arguments)
        errors.append(found.error)
        return found

    monkeypatch.setattr(energy, "_pair", noted)
    for sample in range(4):
        power_balance(dynamics, draw_state(tiago, 0, sample))
    assert len(errors) == 4 * energy.POWER_ATTEMPTS
    assert np.mean(np.array(errors) <= energy.MAX_STEP_ERROR) > 0.5
