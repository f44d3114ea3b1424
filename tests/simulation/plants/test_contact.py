"""The plant in MuJoCo: a free body on a ground."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.simulation.plants.contact import MujocoMotion

pytest.importorskip("mujoco")


def test_a_robot_stands_where_it_is_put_and_the_ground_bears_its_weight() -> None:
    robot = rpctl.load("paper")
    q = robot.configuration_at(np.array([1.0, 2.0, 0.5]), robot.home)
    motion = MujocoMotion(robot, ContactSettings(), 0.7, q)
    ground = motion.ground()
    assert ground.load.sum() == pytest.approx(9.81 * robot.mass, rel=1e-3)
    hold = np.zeros(len(robot.actuators))
    for _ in range(100):
        motion.advance(hold, 0.002)
    np.testing.assert_allclose(motion.q, q, atol=2e-5)
    assert motion.notes == ()
