"""The paper's dynamic law: it minimises its cost, and its error decays at 1/h1."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from rpctl import PaperDynamic, ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.robot.vary import without_losses
from rpctl.simulation.plants.rolling import advance

LAW = PaperDynamic(horizon_dyn=0.1)


def random_case(
    robot: Robot, rng: np.random.Generator
) -> tuple[ReducedDynamics, Array, Array, Command]:
    nu, nu_d, nu_d_dot = rng.normal(size=(3, robot.dof))
    return ReducedDynamics(robot), robot.random_configuration(rng), nu, Command(nu_d, nu_d_dot)


def test_the_closed_form_minimises_the_cost(paper: Robot, rng: np.random.Generator) -> None:
    """[MS21, Eq. 25]: J = ½ Σ w′ᵢ (εᵢ + h1 ε̇ᵢ)² over τ, ε̇ from the forward dynamics."""
    for _ in range(10):
        dynamics, q, nu, command = random_case(paper, rng)
        weights = np.exp(rng.normal(size=paper.dof))

        def cost(
            tau: Array,
            q: Array = q,
            nu: Array = nu,
            command: Command = command,
            weights: Array = weights,
            dynamics: ReducedDynamics = dynamics,
        ) -> float:
            rate = dynamics.forward(q, nu, tau) - command.nu_d_dot
            ahead = nu - command.nu_d + LAW.horizon_dyn * rate
            return float(0.5 * weights @ ahead**2)

        tau = LAW(dynamics, q, nu, command)
        assert cost(tau) < 1e-22  # zero: no weight has a say
        numeric = minimize(cost, np.zeros(4), method="BFGS", options={"gtol": 1e-10})
        np.testing.assert_allclose(numeric.x, tau, atol=1e-3 * np.abs(tau).max())


def test_the_error_decays_at_its_horizon(robot: Robot, rng: np.random.Generator) -> None:
    """[MS21, Eq. 26]: ε̇ = −ε/h1 on the full nonlinear dynamics of the ideal robot."""
    robot = without_losses(robot)
    for _ in range(10):
        dynamics, q, nu, command = random_case(robot, rng)
        rate = dynamics.forward(q, nu, LAW(dynamics, q, nu, command)) - command.nu_d_dot
        expected = -(nu - command.nu_d) / LAW.horizon_dyn
        np.testing.assert_allclose(rate, expected, atol=1e-9 * np.abs(expected).max() * 100)


def test_losses_are_compensated_at_the_speeds_wanted(
    tiago: Robot, rng: np.random.Generator
) -> None:
    """ε̇ = −ε/h1 where the robot has them; elsewhere M⁻¹(ℓ(ν) − ℓ(ν_d)) besides, which brakes ε."""
    dynamics, q, _, command = random_case(tiago, rng)
    nu = command.nu_d.copy()
    rate = dynamics.forward(q, nu, LAW(dynamics, q, nu, command))
    np.testing.assert_allclose(rate, command.nu_d_dot, atol=1e-9 * np.abs(rate).max())
    for _ in range(5):
        nu = command.nu_d + rng.normal(size=tiago.dof)
        ideal = command.nu_d_dot - (nu - command.nu_d) / LAW.horizon_dyn
        rate = dynamics.forward(q, nu, LAW(dynamics, q, nu, command))
        excess = dynamics.inertia(q) @ (rate - ideal)
        expected = dynamics.losses(q, nu) - dynamics.losses(q, command.nu_d)
        np.testing.assert_allclose(excess, expected, atol=1e-9 * np.abs(expected).max())
        assert excess @ (nu - command.nu_d) < 0.0


@pytest.mark.parametrize("midpoint", [True, False])
def test_efforts_for_the_middle_of_a_period_are_exact_to_second_order(
    robot: Robot, midpoint: bool, rng: np.random.Generator
) -> None:
    """Half a period makes the gap between mean and asked acceleration a quarter, else a half."""
    nu, nu_dot = rng.normal(size=(2, robot.dof)) * 0.5
    q, dynamics = robot.configuration_at(np.zeros(3), robot.home), ReducedDynamics(robot)
    gaps = []
    for period in (0.004, 0.002):
        law = PaperDynamic(midpoint=midpoint).start(dynamics, period)
        tau = law(dynamics, q, nu, Command(nu, nu_dot))
        later = advance(dynamics, q, nu, tau, period, period / 4).nu
        gaps.append(np.abs((later - nu) / period - nu_dot).max())
    assert (3.5 < gaps[0] / gaps[1] < 4.5) if midpoint else (1.8 < gaps[0] / gaps[1] < 2.3)
