"""The paper's dynamic law and its integral action: costs, poles, and that no limit winds it up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from rpctl import (
    BoundedDynamic,
    IntegralDynamic,
    PaperDynamic,
    ReducedDynamics,
    Robot,
    RpctlError,
    scale_limits,
    scale_masses,
)
from rpctl.arrays import Array
from rpctl.control.law import Command, DynamicLaw, Rest, as_efforts
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
        tau = law(dynamics, q, nu, Command(nu, nu_dot)).tau
        later = advance(dynamics, q, nu, tau, period, period / 4).nu
        gaps.append(np.abs((later - nu) / period - nu_dot).max())
    assert (3.5 < gaps[0] / gaps[1] < 4.5) if midpoint else (1.8 < gaps[0] / gaps[1] < 2.3)


def follow(
    robot: Robot,
    law: DynamicLaw,
    nu_d: Array,
    bias: Array,
    seconds: float,
    period: float = 0.001,
) -> Array:
    """Return ν (K, dof) of a robot that follows a constant command from rest."""
    dynamics, nu = ReducedDynamics(robot), np.zeros(robot.dof)
    q = robot.configuration_at(np.zeros(3), robot.home)
    controller = law.start(dynamics, period)
    log = [nu]
    for _ in range(round(seconds / period)):
        tau = as_efforts(controller(dynamics, q, nu, Command(nu_d, np.zeros(robot.dof)))).tau
        q, nu, *_ = advance(dynamics, q, nu, tau + bias, period, period)
        log.append(nu)
    return np.array(log)


def test_its_poles_are_those_of_the_design(paper: Robot) -> None:
    """A constant disturbance a from t = 0 gives ε = a (e^{−kt} − e^{−t/h1}) / (1/h1 − k).

    The joints, which the wheels' bias pushes as well, have poles of their own.
    """
    bias = np.array([1.0, 1.0, 0.0, 0.0])
    law = IntegralDynamic(4.0, BoundedDynamic(0.15, joint_horizon_dyn=0.1), joint_gain=7.0)
    error = follow(paper, law, np.zeros(4), bias, 1.0)
    dynamics, q = ReducedDynamics(paper), paper.configuration_at(np.zeros(3), paper.home)
    push = np.linalg.solve(dynamics.inertia(q), dynamics.actuation(q) @ bias)
    t, k = np.arange(len(error))[:, None] * 0.001, np.array([4.0, 4.0, 7.0, 7.0])
    fast = 1.0 / np.array([0.15, 0.15, 0.1, 0.1])
    shape = (np.exp(-k * t) - np.exp(-fast * t)) / (fast - k)
    np.testing.assert_allclose(error, shape * push, atol=2e-3 * np.abs(push).max())
    assert np.abs(push[3]) > 0.5 * np.abs(push).max()


def test_without_a_disturbance_it_is_the_papers_law(paper: Robot) -> None:
    nu_d = np.array([0.4, 0.3, 0.2, 0.05])
    plain = follow(paper, PaperDynamic(), nu_d, np.zeros(4), 0.5)
    inner = BoundedDynamic(0.15, joint_horizon_dyn=0.15)
    integral = follow(paper, IntegralDynamic(inner=inner), nu_d, np.zeros(4), 0.5)
    np.testing.assert_allclose(integral, plain, atol=2e-3)


@pytest.mark.slow
def test_efforts_at_their_limits_do_not_wind_it_up(paper: Robot) -> None:
    """Seconds at the limit leave no trace: the motion is that of the law without integral."""
    weak, nu_d = scale_limits(paper, effort=0.02), np.array([0.8, 0.0, 0.0, 0.0])
    plain = follow(weak, BoundedDynamic(), nu_d, np.zeros(4), 4.0, 0.002)
    integral = follow(weak, IntegralDynamic(), nu_d, np.zeros(4), 4.0, 0.002)
    assert plain[1000, 0] < 0.75  # 2 s at the limit, still not there
    assert integral[:, 0].max() < 0.8 * (1.0 + 1e-3)
    np.testing.assert_allclose(integral, plain, atol=2e-3)


@pytest.mark.slow
def test_a_bias_is_removed_even_from_the_limit_on(paper: Robot) -> None:
    """A bias that takes a third of what the wheels have is learnt while they saturate."""
    weak, nu_d = scale_limits(paper, effort=0.02), np.array([0.4, 0.0, 0.0, 0.0])
    bias = np.array([-0.25, -0.25, 0.0, 0.0])
    error = follow(weak, IntegralDynamic(), nu_d, bias, 8.0, 0.002)[-1] - nu_d
    assert np.abs(error[:2]).max() < 1e-4
    error = follow(weak, BoundedDynamic(), nu_d, bias, 3.0, 0.002)[-1] - nu_d
    assert abs(error[0]) > 5e-3


def test_at_rest_it_knows_what_its_model_does_not(tiago: Robot) -> None:
    """TIAGo stands still; the model has its arm a third too light. Unless told, it sags first."""
    light, still = scale_masses(tiago, "arm_*", 0.7), np.zeros(tiago.dof)
    dynamics, controller_model = ReducedDynamics(tiago), ReducedDynamics(light)
    start = tiago.configuration_at(np.zeros(3), tiago.home)
    rest = Rest(start, dynamics.efforts(start, dynamics.bias(start, still)))

    def fastest(known: Rest | None) -> float:
        law = IntegralDynamic().start(controller_model, 0.002, known)
        q, nu = start, still
        rates = []
        for _ in range(100):
            tau = law(controller_model, q, nu, Command(still, still)).tau
            q, nu, *_ = advance(dynamics, q, nu, tau, 0.002, 0.002)
            rates.append(np.abs(nu).max())
        return float(max(rates))

    assert fastest(rest) < 1e-9
    assert fastest(None) > 0.05


def test_a_gain_faster_than_the_sampling_is_told(paper: Robot) -> None:
    with pytest.raises(RpctlError, match=r"gain 200 1/s is too large .* give at most 100"):
        IntegralDynamic(gain=200.0).start(ReducedDynamics(paper), 0.01)
    with pytest.raises(RpctlError, match=r"gain 150 1/s is too large .* give at most 100"):
        IntegralDynamic(joint_gain=150.0).start(ReducedDynamics(paper), 0.01)
