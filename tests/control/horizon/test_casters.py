"""Powered casters along a predicted motion: as the rolling constraints turn them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.constraints import WheelSpeeds
from rpctl.control.horizon.prediction import Casters, make_model
from rpctl.control.horizon.settings import Bounds
from rpctl.control.horizon.target import Sample, Target
from tests import random_vehicles
from tests.robots import write
from tests.vehicles import vehicle

STEPS, DT = 5, 0.1
SEED = 0  # of a base on four casters


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a base on four casters of any headings, some of whose axes point down."""
    text, _ = random_vehicles.vehicle("powered", SEED)
    return rpctl.load(write(tmp_path_factory.mktemp("casters"), text))


def turned(robot: Robot, q: Array, twist: Array, duration: float) -> Array:
    """Return the casters' positions after a time (s) of a constant twist, by the basis's rates."""
    dynamics, names = ReducedDynamics(robot), [s.joint for s in robot.drive.swivels]
    index = [robot.velocity_index(name) for name in names]
    nu = np.append(twist, np.zeros(robot.dof - 3))

    def rates(_: float, positions: Array) -> Array:
        at = robot.configuration(joints=dict(zip(names, positions, strict=True)))
        return np.asarray((dynamics.basis(at) @ nu)[index])

    start = [robot.joint_position(q, name) for name in names]
    return np.asarray(solve_ivp(rates, (0.0, duration), start, rtol=1e-10, atol=1e-10).y[:, -1])


@pytest.mark.parametrize(
    "twist",
    [(0.6, 0.2, 0.0), (-0.3, 0.4, 0.9), (0.0, 0.0, 0.0), (0.0, 0.02, -0.8)],
    ids=["straight", "bend", "still", "almost on the spot"],
)
def test_casters_turn_as_the_constraints_have_it(
    robot: Robot, rng: np.random.Generator, twist: tuple[float, float, float]
) -> None:
    require_turned(robot, robot.random_configuration(rng), np.array(twist))


def require_turned(robot: Robot, q: Array, twist: Array) -> None:
    casters = Casters(robot)
    found = casters.follow(casters.read(q), np.tile(twist, (3, 1)), DT)
    np.testing.assert_allclose(found[0], casters.read(q), atol=1e-14)
    expected = turned(robot, q, twist, 3.0 * DT)
    np.testing.assert_allclose(np.exp(1j * found[-1]), np.exp(1j * expected), atol=1e-7)


def test_casters_that_head_back_stay_or_swing_round(tmp_path: Path) -> None:
    """Backwards they are in a balance that nothing holds; a hair off, they swing round."""
    robot = rpctl.load(write(tmp_path, vehicle("powered")))
    casters, twists = Casters(robot), np.tile([0.8, 0.0, 0.0], (4, 1))
    found = casters.follow(np.full(3, math.pi), twists, 10.0)
    np.testing.assert_allclose(np.cos(found[1]), -1.0, atol=1e-9)
    found = casters.follow(np.full(3, math.pi - 1e-3), twists, 10.0)
    np.testing.assert_allclose(found[-1], 0.0, atol=1e-6)


def test_wheel_speeds_are_those_of_the_motion(rng: np.random.Generator) -> None:
    """Rates over their limits: ν after each step, casters turned as the constraints do before."""
    robot = rpctl.load("caster_drive")
    dynamics, bounds = ReducedDynamics(robot), Bounds()
    model = make_model(dynamics, STEPS, DT)
    q, nu = robot.random_configuration(rng), np.array([0.4, 0.1, 0.3, 0.2, 0.1])
    motion = model.predict(q, nu, 0.5 * rng.normal(size=(STEPS, robot.dof)))
    target = Target(motion.pose, motion.joints, motion.nu)
    (found,) = WheelSpeeds(model, bounds).linearise(Sample(motion, target, None))
    driven = len(robot.actuators) - len(robot.joints)
    limits = bounds.rates(robot)[1][:driven]
    names = [swivel.joint for swivel in robot.drive.swivels]
    for k in range(STEPS):
        rates = dynamics.actuation(q).T[:driven] @ motion.nu[k + 1] / limits
        np.testing.assert_allclose(found.value[k], [*(rates - 1.0), *(-rates - 1.0)], atol=1e-7)
        positions = turned(robot, q, motion.twist[k], DT)
        q = robot.configuration(joints=dict(zip(names, positions, strict=True)))
