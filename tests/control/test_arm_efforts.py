"""Efforts of an arm beside a base that takes a twist: formulas by hand, loops, faults."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Controller, Robot
from rpctl.arrays import Array
from rpctl.control.arm_efforts import ArmEfforts
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.law import Command
from rpctl.control.output_groups import OutputGroup
from rpctl.control.ros_messages import commands_of, fill
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plants.starting import SteppedPlant
from tests.grids import cells

PERIOD = 0.02
LATE = {"base": OutputGroup("twist", lag=0.1, dead_time=0.05), "*": OutputGroup("effort")}


def by_hand(robot: Robot, q: Array, nu: Array, nu_dot: Array) -> tuple[float, float]:
    """Newton's and Euler's equations of the paper's arm, which moves in a level plane.

    Its axis is .2 m ahead of P. A link of 4 kg and .12 kg m² has its centre .25 m from the axis;
    the slider's, of 2 kg and .05 kg m², is .2 m short of the slider's position.
    """
    (v, omega, _, slide), (v_dot, omega_dot, _, slide_dot) = nu, nu_dot
    angle, place = robot.joint_positions(q)
    turn, turn_dot, far = omega + nu[2], omega_dot + nu_dot[2], place - 0.2
    axis = np.array([v_dot - 0.2 * omega**2, v * omega + 0.2 * omega_dot])
    along = axis @ [math.cos(angle), math.sin(angle)]
    across = axis @ [-math.sin(angle), math.cos(angle)]
    moment = 4.0 * 0.25 * (across + 0.25 * turn_dot) + 0.12 * turn_dot
    moment += 2.0 * far * (across + far * turn_dot + 2.0 * slide * turn) + 0.05 * turn_dot
    return moment, 2.0 * (along + slide_dot - far * turn**2)


def test_the_arm_gets_the_efforts_that_its_motion_takes_on_a_base_that_accelerates(
    paper: Robot,
) -> None:
    output = VelocityOutput(groups={"base": OutputGroup("twist"), "*": OutputGroup("effort")})
    started = ReducedDynamics(paper), PERIOD, None
    law = ArmEfforts(PaperDynamic(), output.on(paper), started, compiled=False)
    q = paper.state((0.4, -0.2, 0.7), joints=dict(zip(paper.joint_names, (0.6, 0.9), strict=True)))[
        0
    ]
    nu, nu_dot = np.array([0.5, -0.8, 0.4, 0.3]), np.array([0.7, 1.1, -0.9, 0.6])
    wrong = np.array([9.0, 9.0, 0.0, 0.0])  # the base's command does not count, what it does does
    command = Command(nu + wrong, nu_dot + wrong)
    found = law(MeasuredSample(0.0, q, nu), command, nu_dot + wrong[::-1])
    assert found is not None
    assert found.tau == pytest.approx([0.0, 0.0, *by_hand(paper, q, nu, nu_dot)])


def test_a_base_that_lags_is_foreseen(paper: Robot) -> None:
    """Period .02 s, T = .1 s, T_d = .05 s: the command of .05 s ago begins to act now."""
    output = VelocityOutput(groups=LATE).on(paper).start(ReducedDynamics(paper), PERIOD)
    q, nu = paper.configuration(), np.array([0.1, -0.2, 0.0, 0.0])
    for k in range(4):
        output.predict(k * PERIOD, q, nu)
        output.sent(k * PERIOD, np.array([0.1 * k, 0.0, 0.0, 0.0]))
    # What was sent at .02 s acts from .07 s on, the middle of the period that begins at .06 s.
    share = (1.0 - math.exp(-0.2)) / PERIOD
    assert output.coming(0.06, nu)[:2] == pytest.approx([share * (0.1 - 0.1), share * 0.2])
    assert output.coming(0.08, nu)[:2] == pytest.approx([share * (0.2 - 0.1), share * 0.2])


def test_an_arm_follows_by_efforts_on_a_base_that_takes_a_twist(paper: Robot) -> None:
    """Its base lags .1 s and waits .05 s; told nothing of what it does, the arm is 16 mrad off."""
    run = rpctl.track(paper, "eight", output=LATE, control_period=PERIOD, duration=5.0,
                      collisions=False)  # fmt: skip
    error = np.abs(run.q - run.q_ref)[run.t > 3.0, :6]
    assert error[:, :4].max() < 5e-4
    assert error[:, 4:].max() < 1.5e-3
    assert np.abs(run.tau[:, :2]).max() > 0.1  # the base's own controllers have efforts


@pytest.mark.parametrize("plant", cells(["ideal", "contact"], slow=["contact"]))
def test_tiago_follows_an_eight_by_twist_and_efforts(plant: str) -> None:
    """As its end effector follows by twist and positions, or better: 4 mm in contact."""
    if plant == "contact":
        pytest.importorskip("mujoco")
    output = {"base": OutputGroup("twist", lag=0.1), "*": OutputGroup("effort")}
    run = rpctl.track(rpctl.load("tiago"), "eight", output=output, control_period=0.01,
                      duration=6.0, plant=plant, collisions=False)  # fmt: skip
    found = rpctl.summarize(run)
    assert found.outcome == "tracked"
    assert (found.rms_end_effector_error or 1.0) < (2e-4 if plant == "ideal" else 6e-3)


def stepped(robot: Robot, faults: Any) -> tuple[list[rpctl.ControllerOutput], Array]:
    """Return what is sent, and ν (K, dof), in 6 s on the eight."""
    groups = {"base": OutputGroup("twist", lag=0.1), "*": OutputGroup("effort")}
    output = VelocityOutput(groups=groups)
    q = robot.configuration_at(np.zeros(3), robot.home)
    config = Config(run=RunSettings(control_period=PERIOD), output=output.on(robot))
    plant = SteppedPlant(robot, config, q)
    controller = Controller(robot, "eight", period=PERIOD, output=output, rest=plant.rest,
                            compiled=False)  # fmt: skip
    sent, nu = [], []
    for k in range(300):
        t, q, rates = plant.sample
        sent.append(controller.step(t, *faults(controller, k, q, rates)))
        plant.step(sent[-1], PERIOD)
        nu.append(plant.state.nu)
    return sent, np.array(nu)


def test_without_samples_base_and_arm_are_both_braked(paper: Robot) -> None:
    def faults(controller: Controller, k: int, q: Array, nu: Array) -> tuple[Array, Array]:
        if k == 250:
            controller.pause(motors_off=True)
        return (q * math.nan if 100 <= k < 200 else q), nu

    sent, nu = stepped(paper, faults)
    assert [each.status for each in sent[99:108:4]] == ["ok", "held", "stopped"]
    for each in sent:
        assert np.isfinite(each.efforts).all()
        assert (each.efforts[:2] == 0.0).all()
        assert list(each.commands["*"].efforts.values()) == each.efforts[2:].tolist()
        assert not each.commands["*"].speeds
    assert np.abs(nu[199]).max() < 0.03 < 0.1 < np.abs(nu[99]).max()
    assert np.abs(nu[100:, 2:]).max() < 0.5
    assert (sent[260].efforts == 0.0).all()
    message = type("Message", (), {})()
    fill(message, None, commands_of(sent[50])["*"], PERIOD)
    assert message.data == sent[50].efforts[2:].tolist()


def test_an_integral_learns_what_pushes_the_arm_as_where_all_are_efforts(paper: Robot) -> None:
    """1 N·m and 1 N that nobody knows: 7 mrad; an integral that waits leaves 72."""
    run = rpctl.track(paper, "eight", output=LATE, control_period=PERIOD, duration=5.0,
                      plant=rpctl.Plant(tau_bias={"arm_*": 1.0}), collisions=False)  # fmt: skip
    assert np.abs(run.q - run.q_ref)[run.t > 4.0, 4:6].max() < 8e-3
