"""A robot that takes speeds: how it follows them, and what is logged of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import (
    EndEffector,
    Horizon,
    Plant,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
    UnifiedKinematic,
    VelocityOutput,
    summarize,
    track,
)
from rpctl.control.law import KinematicLaw
from rpctl.simulation.config import Config
from rpctl.simulation.plants.rolling import VelocityPlant
from tests.grids import cells


def test_a_step_arrives_late_and_bends_as_it_should(paper: Robot) -> None:
    """ν = c (1 − e^(−(t − T_d)/T)); the dead time is no whole number of periods."""
    lag, dead, period = np.array([0.1, 0.3, 0.0, 0.05]), 0.034, 0.01
    plant = VelocityPlant(ReducedDynamics(paper), lag, np.full(len(lag), dead), period, 0.002)
    q, nu = paper.configuration_at(np.zeros(3), paper.home), np.zeros(4)
    command, rows = np.array([0.5, 0.4, -0.3, 0.2]), []
    for _ in range(20):
        plant.send(command)
        ahead = nu + period * plant.acceleration(q, nu)
        q, nu, *_ = plant.advance(q, nu)
        np.testing.assert_allclose(nu, ahead, atol=1e-15)
        rows.append(nu)
    passed = np.maximum((np.arange(20) + 1.0) * period - dead, 0.0)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        late = np.where(passed > 0.0, np.exp(-passed / lag), 1.0)
    np.testing.assert_allclose(rows, command * (1.0 - late), atol=1e-14)
    risen = np.sum(command[0] * (passed[-1, 0] - 0.1 * (1.0 - late[-1, 0])))
    turned = command[1] * (passed[-1, 0] - 0.3 * (1.0 - late[-1, 1]))
    assert paper.base_pose(q)[2] == pytest.approx(turned, abs=1e-12)
    assert np.hypot(*paper.base_pose(q)[:2]) == pytest.approx(risen, rel=1e-3)


def test_a_joint_stops_at_its_limit_and_leaves_it_late() -> None:
    """Steered at 1 rad/s into its stop at 1.4 rad; then it leaves as from rest, a lag later."""
    robot, lag, period = rpctl.load("tricycle"), 0.3, 0.05
    at = robot.entries[robot.drive.steered[0].joint].index
    plant = VelocityPlant(ReducedDynamics(robot), np.full(robot.dof, lag), 0.0, period, 0.01)
    q, nu = robot.configuration_at(np.zeros(3), robot.home), np.zeros(robot.dof)
    angles = []
    for k in range(48):
        command = np.zeros(robot.dof)
        command[1] = 1.0 if k < 40 else -1.0
        plant.send(command)
        ahead = nu + period * plant.acceleration(q, nu)
        q, nu, *_ = plant.advance(q, nu)
        np.testing.assert_allclose(nu, ahead, atol=1e-12)
        angles.append(float(q[at]))
    assert max(angles) <= 1.4 + 1e-12
    assert angles[39] == pytest.approx(1.4)
    left = 8 * period
    assert nu[1] == pytest.approx(-(1.0 - np.exp(-left / lag)))
    assert angles[-1] == pytest.approx(1.4 - (left - lag * (1.0 - np.exp(-left / lag))))


def test_each_quasi_velocity_begins_after_its_own_dead_time(paper: Robot) -> None:
    """At 10 ms a period dead times of 0, 5, 12 and 30 ms, without a lag."""
    dead, period = np.array([0.0, 0.005, 0.012, 0.03]), 0.01
    plant = VelocityPlant(ReducedDynamics(paper), np.zeros(4), dead, period, 0.002)
    q, nu, rows = paper.configuration_at(np.zeros(3), paper.home), np.zeros(4), []
    for k in range(5):
        plant.send(np.full(4, 0.1 * (k + 1)))
        q, nu, *_ = plant.advance(q, nu)
        rows.append(10.0 * nu)
    np.testing.assert_allclose(np.transpose(rows)[:3], [[1, 2, 3, 4, 5]] * 2 + [[0, 1, 2, 3, 4]])
    np.testing.assert_allclose(np.transpose(rows)[3], [0, 0, 0, 1, 2])


@pytest.mark.parametrize("kept", [False, True])
def test_efforts_are_those_that_the_motion_takes(paper: Robot, kept: bool, tmp_path: Path) -> None:
    """τ of each sample moves the dynamics as the interface did; work is the energy's change."""
    run = track(paper, "eight", duration=0.6, output=VelocityOutput(0.1, 0.05), control_period=0.01)
    dynamics = ReducedDynamics(paper)
    for k in (0, 20, 55):
        change = (run.nu[k + 1] - run.nu[k]) / 0.01
        np.testing.assert_allclose(
            dynamics.forward(run.q[k], run.nu[k], run.tau[k]), change, atol=1e-9
        )
    np.testing.assert_allclose(run.log.work, run.log.energy - run.log.energy[0], atol=1e-12)
    if kept:
        run = Run.load(run.save(tmp_path / "run.npz"))
    assert run.config.output == VelocityOutput(0.1, 0.05)
    assert any("which the robot follows with a lag of 0.1 s and a dead" in x for x in run.notes)
    assert summarize(run).max_effort_ratio == pytest.approx(
        float(np.max(np.abs(run.tau) / paper.effort_limits))
    )


def test_losses_are_part_of_the_work(paper: Robot) -> None:
    """A wheel's friction f at rate ω takes ∫ f |ω| dt, where it is fast beside what it takes."""
    plant = Plant(joint_friction={"wheel_left_joint": 1.0})
    run = track(
        paper,
        "circle",
        duration=0.6,
        initial_error=(0.3, 0.0, 0.0),
        output="velocity",
        control_period=0.02,
        plant=plant,
    )
    turned = float(np.ptp(run.log.others[:, run.robot.other_names.index("wheel_left_joint")]))
    assert run.log.lost[-1] == pytest.approx(turned, rel=0.02)
    np.testing.assert_allclose(
        run.log.work, run.log.energy - run.log.energy[0] + run.log.lost, atol=1e-12
    )


def test_a_bias_and_dry_friction_are_overcome(paper: Robot) -> None:
    plain, loaded = (
        track(
            paper,
            "circle",
            duration=0.4,
            initial_error=(0.3, 0.0, 0.0),
            output="velocity",
            control_period=0.02,
            plant=plant,
        )
        for plant in (
            Plant(),
            Plant(tau_bias={"wheel_left_joint": 2.0}, joint_friction={"wheel_left_joint": 1.0}),
        )
    )
    np.testing.assert_array_equal(plain.q, loaded.q)
    moving = plain.log.rates[5:, 0] > 0.5
    assert moving.any()
    more = (loaded.tau - plain.tau)[5:, 0][moving]
    np.testing.assert_allclose(more, -1.0, atol=0.05)


LAWS: dict[str, KinematicLaw] = {
    "unified": UnifiedKinematic(),
    "horizon": Horizon(),
    "end-effector": EndEffector(),
}


@pytest.mark.parametrize(
    "name, dead_time",
    cells([(law, d) for law in LAWS for d in (0.0, 0.1)], slow=[("unified", 0.1)]),
)
def test_a_lag_costs_less_than_a_millimetre(
    paper: Robot, tiago: Robot, name: str, dead_time: float
) -> None:
    """From no initial error over an eight; not told of its lag, a law learns it on the way."""
    law = LAWS[name]
    robots = (paper,) if name == "unified" else (paper, tiago)
    duration = 4.0 if name == "unified" else 12.0
    for robot in robots:
        known, true = VelocityOutput(0.1, dead_time), Plant(lag=0.1, dead_time=dead_time)
        best = track(
            robot,
            "eight",
            duration=duration,
            kinematic=law,
            control_period=0.02,
            output=known,
            collisions=False,
        )
        blind = track(
            robot,
            "eight",
            duration=duration,
            kinematic=law,
            control_period=0.02,
            plant=true,
            output="velocity",
            collisions=False,
        )
        good, bad = summarize(best), summarize(blind)
        assert good.rms_base_error < 1e-3
        assert (good.rms_end_effector_error or 0.0) < 1e-3
        assert good.rms_base_error < bad.rms_base_error < 5e-3
        assert duration < 5.0 or (bad.settled_base_error or 1.0) < 1e-3
        assert any(
            "follows its speeds differently from the settings" in note for note in blind.notes
        )
        assert not any("otherwise" in note for note in best.notes)


def test_the_plant_may_be_later_than_its_controller_knows(paper: Robot) -> None:
    output, plant = VelocityOutput(0.1, 0.05, lags={"omega": 0.2}), Plant(lag=0.15, delay=0.04)
    truth = plant.velocity_interface(output)
    assert (truth.lag, truth.dead_time, dict(truth.lags)) == (0.15, 0.05, {})
    run = track(paper, "circle", duration=0.2, output=output, plant=plant, control_period=0.02)
    assert np.flatnonzero(run.nu[:, 1])[0] == 5  # .05 s, .04 s, and it is seen a sample later
    note = next(each for each in run.notes if "speeds" in each)
    assert "a lag of 0.15 s and a dead time of 0.05 s" in note
    assert "assumes that the robot follows them with a lag of 0.1 s and a dead" in note
    assert "; omega with a lag of 0.2 s and a dead" in note


def test_a_lag_of_efforts_is_refused(paper: Robot) -> None:
    with pytest.raises(RpctlError, match=r"add the table \[output\], or --output velocity"):
        track(paper, "circle", duration=0.1, plant=Plant(lag=0.1))
    with pytest.raises(RpctlError, match="lag is -1; give a time"):
        Plant(lag=-1.0)
    with pytest.raises(RpctlError, match="dead_time is nan; give a time"):
        Plant(dead_time=float("nan"))


def test_options_of_the_output() -> None:
    assert Config().with_output(None) == Config()
    velocity = Config().with_output("velocity", 0.1)
    assert velocity.output == VelocityOutput(0.1)
    assert velocity.with_output(None, dead_time=0.2).output == VelocityOutput(0.1, 0.2)
    assert velocity.with_output("velocity").output == VelocityOutput(0.1)
    assert velocity.with_output("effort").output is None
    with pytest.raises(RpctlError, match="add --output velocity"):
        Config().with_output(None, lag=0.1)
