"""What a log holds is what its names say: of the robot, of its reference, of its law."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference, reference_rates

ASKED = np.array([0.3, -0.2, 0.5, 0.1])  # m/s, rad/s, rad/s, m/s


def constant(
    dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
) -> Command:
    """Ask for the same quasi-velocities at all times."""
    return Command(ASKED, np.zeros(4))


def test_speeds_asked_for_those_of_the_reference_and_those_there_are(tricycle: Robot) -> None:
    run = rpctl.track(tricycle, "circle", duration=0.6, kinematic=constant)
    reference = load_reference(tricycle, "circle")
    assert run.log.nu_d == pytest.approx(np.tile(ASKED, (len(run.t), 1)))
    wanted = [reference_rates(tricycle, reference(t)).nu for t in run.t]
    assert run.log.nu_ref == pytest.approx(np.array(wanted))
    assert run.nu[-1] == pytest.approx(ASKED, abs=0.02)  # it does as it is asked
    assert np.abs(run.nu[0] - ASKED).min() > 0.05  # but not at once
    assert np.abs(run.nu[-1] - run.log.nu_ref[-1]).min() > 0.05
    for column, name in enumerate(run.robot.actuators):
        position = np.unwrap([tricycle.joint_position(q, name) for q in run.q])
        rate = np.gradient(position, run.t)[-100:-1]
        assert rate == pytest.approx(run.log.rates[-100:-1, column], abs=2e-3)
        assert np.abs(rate).min() > 0.05
    poses = np.array([reference(t).pose for t in run.t])
    assert run.base_ref == pytest.approx(poses)
    assert run.log.base == pytest.approx(np.array([tricycle.base_pose(q) for q in run.q]))


def test_reference_robot_of_a_log_steers_by_the_reference(tricycle: Robot) -> None:
    """Its wheels roll along the reference too; the robot is off its path, its arm pushed aside."""
    pushed = rpctl.Plant(tau_bias={"swing_joint": 10.0, "slide_joint": 40.0})
    law = rpctl.PaperDynamic()
    run = rpctl.track(
        tricycle, "circle", duration=1.0, initial_error=(0.1, -0.1, 0.1), dynamic=law, plant=pushed
    )
    held = np.array([tricycle.joint_positions(q) for q in run.q_ref])
    wanted = load_reference(tricycle, "circle")
    assert held == pytest.approx(np.array([wanted(t).joints for t in run.t]), abs=1e-9)
    assert (np.abs(held - run.log.joints).max(axis=0) > 1e-3).all()
    ahead = np.array([tricycle.joint_position(q, "steer_joint") for q in run.q_ref])
    heading, place = run.base_ref[:, 2], run.base_ref[:, :2]
    step = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = step > 1e-5
    middle = 0.5 * (ahead[1:] + ahead[:-1])[moving]
    assert moving.sum() > 50
    assert np.abs(middle).min() > 0.1
    assert middle == pytest.approx(
        np.arctan(0.8 * np.diff(heading)[moving] / step[moving]), abs=1e-3
    )
    assert np.abs(ahead - run.log.steering[:, 0]).max() > 0.01
    for name, offset in (("left_wheel_joint", 0.3), ("right_wheel_joint", -0.3)):
        turned = np.unwrap([tricycle.joint_position(q, name) for q in run.q_ref])
        rolled = step.sum() - offset * (heading[-1] - heading[0])
        assert turned[-1] - turned[0] == pytest.approx(rolled / 0.1, rel=2e-2)
