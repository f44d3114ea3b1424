"""The paper's kinematic law: it minimises its cost, and behaves as its closed loop says."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import sici

from rpctl import PaperKinematic, ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.reference.named import reference_by_name
from tests.control.unicycle import asked, error_rate, follow, sampled_step, steady, twist_of

LAW = PaperKinematic(horizon=0.4, beta=1.5)


def outputs(e: Array, sign: float, beta: float) -> Array:
    """Return the outputs z of [MS21, Eq. 11-13]: what the law drives to zero."""
    return np.array([e[0] - beta * sign * e[1], *e[2:]])


def predicted_cost(
    law: PaperKinematic, reference: ReferenceState, e: Array, weights: Array, speeds: Array
) -> float:
    """Return J = ½ Σ wᵢ (zᵢ + h żᵢ)², żᵢ from the error kinematics under the inputs (v, ω)."""
    sign = float(np.sign(reference.twist[2]))
    rate = error_rate(e, reference, np.array([speeds[0], 0.0, speeds[1]]))
    ahead = outputs(e + law.horizon * rate, sign, law.beta)
    return float(0.5 * weights @ ahead**2)


def random_case(rng: np.random.Generator) -> tuple[ReferenceState, Array, Array]:
    twist, twist_dot = rng.normal(size=(2, 3)) * [1.0, 0.0, 1.0]
    state = ReferenceState(np.zeros(3), twist, twist_dot, *np.empty((3, 0)))
    return state, rng.normal(size=3), np.exp(rng.normal(size=2))


def test_the_closed_form_minimises_the_cost(rng: np.random.Generator) -> None:
    for _ in range(10):
        reference, e, weights = random_case(rng)
        numeric = minimize(
            partial(predicted_cost, LAW, reference, e, weights),
            np.zeros(2),
            method="BFGS",
            options={"gtol": 1e-9},
        )
        law = asked(LAW, reference, e)[[0, 2]]
        np.testing.assert_allclose(law, numeric.x, atol=1e-5 * (1 + np.abs(law).max()))
        # The minimum is zero, so no weight has a say.
        assert predicted_cost(LAW, reference, e, weights, law) < 1e-24


@pytest.mark.parametrize("robot", ["paper", "mixed_chain"], indirect=True)
def test_the_joints_decay_at_the_horizon(robot: Robot, rng: np.random.Generator) -> None:
    """q̇_d = q̇_r + (q_r − q)/h, [MS21, Eq. 20]."""
    reference, dynamics = reference_by_name(robot, "eight"), ReducedDynamics(robot)
    q = robot.random_configuration(rng)
    state, n = reference(5.0), len(robot.joints)
    nu_d = LAW(dynamics, reference, 5.0, q, np.zeros(robot.dof)).nu_d
    gap = np.remainder(state.joints - robot.joint_positions(q) + math.pi, 2 * math.pi) - math.pi
    kinds = np.array([joint.kind == "continuous" for joint in robot.joints])
    gap = np.where(kinds, gap, state.joints - robot.joint_positions(q))
    np.testing.assert_allclose(nu_d[-n:], state.joint_rates + gap / LAW.horizon, atol=1e-12)


@pytest.mark.parametrize("omega", [0.7, -0.7])
def test_outputs_decay_and_the_lateral_error_follows(omega: float) -> None:
    """On a circle ż = −z/h, and once z is gone ẋ2 = −β |ω_r| x2."""
    reference, e0 = steady(0.5, omega), np.array([0.3, 0.5, 0.8])
    times = np.linspace(0.0, 6.0, 61)
    errors = follow(LAW, reference, e0, times)
    sign = math.copysign(1.0, omega)
    z = np.array([outputs(e, sign, LAW.beta) for e in errors])
    np.testing.assert_allclose(z, np.outer(np.exp(-times / LAW.horizon), z[0]), atol=1e-9)
    late = times > 4.5
    rate = np.polyfit(times[late], np.log(np.abs(errors[late, 1])), 1)[0]
    assert rate == pytest.approx(-LAW.beta * abs(omega), rel=1e-3)
    on_zero = np.array([LAW.beta * sign * 0.2, 0.2, 0.0])
    twist = asked(LAW, reference, on_zero)
    assert error_rate(on_zero, reference, twist)[1] == pytest.approx(-LAW.beta * abs(omega) * 0.2)


@pytest.mark.parametrize("e0", [(0.3, 0.5, 0.8), (-0.2, -0.4, 0.5), (0.1, 0.2, -1.0)])
def test_a_straight_line_freezes_the_lateral_error(e0: tuple[float, float, float]) -> None:
    """x2(∞) = x2(0) + h v_r Si(x3(0)) − x1(0) x3(0)/2."""
    v_r = 0.6
    last = follow(LAW, steady(v_r, 0.0), np.array(e0), np.array([0.0, 20.0]))[-1]
    frozen = e0[1] + LAW.horizon * v_r * sici(e0[2])[0] - 0.5 * e0[0] * e0[2]
    assert last[1] == pytest.approx(frozen, abs=1e-8)
    assert abs(last[0]) < 1e-8
    assert abs(frozen) > 0.02


@pytest.mark.parametrize(("v", "omega"), [(0.5, 0.5), (0.3, -1.2), (0.0, 2.0)])
def test_the_sampled_limit_brackets_stability(v: float, omega: float) -> None:
    """Zero-order hold is stable for T < (2/|ω|) atan(|ω| h/(1 + β |ω| h)) ≤ 2h."""
    turned = abs(omega) * LAW.horizon
    limit = 2.0 / abs(omega) * math.atan(turned / (1.0 + LAW.beta * turned))
    assert limit <= 2.0 * LAW.horizon

    def amplitude(period: float, steps: int = 4000) -> float:
        e = 1e-6 * np.array([1.0, -0.5, 0.7])
        for _ in range(steps):
            e = sampled_step(LAW, steady(v, omega), e, period)
            if np.abs(e).max() > 1e-3:
                break
        return float(np.abs(e).max())

    assert amplitude(0.99 * limit) < 1e-9
    assert amplitude(1.01 * limit) > 1e-3


def test_the_smooth_sign_tends_to_the_papers(rng: np.random.Generator) -> None:
    reference, e, _ = random_case(rng)
    smooth, sharp = (
        twist_of(law, reference, e) for law in (PaperKinematic(0.4, 1.5, smoothing=1e-6), LAW)
    )
    np.testing.assert_allclose(smooth.value, sharp.value, atol=1e-9)
    np.testing.assert_allclose(smooth.rate, sharp.rate, atol=1e-8)
