"""Robots that take speeds and positions: servos in MuJoCo, and what becomes of positions."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.group_commands import GroupCommand
from rpctl.control.law import Command
from rpctl.control.output_groups import OutputGroup
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.vary import set_limits
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plants.interfaces import Interface
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import rest_at, start_interface

PERIOD = 0.01


def sent(nu: Array, **positions: float) -> ControllerOutput:
    command = GroupCommand("position", {}, positions, {})
    return ControllerOutput(np.empty(0), nu, Command(nu, 0.0 * nu), commands={"*": command})


def in_contact(robot: Robot, groups: dict[str, OutputGroup], kind: str = "contact") -> Interface:
    if kind == "contact":
        pytest.importorskip("mujoco")
    run = RunSettings(control_period=PERIOD)
    config = Config(run=run, plant=Plant(kind=kind), output=VelocityOutput(groups=groups))
    dynamics = ReducedDynamics(robot)
    q = robot.configuration_at(np.zeros(3), robot.home)
    return start_interface(dynamics, config, rest_at(dynamics, config.plant, q))


def test_a_joint_that_is_sent_positions_is_moved_by_them_alone(paper: Robot) -> None:
    """From 0 to .03 rad in 10 ms: 3 rad/s, whatever rate comes along; then it is held."""
    groups = {"base": OutputGroup("twist"), "*": OutputGroup("position")}
    plant = in_contact(paper, groups, "rolling")
    home, nu = float(paper.home[0]), np.array([0.1, 0.2, 9.0, 0.4])
    for expected in (3.0, 0.0):
        plant.take(sent(nu, arm_revolute_joint=home + 0.03))
        plant.advance(PERIOD)
        assert plant.state.nu == pytest.approx([0.1, 0.2, expected, 0.4])
    assert paper.joint_positions(plant.state.q)[0] == pytest.approx(home + 0.03)


def test_servos_in_contact_wait_for_their_dead_time_and_rise_by_their_lag(paper: Robot) -> None:
    """T = .1 s: 63 % of .2 m/s .1 s after the dead time of 50 ms; the arm's own is 0."""
    groups = {"base": OutputGroup("twist", 0.1, 0.05), "*": OutputGroup("velocity")}
    plant, rows = in_contact(paper, groups), []
    for _ in range(60):
        plant.take(sent(np.array([0.2, 0.0, 0.3, 0.0])))
        plant.advance(PERIOD)
        rows.append(plant.state.nu)
    v, joint = np.array(rows)[:, 0], np.array(rows)[:, 2]
    assert np.abs(v[:4]).max() < 2e-3
    assert v[14] == pytest.approx(0.2 * (1.0 - np.exp(-1.0)), abs=0.02)
    assert v[-1] == pytest.approx(0.2, abs=4e-3)
    motion = 0.5 * paper.mass * v[-1] ** 2  # J, of the base alone
    assert motion < plant.state.work < 3.0 * motion
    assert joint[19] == pytest.approx(0.3, abs=0.02)


def test_a_servo_in_contact_has_no_more_than_the_effort_limit(paper: Robot) -> None:
    """Two motors of .1 N·m on wheels of .15 m push a robot of m kg to 2 · .1/(.15 m) m/s²."""
    weak = set_limits(paper, effort={"wheel_*": 0.1}, velocity={})
    plant = in_contact(weak, {"base": OutputGroup("wheel-speeds"), "*": OutputGroup("velocity")})
    efforts = np.zeros(4)
    for _ in range(50):
        efforts = plant.take(sent(np.array([1.0, 0.0, 0.0, 0.0])))
        plant.advance(PERIOD)
    assert efforts[:2] == pytest.approx([0.1, 0.1])
    assert plant.state.nu[0] == pytest.approx(0.5 * 2 * 0.1 / 0.15 / paper.mass, rel=0.1)


def test_the_arm_begins_without_sag() -> None:
    """A joint that gravity loads stays within a milliradian of where it was told to stay."""
    robot = rpctl.load("mecanum")
    plant = in_contact(robot, {"base": OutputGroup("twist"), "*": OutputGroup("position")})
    home = dict(zip(robot.joint_names, robot.home.tolist(), strict=True))
    for _ in range(50):
        plant.take(sent(np.zeros(robot.dof), **home))
        plant.advance(PERIOD)
    assert np.abs(robot.joint_positions(plant.state.q) - robot.home).max() < 1e-3


@pytest.mark.slow
def test_each_output_tracks_in_contact() -> None:
    for name, output in (
        ("paper", "wheel-speeds"), ("car", "steering"),
        ("mecanum", {"base": "twist", "*": "position"}),
    ):  # fmt: skip
        run = rpctl.track(rpctl.load(name), "eight", plant="contact", output=output,
                          control_period=PERIOD, duration=3.0, collisions=False)  # fmt: skip
        found = rpctl.summarize(run).to_dict()
        assert found["rms_base_error"] < 0.01, name
        assert found["rms_end_effector_error"] < 0.015, name
