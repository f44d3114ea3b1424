"""What the plant has that its controller does not know of."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, RpctlError, scale_masses, summarize, track
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.errors import UnknownNameError

OFF = (0.1, -0.1, 0.1)


def test_a_bias_pushes_but_is_not_the_actuators(paper: Robot) -> None:
    """The first sample's motion is that of τ plus the bias, while the log has τ alone."""
    plant = Plant(tau_bias={"wheel_left_joint": 2.0})
    biased, plain = (track(paper, "eight", 0.5, OFF, plant=p) for p in (plant, None))
    np.testing.assert_array_equal(biased.tau[0], plain.tau[0])
    dynamics = ReducedDynamics(paper)
    push = dynamics.actuation(plain.q[0]) @ np.array([2.0, 0.0, 0.0, 0.0])
    expected = np.linalg.solve(dynamics.inertia(plain.q[0]), push) * 0.002
    np.testing.assert_allclose(biased.nu[1] - plain.nu[1], expected, rtol=1e-2, atol=1e-6)
    assert summarize(biased).energy_residual < 1e-6
    assert biased.config.plant.tau_bias == {"wheel_left_joint": 2.0}


def test_efforts_arrive_after_the_delay(paper: Robot) -> None:
    sent: list[Array] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        sent.append(rpctl.PaperDynamic()(dynamics, q, nu, command))
        return sent[-1]

    run = track(paper, "eight", 0.1, OFF, dynamic=law, plant=Plant(delay=0.02))
    np.testing.assert_array_equal(run.tau[10:], sent[:-10])
    assert not run.nu[:11].any()  # until then the robot is held still


@pytest.mark.parametrize(
    ("delay", "samples"), [(0.001, 1), (0.0029, 1), (0.003, 2), (0.005, 3), (0.009, 5), (0.01, 5)]
)
def test_the_delay_logged_is_the_one_simulated(paper: Robot, delay: float, samples: int) -> None:
    """In periods of 2 ms: halves count up, whole ones say nothing."""
    sent: list[Array] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        sent.append(rpctl.PaperDynamic()(dynamics, q, nu, command))
        return sent[-1]

    run = track(paper, "eight", 0.03, OFF, dynamic=law, plant=Plant(delay=delay))
    np.testing.assert_array_equal(run.tau[samples:], sent[:-samples])
    assert run.config.plant.delay == pytest.approx(samples * 0.002)
    notes = (
        f"a delay of {delay:g} s is no whole number of control periods of 0.002 s: "
        f"{samples * 0.002:g} s are simulated",
    )
    assert run.notes == (() if delay == 0.01 else notes)


def test_the_controller_computes_with_the_robot_it_believes(tiago: Robot) -> None:
    light = scale_masses(tiago, "arm_*", 0.7)
    run = track(tiago, "eight", 0.01, plant=Plant(controller_model=light))
    hold = ReducedDynamics(light).bias(run.q[0], run.nu[0])
    np.testing.assert_allclose(run.tau[0, 2:], hold[2:], atol=1e-9)
    assert run.controller_model == tiago.name


def test_what_does_not_fit_is_told(paper: Robot, tiago: Robot) -> None:
    with pytest.raises(UnknownNameError, match="actuator 'wheel' is not known"):
        track(paper, "eight", 0.1, plant=Plant(tau_bias={"wheel": 1.0}))
    with pytest.raises(RpctlError, match="has other quasi_velocities than paper"):
        track(paper, "eight", 0.1, plant=Plant(controller_model=tiago))
    with pytest.raises(RpctlError, match="delay is -1"):
        Plant(delay=-1.0)
    with pytest.raises(RpctlError, match="tau_bias of a is nan"):
        Plant(tau_bias={"a": float("nan")})
