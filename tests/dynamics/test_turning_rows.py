"""Rolling rows that turn with swivels: their rates, their forces, and who shares a lateral one."""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.dynamics.rolling import find_rolling
from rpctl.robot.coordinates import Workspace
from tests.robots import SET_A, ball, platform, write
from tests.vehicles import vehicle

TURNING = ["casters", "car-like", "parallel", "tricycle", "bicycle", "steered", "twin"]
STEP = 1e-6


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind), f"{kind}.urdf"))


def steered(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return q (nq,), its swivels turned by up to half a radian, and ν (dof,)."""
    joints = {s.joint: float(rng.uniform(-0.5, 0.5)) for s in robot.drive.steered}
    joints |= {
        s.joint: float(rng.uniform(-3.0, 3.0)) for s in robot.drive.swivels if s.role == "caster"
    }
    return robot.configuration(0.3, -0.2, 0.7, joints=joints), rng.normal(size=robot.dof)


@pytest.mark.parametrize("kind", TURNING)
def test_the_ground_moves_the_centre_of_mass(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """Newton: F = m a of the centre of mass along the motion, where S changes with q."""
    robot = load(tmp_path, kind)
    dynamics = ReducedDynamics(robot)
    contacts, data = find_contacts(dynamics), robot.model.createData()
    assert contacts is not None
    for _ in range(3):
        q, nu = steered(robot, rng)
        tau = rng.normal(size=len(robot.actuators))
        nu_dot, v = dynamics.forward(q, nu, tau), dynamics.basis(q) @ nu

        def velocity(s: float) -> Array:
            at = pin.integrate(robot.model, q, s * v)  # noqa: B023 - called in this turn only
            moved = dynamics.basis(at) @ (nu + s * nu_dot)  # noqa: B023
            pin.centerOfMass(robot.model, data, at, moved)
            return data.vcom[0].copy()

        acceleration = (velocity(STEP) - velocity(-STEP)) / (2 * STEP)
        force = ground_reaction(dynamics, contacts, q, nu, tau).force
        expected = robot.mass * (acceleration - robot.model.gravity.linear)
        np.testing.assert_allclose(force, expected, atol=1e-5 * np.abs(expected).max())


def test_followers_share_the_lateral_force_of_the_nearest_leader(tmp_path: Path) -> None:
    """Of four corners the right one follows the left one beside it."""
    robot = load(tmp_path, "steered")
    names = [wheel.joint for wheel in robot.drive.wheels]
    shared = [{names[i] for i in wheels} for _, wheels in find_rolling(robot).across]
    assert shared == [{"fl_wheel", "fr_wheel"}, {"rl_wheel", "rr_wheel"}]


def test_a_wheel_that_slides_bears_no_lateral_force(tmp_path: Path) -> None:
    """A lone wheel ahead of the axle: in a steady bend its grip is used by nothing."""
    third = platform(SET_A)
    third = third[
        third.index('<link name="left_wheel">') : third.index('<link name="right_wheel">')
    ]
    third = third.replace("left_", "third_").replace('xyz="0 0.75', 'xyz="0.6 0.0')
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=third + ball(-0.5))))
    assert [wheel.slides for wheel in robot.drive.wheels] == [False, False, True]
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    assert contacts.axles == ((0, 1),)
    q, nu = robot.configuration(), np.array([0.5, 0.8])
    tau = dynamics.efforts(q, dynamics.bias(q, nu))
    ground = ground_reaction(dynamics, contacts, q, nu, tau)
    # Towards the centre of the bend: v ω of the axle's masses, no more and no less.
    mass = robot.mass
    assert ground.lateral[0] == pytest.approx(mass * 0.5 * 0.8)
    left, right = ground.load[:2]
    grip = ground.lateral[0] / (contacts.friction * (left + right))
    along = ground.longitudinal / ground.load[:3] / contacts.friction
    expected = [hypot(along[0], grip), hypot(along[1], grip), abs(along[2])]
    np.testing.assert_allclose(ground.slip_ratio, expected, rtol=1e-12)


def test_twin_wheels_roll_on_average_at_the_first_swivels_speed(tmp_path: Path) -> None:
    """ν₁ is the mean of φ̇ r over the two wheels of the first swivel, whose pivot they straddle."""
    robot, (vx, vy, omega) = load(tmp_path, "twin"), (0.4, 0.1, 0.3)
    V = {"fl": (vx - 0.3 * omega, vy + 0.4 * omega), "rl": (vx - 0.3 * omega, vy - 0.35 * omega)}
    joints = {f"{name}_steer": atan2(y, x) for name, (x, y) in V.items()}
    dynamics = ReducedDynamics(robot)
    q, nu = robot.configuration(joints=joints), np.zeros(robot.dof)
    nu[0] = hypot(*V["fl"])
    v = dynamics.basis(q) @ nu
    np.testing.assert_allclose(v[:3], [vx, vy, omega], atol=1e-12)
    speeds = [0.1 * v[robot.velocity_index(f"fl_{side}_wheel")] for side in "lr"]
    np.testing.assert_allclose(speeds, [nu[0] - 0.05 * omega, nu[0] + 0.05 * omega], atol=1e-12)


@pytest.mark.parametrize("kind", TURNING)
def test_efforts_are_those_of_where_it_is(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """B(q) τ = F at one q after the other: nothing is kept of the last."""
    robot = load(tmp_path, kind)
    dynamics = ReducedDynamics(robot)
    for _ in range(3):
        q, force = steered(robot, rng)[0], rng.normal(size=robot.dof)
        S = ReducedDynamics(robot).basis(q)
        B = np.array([S[robot.velocity_index(name)] for name in robot.actuators]).T
        np.testing.assert_allclose(B @ dynamics.efforts(q, force), force, atol=1e-9)


def test_what_the_steering_leaves_undriven_is_named(tmp_path: Path) -> None:
    """A bicycle whose handlebar nothing turns: its speed is driven, its steering is not."""
    path = write(tmp_path, vehicle("bicycle"))
    drive_text = 'type = "bicycle"\n[[swivel]]\njoint = "steer"\ndriven = false\n'
    drive_path = write(tmp_path, drive_text, "drive.toml")
    robot = rpctl.load(path, drive=drive_path)
    with pytest.raises(rpctl.RpctlError, match="no actuator drives steer of bicycle"):
        ReducedDynamics(robot).efforts(robot.configuration(), np.zeros(robot.dof))


def test_a_pendulum_swings(tmp_path: Path) -> None:
    """One joint on a fixed base: (I + m l²) θ̈ = m g l cos θ + τ, θ down from level."""
    text = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial>
      <origin xyz="0.4 0 0"/><mass value="2"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.1"/></inertial></link>
      <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/>
      <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint></robot>"""
    robot = rpctl.load(write(tmp_path, text), drive="fixed")
    dynamics = ReducedDynamics(robot)
    for theta, rate, tau in ((0.3, 0.0, 1.0), (-1.1, 2.0, -3.0)):
        q = robot.configuration(joints={"hinge": theta})
        expected = (2.0 * 9.81 * 0.4 * cos(theta) + tau) / (0.05 + 2.0 * 0.4**2)
        nu_dot = dynamics.forward(q, np.array([rate]), np.array([tau]))
        np.testing.assert_allclose(nu_dot, [expected], rtol=1e-12)
        kinetic = 0.5 * (0.05 + 2.0 * 0.4**2) * rate**2
        energy = kinetic - 2.0 * 9.81 * 0.4 * sin(theta)
        assert dynamics.energy(q, np.array([rate])) == pytest.approx(energy, rel=1e-12)


def test_a_state_or_an_inertia_out_of_range_is_told(paper: Robot) -> None:
    dynamics, q, still = ReducedDynamics(paper), paper.configuration(), np.zeros(4)
    for index in range(4):  # the arm's joints push the base no more than a wheel's
        nu, tau = still.copy(), still.copy()
        nu[index] = tau[index] = np.nan
        with pytest.raises(rpctl.RpctlError, match=r"paper: the state .* is not finite"):
            dynamics.forward(q, nu, still)
        with pytest.raises(rpctl.RpctlError, match=r"paper: the state .* is not finite"):
            dynamics.forward(q, still, tau)
        with pytest.raises(rpctl.RpctlError, match=r"paper: the state .* is not finite"):
            dynamics.bias(q, nu)
    negative = paper.model.copy()
    negative.inertias[1].mass = -1e3
    dynamics._model, dynamics._workspace = negative, Workspace(negative)
    with pytest.raises(rpctl.RpctlError, match="paper: the reduced inertia is not positive"):
        dynamics.forward(q, still, still)
