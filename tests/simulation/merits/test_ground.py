"""What a plant says of the ground, by a log written by hand; and a tilted robot is drawn so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.simulation.merits.ground import felt_ground, ground
from rpctl.simulation.run.run import Run
from rpctl.view.scene.scene import joint_poses
from tests.golden import COUNT, golden_run, load_tricycle


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_tricycle(tmp_path_factory.mktemp("tricycle"))


def felt(run: Run, **columns: Array) -> Run:
    return replace(run, log=run.log.changed(columns))


def test_slip_load_and_tilt(robot: Robot) -> None:
    """Row 3: a wheel slips by (3, 4) mm/s; row 2: a contact bears nothing; row 4: 2 degrees."""
    run = golden_run(robot)
    wheels, contacts = len(run.robot.drive.wheels), len(run.ground.contacts)
    slip = np.zeros((COUNT, wheels, 2))
    slip[3, 1] = 0.003, -0.004
    load = np.full((COUNT, contacts), 50.0)
    load[2, 0] = 0.0
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8], (COUNT, 1))
    half = math.radians(1.0)
    pose[4, 3:] = np.array([math.sin(half) * 0.6, math.sin(half) * 0.8, 0.0, math.cos(half)])
    found = felt_ground(felt(run, root_pose=pose, ground_load=load, wheel_slip=slip))
    assert found is not None
    assert found.max_wheel_slip == pytest.approx(0.005)
    assert found.slipping_wheel == run.robot.drive.wheels[1].joint
    assert found.slip_time == pytest.approx(float(run.t[3]))
    assert found.lifted == (run.ground.contacts[0],)
    assert found.max_tilt == pytest.approx(math.radians(2.0))
    assert found.sentence == (
        f"{found.slipping_wheel} slipped most, 5 mm/s at {run.t[3]:.3g} s; "
        f"{run.ground.contacts[0]} lifted; it leaned 2° at most"
    )


def test_a_wheel_that_hangs_says_so_and_does_not_slip(robot: Robot) -> None:
    """Wheel 0 spins in the air, wheel 1 lifts at rows 1 and 2, and slips on the ground."""
    run = golden_run(robot)
    wheels = [wheel.joint for wheel in run.robot.drive.wheels]
    assert run.ground.contacts[:2] == (wheels[0], wheels[1])
    slip = np.zeros((COUNT, len(wheels), 2))
    slip[:, 0, 0] = 9.0
    slip[2:4, 1, 0] = 5.0, 0.002
    load = np.full((COUNT, len(run.ground.contacts)), 50.0)
    load[:, 0] = load[1:3, 1] = 0.0
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8], (COUNT, 1))
    found = felt_ground(felt(run, root_pose=pose, ground_load=load, wheel_slip=slip))
    assert found is not None
    assert (found.lifted, found.hanging) == ((wheels[0], wheels[1]), (wheels[0],))
    assert found.sentence == (
        f"{wheels[1]} slipped most, 2 mm/s at {run.t[3]:.3g} s; {wheels[0]} carried no load "
        f"from the start: the other wheels carry the robot; {wheels[1]} lifted"
    )


def test_three_contacts_share_the_load_in_one_way(robot: Robot) -> None:
    """No range is logged of them: least and largest are over time alone."""
    run = golden_run(robot)
    load = 10.0 * np.array([1.0, 2.0, 3.0]) + np.arange(float(COUNT))[:, None]
    none = np.empty((COUNT, 0))
    assert len(run.ground.contacts) == 3
    found = ground(felt(run, contact_load=load, load_range=none, slip_range=none)).contact_loads
    assert found is not None
    assert [(each.min, each.max) for each in found] == [
        (least, least + COUNT - 1.0) for least in (10.0, 20.0, 30.0)
    ]


def test_wheels_that_roll_say_nothing(robot: Robot) -> None:
    assert felt_ground(golden_run(robot)) is None


def test_a_tilted_robot_is_drawn_tilted(robot: Robot) -> None:
    """Its joints turn about the root link by the tilt, and nothing else."""
    q = golden_run(robot).q[:1]
    (level,) = joint_poses(robot, q)
    root = level[ROOT_JOINT].copy()
    root[2] -= robot.drive.ground  # heights count from the ground
    (same,) = joint_poses(robot, q, root[None])
    np.testing.assert_allclose(same, level, atol=1e-12)
    root[2] += 0.1
    (higher,) = joint_poses(robot, q, root[None])
    np.testing.assert_allclose(higher[1:, 2], level[1:, 2] + 0.1, atol=1e-12)
