"""Poles of the loop about the reference: paper and pencil, the sampling limit, and a real step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import (
    PaperDynamic,
    PaperKinematic,
    ReducedDynamics,
    ReferenceState,
    Robot,
    Run,
    UnifiedKinematic,
)
from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic, IntegralDynamic
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.motion import rk4_step
from rpctl.errors import RpctlError
from rpctl.simulation.merits.linear_loop import LinearLoop, LoopPoles, _state, loop_poles
from rpctl.view.pages.report import poles_section, verdict
from tests.grids import cells
from tests.robots import write
from tests.vehicles import vehicle

H, H1, BETA = 0.5, 0.1, 1.2
PAPER = PaperKinematic(H, BETA, joint_horizon=H)


def run_of(robot: Robot, reference: str, period: float = 0.005, **laws: Any) -> Run:
    laws = {"kinematic": PAPER, "dynamic": PaperDynamic(H1), **laws}
    duration = max(0.4, 6.0 * period)
    return rpctl.track(robot, reference, duration=duration, control_period=period, **laws)


def steady_poles(robot: Robot, law: BaseLaw, dynamic: Any, v: float, omega: float) -> Array:
    """Poles about a steady motion of a base with an axle, sampled each millisecond."""
    none, twist = np.zeros(len(robot.joints)), np.array([v, 0.0, omega])
    state = ReferenceState(np.zeros(3), twist, np.zeros(3), robot.home, none, none)
    q = robot.configuration_at(np.zeros(3), robot.home)
    return LinearLoop(robot, law, dynamic, 0.001).poles(state, q, np.array([v, omega, *none]))


@pytest.mark.parametrize(("v", "omega"), [(0.6, 0.0), (0.5, -0.7), (0.0, 0.9)])
def test_the_paper_s_poles_are_those_of_the_paper(paper: Robot, v: float, omega: float) -> None:
    """−1/h of x1 − β s x2, x3 and the joints; −β|ω| of x2, none on a line; −1/h1 of ν."""
    poles = steady_poles(paper, PAPER, PaperDynamic(H1), v, omega)
    expected = [-BETA * abs(omega), *[-1 / H] * 4, *[-1 / H1] * 4]
    np.testing.assert_allclose(np.sort(poles.real)[::-1], expected, rtol=0.01, atol=1e-5)
    assert (np.abs(poles.imag) < 0.1).all()  # of poles that are equal


@pytest.mark.parametrize("v", [0.6, -0.4])
def test_the_unified_law_s_lateral_poles_are_those_of_its_block(paper: Robot, v: float) -> None:
    law, h = UnifiedKinematic(0.65, joint_horizon=H), 0.65
    poles = steady_poles(paper, law, BoundedDynamic(H1, midpoint=False), v, 0.0)
    D = 0.25 * h**2 * v**2 + law.weight
    K2 = 0.5 * v / D
    K3 = (0.5 * h * v**2 + law.weight / h) / D
    for pole in np.linalg.eigvals([[0.0, v], [-K2, -K3]]):
        assert np.abs(poles - pole).min() < 0.01 * abs(pole)


def test_integral_action_adds_its_own(paper: Robot) -> None:
    run = run_of(paper, "line", dynamic=IntegralDynamic(9.0, joint_gain=7.0))
    poles = loop_poles(run, paper, 1).poles
    assert [np.count_nonzero(poles == -k) for k in (9.0, 7.0)] == [2, 2]  # base and joints


def test_a_period_beyond_the_limit_is_seen(paper: Robot) -> None:
    """T < 2/(1/h + 1/h1) = 33 ms: what is stable in continuous time is not when it is sampled."""
    laws = {"kinematic": PaperKinematic(0.05, joint_horizon=0.05), "dynamic": PaperDynamic(0.025)}
    for period, stable in ((0.025, True), (0.042, False)):
        found = loop_poles(run_of(paper, "spin", period, **laws), paper, 1)
        assert (found.decay[0] > 0.0) == stable


@pytest.mark.parametrize("kind", cells(("car-like", "steered"), ["car-like"], ["steered"]))
def test_the_loop_of_steered_bases_is_that_of_a_real_step(kind: str, tmp_path: Path) -> None:
    """The derivative of one period of the simulated loop has the same eigenvalues."""
    robot, period = rpctl.load(write(tmp_path, vehicle(kind))), 0.01
    law = UnifiedKinematic(joint_horizon=H)
    run = run_of(robot, "circle", period, kinematic=law)
    dynamics, k, model = ReducedDynamics(robot), len(run.t) - 2, robot.model
    kinematic, dynamic, state = law.start(dynamics, period), PaperDynamic(H1), _state(run, robot, k)
    q, nu = run.log.q_ref[k], run.log.nu_ref[k]
    steered = [swivel.joint for swivel in robot.drive.steered]
    rows = [0, 1, 2, *(robot.velocity_index(name) for name in (*steered, *robot.joint_names))]
    at = np.concatenate([q, nu])

    def efforts(q: Array, nu: Array) -> Array:
        return dynamic(dynamics, q, nu, kinematic(dynamics, lambda t: state, 0.0, q, nu))

    there = rk4_step(dynamics, q, nu, efforts(q, nu), period)

    def after(x: Array) -> Array:
        joints = dict(zip([*steered, *robot.joint_names], x[3 : len(rows)], strict=True))
        moved = {name: robot.joint_position(q, name) for name in robot.moving_joint_names}
        moved |= {name: moved[name] + joints[name] for name in joints}
        root = np.zeros(robot.nv)
        root[:3] = x[:3]
        start = pin.integrate(model, q, root)
        posed = robot.configuration(joints=moved)
        posed[:4] = start[:4]
        speeds = at[len(q) :] + x[len(rows) :]
        step = rk4_step(dynamics, posed, speeds, efforts(posed, speeds), period)
        return np.append(pin.difference(model, there.q, step.q)[rows], step.nu - there.nu)

    size, h = len(rows) + robot.dof, 1e-5
    step = np.array([(after(h * e) - after(-h * e)) / (2 * h) for e in np.eye(size)]).T
    poles = LinearLoop(robot, law, dynamic, period).poles(state, q, nu)
    expected = np.sort(np.log(np.linalg.eigvals(step).astype(complex)).real / period)
    np.testing.assert_allclose(np.sort(poles.real), expected, atol=0.02)


def test_laws_that_plan_have_no_poles(paper: Robot) -> None:
    run = rpctl.track(paper, "line", duration=0.04, kinematic=rpctl.Horizon(), control_period=0.02)
    with pytest.raises(RpctlError, match="Horizon plans ahead or has memory"):
        loop_poles(run, paper)
    section = poles_section(run, paper)
    assert section is not None and "Horizon plans" in section.quiet


def test_speeds_as_output_have_no_poles_here(paper: Robot) -> None:
    run = run_of(paper, "spin")
    by_speed = replace(run, config=run.config.with_output("velocity"))
    with pytest.raises(RpctlError, match="the controller commands speeds"):
        loop_poles(by_speed, paper)


def test_the_section_tells_the_worst_and_when(paper: Robot) -> None:
    run = run_of(paper, "spin")
    section, poles = poles_section(run, paper), loop_poles(run, paper)
    assert section is not None
    k = int(poles.decay.argmin())
    assert f"−{poles.decay[k]:.3g} 1/s at {poles.t[k]:.3g} s" in dict(section.rows).values()
    assert section.badges[0].good and section.curve is not None
    assert "none oscillates" in dict(section.rows).values()
    assert poles_section(run, RpctlError("gone")) is None


@pytest.mark.parametrize(
    ("poles", "words"),
    [
        ([[-2.0, -5.0], [-4.0, -5.0]], "the slowest by 63 % within 0.5 s"),
        ([[-2.0, -5.0], [0.5, -5.0]], "grow near the reference between 1 and 1 s"),
        ([[-2.0, -5.0], [0.0, -5.0]], "does not decay"),
        ([[-1.0 + 5.0j, -1.0 - 5.0j]] * 2, "with several oscillations"),
    ],
)
def test_the_verdict_is_a_designer_s(poles: list[list[complex]], words: str) -> None:
    found = LoopPoles(np.array([0.0, 1.0]), np.array(poles, dtype=complex))
    assert words in verdict(found)


def test_damping_is_that_of_an_oscillation() -> None:
    found = LoopPoles(np.zeros(1), np.array([[-3.0 + 4.0j, -3.0 - 4.0j, -1.0]]))
    assert found.damping[0] == pytest.approx(0.6)
    assert found.decay[0] == pytest.approx(1.0)
