"""What the plant has that its controller does not know of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import (
    PaperDynamic,
    Plant,
    ReducedDynamics,
    Robot,
    RpctlError,
    scale_masses,
    summarize,
    track,
)
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.errors import UnknownNameError
from rpctl.robot.variation import vary
from rpctl.simulation.plants.rolling import advance
from tests.robots import SET_A, platform, write

OFF = (0.1, -0.1, 0.1)


def test_a_bias_pushes_but_is_not_the_actuators(paper: Robot) -> None:
    """The first sample's motion is that of τ plus the bias, while the log has τ alone."""
    plant = Plant(tau_bias={"wheel_left_joint": 2.0})
    paper_law = PaperDynamic()  # it does not know of the bias, as an integral does from the start
    biased, plain = (
        track(paper, "eight", duration=0.5, initial_error=OFF, dynamic=paper_law, plant=p)
        for p in (plant, None)
    )
    np.testing.assert_array_equal(biased.tau[0], plain.tau[0])
    dynamics = ReducedDynamics(paper)
    push = dynamics.actuation(plain.q[0]) @ np.array([2.0, 0.0, 0.0, 0.0])
    expected = np.linalg.solve(dynamics.inertia(plain.q[0]), push) * 0.002
    np.testing.assert_allclose(biased.nu[1] - plain.nu[1], expected, rtol=1e-2, atol=1e-6)
    assert summarize(biased).energy_residual < 1e-6
    assert biased.config.plant.tau_bias == {"wheel_left_joint": 2.0}


@pytest.mark.parametrize(
    ("delay", "samples"), [(0.001, 1), (0.0029, 1), (0.003, 2), (0.005, 3), (0.009, 5), (0.01, 5)]
)
def test_the_delay_logged_is_the_one_simulated(paper: Robot, delay: float, samples: int) -> None:
    """In periods of 2 ms: halves count up, whole ones say nothing."""
    sent: list[Array] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        sent.append(rpctl.PaperDynamic()(dynamics, q, nu, command))
        return sent[-1]

    run = track(
        paper, "eight", duration=0.03, initial_error=OFF, dynamic=law, plant=Plant(delay=delay)
    )
    np.testing.assert_array_equal(run.tau[samples:], sent[:-samples])
    assert run.config.plant.delay == pytest.approx(samples * 0.002)
    notes = (
        f"a delay of {delay:g} s is not a whole number of control periods of 0.002 s: "
        f"the plant delays by {samples * 0.002:g} s",
    )
    assert run.notes == (() if delay == 0.01 else notes)


def test_the_controller_computes_with_the_robot_it_believes(paper: Robot) -> None:
    light = scale_masses(paper, "arm_*", 0.7)
    plant = Plant(controller_model=light)
    run = track(paper, "eight", duration=0.01, dynamic=PaperDynamic(), plant=plant)
    hold = ReducedDynamics(light).bias(run.q[0], run.nu[0])
    np.testing.assert_allclose(run.tau[0, 2:], hold[2:], atol=1e-9)
    assert run.controller_model == paper.name


def test_what_does_not_fit_is_told(paper: Robot, tiago: Robot) -> None:
    with pytest.raises(UnknownNameError, match="actuator 'wheel' is not known"):
        track(paper, "eight", duration=0.1, plant=Plant(tau_bias={"wheel": 1.0}))
    with pytest.raises(UnknownNameError, match="actuator 'wheel' is not known"):
        track(paper, "eight", duration=0.1, plant=Plant(joint_friction={"wheel": 1.0}))
    with pytest.raises(RpctlError, match="has other quasi_velocities than paper"):
        track(paper, "eight", duration=0.1, plant=Plant(controller_model=tiago))
    with pytest.raises(RpctlError, match="delay is -1"):
        Plant(delay=-1.0)
    with pytest.raises(RpctlError, match="tau_bias of a is nan"):
        Plant(tau_bias={"a": float("nan")})
    for size in (-1.0, float("inf")):
        with pytest.raises(RpctlError, match=f"joint_friction of a is {size:g}; give an effort"):
            Plant(joint_friction={"a": size})


def test_dry_friction_stops_a_rolling_robot(tmp_path: Path) -> None:
    """Two wheels of .15 m with 3 N·m each: −40 N on M_v; the controller's model knows nothing."""
    dynamics = ReducedDynamics(rpctl.load(write(tmp_path, platform(SET_A))))
    plant = Plant(joint_friction={"left_joint": 3.0, "right_joint": 3.0})
    simulated = plant.simulated_dynamics(dynamics)
    q, nu = dynamics.robot.configuration(), np.array([2.0, 0.0])
    end = advance(simulated, q, nu, np.zeros(2), 0.1, 0.01)
    inertia = dynamics.inertia(q)[0, 0]
    assert end.nu[0] == pytest.approx(2.0 - 2 * 3.0 / 0.15 / inertia * 0.1, rel=1e-4)
    lost = dynamics.energy(q, nu) - dynamics.energy(end.q, end.nu)
    assert end.work == 0.0 and end.lost == pytest.approx(lost, rel=1e-12)
    assert plant.known_robot(dynamics.robot).losses is None
    assert Plant().simulated_dynamics(dynamics) is dynamics


def test_samples_that_never_arrive_leave_the_efforts_on(paper: Robot) -> None:
    """A third is lost, the same in every run, and the laws know how long ago the last one was."""
    runs = [
        track(
            paper,
            "circle",
            duration=0.6,
            dynamic=rpctl.IntegralDynamic(),
            plant=Plant(dropped=share),
        )
        for share in (0.3, 0.3, 0.0)
    ]
    held = [(np.diff(run.tau, axis=0) == 0.0).all(axis=1) for run in runs]
    np.testing.assert_array_equal(held[0], held[1])
    assert 0.2 < held[0].mean() < 0.4
    assert not held[2].any()
    distance = np.linalg.norm(runs[0].log.base - runs[2].log.base, axis=1)
    assert 0.0 < distance.max() < 1e-3
    for share in (-0.1, 1.0, np.nan):
        with pytest.raises(RpctlError, match="give a fraction from 0 to less than 1"):
            Plant(dropped=share)


def test_the_simulated_robot_is_the_varied_one(paper: Robot) -> None:
    """Everything that a file can say of it comes back, moves the robot, and not its controller."""
    plant = Plant(
        masses={"*": 1.3},
        centres={"arm_*": (0.0, 0.02, 0.0)},
        inertias={"base_link": 1.5},
        radii={"wheel_*": 1.1},
        track=1.2,
        damping={"wheel_*": 0.2},
    )
    law = PaperDynamic()
    plain = track(paper, "eight", duration=0.02, initial_error=OFF, dynamic=law, collisions=False)
    run = track(
        paper, "eight", duration=0.02, initial_error=OFF, dynamic=law, plant=plant, collisions=False
    )
    np.testing.assert_array_equal(run.tau[0], plain.tau[0])  # at rest, from what the law believes
    varied = ReducedDynamics(vary(paper, plant))
    q, nu = run.q[5], run.nu[5]
    states = [(run.q[k], run.nu[k]) for k in (5, 6)]
    expected = advance(varied, q, nu, run.tau[5], 0.002, 0.002)
    np.testing.assert_allclose(np.concatenate(states[1]), np.concatenate(expected[:2]), atol=1e-14)
    S = varied.basis(q)
    wheel = paper.velocity_index("wheel_left_joint")
    assert run.log.rates[5, 0] == pytest.approx(float(S[wheel] @ nu))
    assert run.log.lost[-1] > 0.0
    assert summarize(run).energy_residual < 1e-6
