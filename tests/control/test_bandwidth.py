"""Prediction times of the joints: the margins they leave, and what efforts make of them."""

from __future__ import annotations

import cmath
import dataclasses
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
from rpctl.control.bandwidth import LINEAR_ERROR, at_bandwidth, gains_of, joint_gains
from rpctl.control.registry import law_sentences
from rpctl.reference.named import reference_by_name
from rpctl.robot.vary import without_losses

PERIODS = [0.001, 0.002, 0.01, 0.05, 0.2]


def poles(robot: Robot, period: float) -> tuple[float, float, float]:
    """Return 1/h, 1/h1 and k of the first joint."""
    _, h, h1, k = joint_gains(ReducedDynamics(robot), period)
    return 1.0 / h[0], 1.0 / h1[0], k[0]


@pytest.mark.parametrize("period", PERIODS)
def test_half_a_period_and_10_ms_leave_45_degrees_of_phase(paper: Robot, period: float) -> None:
    a, b, k = poles(paper, period)

    def open_loop(w: float) -> complex:
        s = 1j * w
        loop = ((a + b + k) * s**2 + (a * b + b * k + a * k) * s + a * b * k) / s**3
        return loop * cmath.exp(-s * (0.5 * period + 0.01))

    crossover = brentq(lambda w: abs(open_loop(w)) - 1.0, 0.5 * (a + b + k), 2.0 * (a + b + k))
    margin = math.degrees(cmath.phase(-open_loop(crossover)))
    assert 43.0 < margin < 47.0
    bandwidth = joint_gains(ReducedDynamics(paper), period).bandwidth[0]
    assert crossover == pytest.approx(2.0 * math.pi * bandwidth, rel=0.05)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize(
    ("inertia", "stable"), [(0.5, True), (1.0, True), (10.0, True), (20.0, False)]
)
def test_the_sampled_loop_stands_another_inertia(
    paper: Robot, period: float, inertia: float, stable: bool
) -> None:
    """ẍ = u held, u as law and integral have it: all eigenvalues lie within the unit circle."""
    a, b, k = poles(paper, period)
    T, g = period, 1.0 / inertia
    hold = np.array([[1.0, T, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    asked = -np.array([a * b + a * k, a + b + k, k * b])  # of x, ẋ and ∫(ẋ + a x)
    step = hold + np.outer([0.5 * g * T**2, g * T, 0.0], asked)
    step[2] += [a * T, T, 0.0]
    assert (np.abs(np.linalg.eigvals(step)).max() < 1.0) == stable


def with_effort(robot: Robot, index: int, effort: float) -> Robot:
    """Return a robot of which one joint of the arm has another effort limit."""
    name = robot.joint_names[index]
    joints = tuple(
        dataclasses.replace(joint, effort=effort) if joint.name == name else joint
        for joint in robot.description.joints
    )
    description = dataclasses.replace(robot.description, joints=joints)
    return dataclasses.replace(robot, description=description)


@pytest.mark.slow
def test_an_error_of_a_tenth_takes_no_more_than_a_weak_joint_has(tiago: Robot) -> None:
    """What the laws ask of the shoulder at home, 0.1 rad off, is its whole limit; others have more.

    At rest ν̇* is a b e of this joint alone, upwards, so the weight adds to it; nothing is lost.
    """
    tiago = without_losses(tiago)
    index = tiago.joint_names.index("arm_2_joint")
    q = tiago.configuration_at(np.zeros(3), tiago.home)
    first = tiago.dof - len(tiago.joints)
    weight = ReducedDynamics(tiago).bias(q, np.zeros(tiago.dof))[first + index]
    robot = with_effort(tiago, index, abs(weight) + 3.0)
    dynamics, strong = ReducedDynamics(robot), joint_gains(ReducedDynamics(tiago))
    gains = joint_gains(dynamics)
    assert gains.bandwidth[index] < 0.8 * strong.bandwidth[index]
    assert (np.delete(gains.bandwidth, index) == np.delete(strong.bandwidth, index)).all()
    asked = robot.home.copy()
    asked[index] += math.copysign(LINEAR_ERROR, weight)
    state = reference_by_name(robot, "eight")(0.0)._replace(
        pose=np.zeros(3), twist=np.zeros(3), twist_dot=np.zeros(3), joints=asked,
        joint_rates=np.zeros(len(asked)), joint_accelerations=np.zeros(len(asked)),
    )  # fmt: skip
    command = UnifiedKinematic().start(dynamics, 0.002)(
        dynamics, lambda _: state, 0.0, q, np.zeros(robot.dof)
    )
    law = PaperDynamic(joint_horizon_dyn=float(gains.horizon_dyn[index]))
    tau = law.start(dynamics, 0.002)(dynamics, q, np.zeros(robot.dof), command).tau
    assert abs(tau[robot.actuators.index("arm_2_joint")]) == pytest.approx(abs(weight) + 3.0)


def test_a_delay_that_is_known_costs_bandwidth(paper: Robot) -> None:
    dynamics = ReducedDynamics(paper)
    late, prompt = joint_gains(dynamics, 0.002, 0.011), joint_gains(dynamics, 0.002)
    np.testing.assert_allclose(late.bandwidth, 0.5 * prompt.bandwidth)
    np.testing.assert_allclose(late.horizon, 2.0 * prompt.horizon)


def test_a_bandwidth_reaches_the_joints_of_all_laws() -> None:
    _, h, h1, k = (float(part[0]) for part in gains_of(np.array([5.0])))
    law = at_bandwidth(IntegralDynamic(gain=8.0), 5.0)
    assert law == IntegralDynamic(8.0, BoundedDynamic(joint_horizon_dyn=h1), k)
    assert at_bandwidth(UnifiedKinematic(), 5.0) == UnifiedKinematic(joint_horizon=h)
    within = at_bandwidth(EndEffector(base=UnifiedKinematic()), 5.0)
    assert within == EndEffector(base=UnifiedKinematic(joint_horizon=h))
    assert at_bandwidth(len, 5.0) is len


def test_the_gains_are_told_and_what_a_law_ignores(tiago: Robot) -> None:
    index = tiago.joint_names.index("arm_2_joint")
    dynamics = ReducedDynamics(with_effort(tiago, index, 0.1))
    law = UnifiedKinematic()
    (told,) = law_sentences(dynamics, law, IntegralDynamic(), 0.002)
    assert told == (
        "joints: 7.2 Hz (h 0.24 s, h1 0.06 s, k 25 1/s), as sampling and 10 ms in reserve allow; "
        "as efforts allow: arm_2_joint 2.5 Hz"
    )
    partly = UnifiedKinematic(joint_horizon=0.3), IntegralDynamic(joint_gain=5.0)
    assert law_sentences(dynamics, *partly, 0.002) == (f"{told}; but h 0.3 s, k 5 1/s, as set",)
    by_hand = BoundedDynamic(joint_horizon_dyn=0.05)
    assert law_sentences(dynamics, law, by_hand, 0.002) == ("joints: h1 0.05 s, as set",)
    assert law_sentences(dynamics, law, None, 0.002) == ()
    (ignored,) = law_sentences(dynamics, law, PaperDynamic(), 0.002)
    assert "limits of efforts, rates and positions" in ignored
    assert "held for a period" in ignored
    assert "held" not in law_sentences(dynamics, law, PaperDynamic(midpoint=True), 0.002)[0]
