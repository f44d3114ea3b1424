"""Robots that lean on slopes: how they roll off, where they balance, and what the law makes of it.

On a ground that rises by α along x, a heading of θ and E = sin α cos θ, N = cos α:

    (M + 2 I/r²) v̇ + m l cos φ φ̈ = −M g E,
    m l cos φ v̇ + J φ̈ = m l g (N sin φ − E cos φ)

at rest, with the pitch φ of a body of m whose centre of mass is l above the axle and whose inertia
about it is J, M all the mass, I a wheel's inertia about its axle. Held by motors it stands where
the right side of the second is that of the motors, M g E r: its whole mass is above its contact.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics
from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.robot.leaning import LeaningRobot
from rpctl.simulation.config import Config
from rpctl.simulation.plants.rolling import RollingMotion
from rpctl.simulation.plants.starting import rest_at, start_motion
from tests.grids import cells
from tests.leaning import OWN, leaning

G, ALPHA, HEADING = 9.81, 0.1, 2.0
E, N = math.sin(ALPHA) * math.cos(HEADING), math.cos(ALPHA)
SLOPE = Plant(slope=(ALPHA, 0.0))
# balancer's file, its arm upright: 12 kg, .12 m above the axle, and 1 kg, .56 m above it
RADIUS, BODY, WHOLE, MOMENT = 0.1, 13.0, 15.4, 12.0 * 0.12 + 0.56  # m, kg, kg, kg m (of m l)
ABOUT_AXLE = 0.1856 + 12.0 * 0.12**2 + 0.00763333 + 0.56**2  # J, kg m²
ROLLING_MASS = WHOLE + 2.0 * 0.006 / RADIUS**2  # kg


def stiff() -> LeaningRobot:
    """Return the balancer with its arm held upright."""
    robot = rpctl.load("balancer", lock={"shoulder_joint": 0.0})
    assert isinstance(robot, LeaningRobot)
    return robot


def on_slope(robot: LeaningRobot, plant: Plant = SLOPE) -> ReducedDynamics:
    return plant.simulated_dynamics(ReducedDynamics(robot))


def at(robot: LeaningRobot, tilt: float) -> Array:
    return robot.configuration_at(np.array([1.0, 2.0, HEADING]), robot.home, tilt=tilt)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_it_rolls_off_as_by_hand(tilt: float) -> None:
    coupling = MOMENT * math.cos(tilt)
    M = np.array([[ROLLING_MASS, coupling], [coupling, ABOUT_AXLE]])
    pull = [-WHOLE * G * E, MOMENT * G * (N * math.sin(tilt) - E * math.cos(tilt))]
    wanted = np.linalg.solve(M, pull)
    robot = stiff()
    q, dynamics, still = at(robot, tilt), on_slope(robot), np.zeros(2)
    v_dot, turning, pitching = dynamics.forward(q, np.zeros(3), still)
    assert [v_dot, pitching] == pytest.approx(wanted, rel=1e-6)
    assert (turning > 0.1) == (tilt > 0.0)  # what is ahead of the axle is drawn to the left
    motion = RollingMotion(dynamics, q, 1e-4)  # in machine code
    motion.advance(still, 1e-4)
    assert motion.nu[[0, 2]] / 1e-4 == pytest.approx(wanted, rel=1e-4)


def test_it_rolls_off_in_mujoco_as_by_hand() -> None:
    pytest.importorskip("mujoco")
    robot = stiff()
    dynamics, config = on_slope(robot), Config(plant=Plant(kind="contact", slope=(ALPHA, 0.0)))
    motion = start_motion(dynamics, config, rest_at(dynamics, config.plant, at(robot, 0.0)))
    before = motion.nu
    motion.advance(np.zeros(2), 0.02)
    wanted = dynamics.forward(motion.q, motion.nu, np.zeros(2))
    assert abs(wanted[0]) > 0.3
    assert (motion.nu - before) / 0.02 == pytest.approx(wanted, abs=0.05)


def test_it_stands_with_its_mass_above_its_contact() -> None:
    """Whatever its heading; the motors carry the weight's share along the slope."""
    robot = stiff()
    dynamics = on_slope(robot)
    rest = rest_at(dynamics, SLOPE, at(robot, 0.0))
    assert robot.base_pose(rest.q) == pytest.approx([1.0, 2.0, HEADING], abs=1e-12)
    tilt = robot.tilt(rest.q)
    assert MOMENT * (N * math.sin(tilt) - E * math.cos(tilt)) == pytest.approx(WHOLE * E * RADIUS)
    assert rest.tau.sum() == pytest.approx(WHOLE * G * E * RADIUS)
    assert np.abs(dynamics.forward(rest.q, np.zeros(3), rest.tau)).max() < 1e-7


def test_a_bicycle_across_a_slope_is_plumb() -> None:
    """It leans uphill by the slope, here to its right: away from its left, where the ground falls;

    straight ahead nothing but steering needs an effort.
    """
    robot = leaning("whipple")
    plant, none = Plant(slope=(0.0, -ALPHA)), np.empty(0)
    first = ReferenceState(np.zeros(3), np.array([3.0, 0.0, 0.0]), np.zeros(3), none, none, none)
    rest = rest_at(on_slope(robot, plant), plant, robot.configuration(), first)
    assert robot.tilt(rest.q) == pytest.approx(ALPHA, abs=2e-3)
    assert robot.joint_position(rest.q, "steering_joint") == pytest.approx(0.0, abs=2e-3)
    assert rest.nu is not None
    acceleration = on_slope(robot, plant).forward(rest.q, rest.nu, rest.tau)
    assert np.abs(acceleration).max() < 1e-7 and abs(rest.tau[0]) < 1e-2


@pytest.mark.parametrize("name", cells(OWN, ["balancer"], ["whipple"]))
def test_energy_is_kept(name: str) -> None:
    """A robot that nothing drives, and that falls and rolls off, keeps it."""
    robot = leaning(name)
    dynamics = on_slope(robot, Plant(slope=(ALPHA, 0.05)))
    motion, speeds = RollingMotion(dynamics, at(robot, 0.1), 1e-3), np.full(robot.dof, 0.2)
    motion.nu = speeds
    before = dynamics.energy(motion.q, motion.nu)
    motion.advance(np.zeros(len(robot.actuators)), 0.1)
    gone = 0.5 * motion.nu @ dynamics.inertia(motion.q) @ motion.nu
    assert gone > 1e-2 and np.abs(motion.nu - speeds).max() > 5e-3
    assert dynamics.energy(motion.q, motion.nu) == pytest.approx(before, abs=1e-8 * float(gone))


COSTS = (
    ("balancer", (3.0, 0.0), 0.2, 0.35),
    ("wheel_legs", (3.0, 0.0), 0.3, 0.45),
    ("whipple", (6.0, 0.0), 0.03, 0.05),
    ("whipple", (-6.0, 0.0), -0.05, -0.03),
)


@pytest.mark.parametrize(
    ("name", "slope", "least", "most"), cells(COSTS, slow=[COSTS[0], COSTS[3]])
)
def test_a_slope_that_nobody_told_costs_some_of_its_place(
    name: str, slope: tuple[float, float], least: float, most: float
) -> None:
    """Uphill it falls behind, downhill it is ahead, by what its motors have to carry; the tilt
    is that of the slope.
    """
    robot, plant = leaning(name), Plant(slope=(math.radians(slope[0]), math.radians(slope[1])))
    way = (10.0, 3.0) if robot.rolls_sideways else (2.0, 0.3)
    run = rpctl.track(robot, "line", size=way[0], speed=way[1], duration=6.0, plant=plant,
                      control_period=0.004, collisions=False)  # fmt: skip
    assert rpctl.summarize(run).outcome in ("tracked", "late")
    ahead, aside, turned = run.log.e[-1, :3]
    assert least < ahead < most and max(abs(aside), abs(turned)) < 1e-6
    settled = robot.tilt(rest_at(on_slope(robot, plant), plant, run.q[-1], None).q) if way[1] < 1 \
        else 0.0  # fmt: skip
    assert robot.tilt(run.q[-1]) == pytest.approx(settled, abs=5e-3)
