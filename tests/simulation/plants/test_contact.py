"""The plant in MuJoCo: a free body on a ground, whose wheels roll because friction lets them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.motion import rk4_step
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import DivergedError
from rpctl.robot.vary import set_limits, without_losses
from rpctl.simulation.plants.contact import MujocoMotion
from rpctl.simulation.plants.settings import Wrench
from tests.grids import cells
from tests.robots import SET_A, add_losses, ball, platform, write

pytest.importorskip("mujoco")

MU, G = 0.7, 9.81
PERIOD = 2e-3  # s
CROWNED = ContactSettings(wheel_shape="crowned")


def start(robot: Robot, settings: ContactSettings = CROWNED, friction: float = MU) -> MujocoMotion:
    """Return a robot at home at (1, 2, .5), settled."""
    q = robot.configuration_at(np.array([1.0, 2.0, 0.5]), robot.home)
    return MujocoMotion(robot, settings, friction, q)


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The platform on a ball; of set A, 32 kg."""
    return rpctl.load(write(tmp_path_factory.mktemp("cart"), platform(SET_A, extra=ball(0.5))))


def test_it_stands_where_it_is_put_and_the_ground_bears_its_weight(paper: Robot) -> None:
    motion = start(paper, ContactSettings())
    contacts = find_contacts(ReducedDynamics(paper))
    assert contacts is not None
    load = motion.ground().load
    assert len(load) == len(contacts.names)
    assert load.sum() == pytest.approx(G * paper.mass, rel=1e-3)
    before = motion.q
    np.testing.assert_allclose(paper.base_pose(before), [1.0, 2.0, 0.5], atol=1e-9)
    for _ in range(100):
        motion.advance(np.zeros(len(paper.actuators)), PERIOD)
    np.testing.assert_allclose(motion.q, before, atol=2e-5)
    np.testing.assert_allclose(motion.ground().load, load, rtol=1e-3)
    assert motion.notes == ()


def test_a_push_accelerates_it_and_its_rolling_wheels(cart: Robot) -> None:
    """F = (m + 2 I_s/r²) a along the heading; all of its work is kinetic energy."""
    motion = start(cart)
    heading = np.array([math.cos(0.5), math.sin(0.5), 0.0])
    push = Wrench("base", tuple((20.0 * heading).tolist()))
    inertia = cart.mass + 2 * SET_A["I_s"] / SET_A["r"] ** 2
    steps = [motion.advance(np.zeros(2), PERIOD, [push]) for _ in range(250)]
    assert motion.nu[0] == pytest.approx(20.0 / inertia * 0.5, rel=5e-3)
    assert abs(motion.nu[1]) < 1e-3
    kinetic = 0.5 * inertia * motion.nu[0] ** 2
    assert sum(step.work for step in steps) == pytest.approx(kinetic, rel=1e-2)
    assert 0.0 <= sum(step.lost for step in steps) < 0.01 * kinetic
    motion.advance(np.zeros(2), PERIOD)
    coasting = motion.nu[0]
    motion.advance(np.zeros(2), 0.2)
    assert motion.nu[0] == pytest.approx(coasting, rel=5e-3)  # the push has ended


def test_efforts_do_work_and_saturate_at_the_limits(cart: Robot) -> None:
    weak = set_limits(cart, effort={"left_joint": 1.0, "right_joint": 1.0})
    motion, strong = start(weak), start(cart)
    work, lost = 0.0, 0.0
    for _ in range(200):
        one, other = motion.advance(np.full(2, 5.0), PERIOD), strong.advance(np.ones(2), PERIOD)
        work, lost = work + one.work, lost + one.lost
        assert one.work == pytest.approx(other.work, abs=1e-9)
    inertia = cart.mass + 2 * SET_A["I_s"] / SET_A["r"] ** 2
    kinetic = 0.5 * inertia * motion.nu[0] ** 2
    assert kinetic == pytest.approx(work, rel=0.02)
    assert 0.0 <= lost < 0.03 * work


@pytest.mark.parametrize("shape", ["cylinder", "crowned"])
def test_it_rolls_down_a_slope_and_slides_without_friction(cart: Robot, shape: str) -> None:
    """a = g sin α m/(m + 2 I_s/r²) where wheels roll; g sin α where they hardly touch."""
    model = cart.model.copy()
    slope = 0.1
    model.gravity.linear = G * np.array([math.sin(slope), 0.0, -math.cos(slope)])
    tilted = replace(cart, model=model)
    q = tilted.configuration_at(np.zeros(3), tilted.home)
    inertia = cart.mass + 2 * SET_A["I_s"] / SET_A["r"] ** 2
    settings = ContactSettings(wheel_shape=shape)
    for friction, ratio in ((MU, cart.mass / inertia), (1e-4, 1.0)):
        motion = MujocoMotion(tilted, settings, friction, q)
        for _ in range(100):
            motion.advance(np.zeros(2), PERIOD)
        expected = G * math.sin(slope) * ratio * 0.2
        assert motion.nu[0] == pytest.approx(expected, rel=5e-3)


def spin_loss(cart: Robot, settings: ContactSettings) -> tuple[float, float]:
    """Return what a turn in place loses, N·m, and the load of a wheel, N."""
    motion, turned, lost = start(cart, settings), 0.0, 0.0
    dynamics = ReducedDynamics(cart)
    for k in range(250):
        wanted = np.array([-5.0 * motion.nu[0], 20.0 * (min(1.0, k / 50) * 0.5 - motion.nu[1])])
        tau = dynamics.efforts(motion.q, dynamics.inverse(motion.q, motion.nu, wanted))
        step = motion.advance(tau, PERIOD)
        if k >= 150:
            lost, turned = lost + step.lost, turned + motion.nu[1] * PERIOD
    return lost / turned, float(motion.ground().load[:2].mean())


def test_wheels_scrub_by_their_width(cart: Robot) -> None:
    """A cylinder touches at its two ends: μ N w/2 a wheel; a crowned one touches at one point."""
    narrow, load = spin_loss(cart, ContactSettings(wheel_width=0.03))
    wide, _ = spin_loss(cart, ContactSettings(wheel_width=0.06))
    assert narrow == pytest.approx(2 * MU * load * 0.015, rel=0.1)
    assert wide == pytest.approx(2 * narrow, rel=0.1)
    assert abs(spin_loss(cart, CROWNED)[0]) < 0.02 * narrow


def test_a_wheel_that_cannot_hold_slips(cart: Robot) -> None:
    """Efforts of twice the friction spin the wheels; pushed at its feet, it leans on them.

    a = μ N/m, and N = N₀ + m a h/l with the centre of mass h above the ground and the ball l ahead.
    """
    motion = start(cart)
    load = motion.ground().load[:2]
    assert np.abs(motion.ground().slip).max() < 1e-6
    tau = 2.0 * MU * load * SET_A["r"]
    for _ in range(50):
        motion.advance(tau, PERIOD)
    ground = motion.ground()
    assert (ground.slip[:, 0] < -1.0).all()  # the contact points run backwards
    assert np.abs(ground.slip[:, 1]).max() < 0.05
    height = (SET_A["m_c"] * 0.2 + 2 * SET_A["m_w"] * SET_A["r"]) / cart.mass
    force = MU * load.sum() / (1.0 - MU * height / 0.5)
    assert motion.nu[0] == pytest.approx(force / cart.mass * 0.1, rel=0.1)


def test_friction_holds_a_joint_and_damping_bounds_its_rate(paper: Robot) -> None:
    name = "arm_prismatic_joint"
    lossy = add_losses(without_losses(paper), {name: 50.0}, {name: 4.0})
    index = lossy.actuators.index(name)
    for force, rate in ((3.0, 0.0), (9.0, (9.0 - 4.0) / 50.0)):
        motion = start(lossy)
        tau = np.zeros(len(lossy.actuators))
        tau[index] = force
        for _ in range(200):
            step = motion.advance(tau, PERIOD)
        assert motion.nu[3] == pytest.approx(rate, abs=2e-3)
        assert step.lost == pytest.approx(force * rate * PERIOD, rel=0.05, abs=2e-5)


def test_a_robot_that_falls_is_refused(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    with pytest.raises(RpctlError, match=r"falls over.*left_joint, right_joint.*caster"):
        start(robot)
    motion = start(robot, ContactSettings(props=True))
    assert motion.notes == (
        "four added frictionless balls hold the robot up, 0.75 m from P along each axis",
    )
    assert motion.ground().load.sum() < 0.9 * G * robot.mass  # the balls bear the rest
    for _ in range(100):
        motion.advance(np.ones(2), PERIOD)
    inertia = robot.mass + 2 * SET_A["I_s"] / SET_A["r"] ** 2
    assert motion.nu[0] == pytest.approx(2.0 / SET_A["r"] / inertia * 0.2, rel=0.01)


def test_a_motion_that_leaves_the_numbers_is_told_and_nothing_is_written(
    cart: Robot, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    motion = start(cart)
    with pytest.raises(DivergedError, match=r"diverged at 0\.0.*timestep"):
        motion.advance(np.full(2, 1e14), PERIOD)
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_it_tilts_on_a_ground_that_is_no_plane(cart: Robot, tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", np.tile(0.05 * np.linspace(-5, 5, 101), (101, 1)))
    settings = ContactSettings(heights=str(tmp_path / "ramp.npy"), extent=(10.0, 10.0))
    motion = MujocoMotion(cart, settings, MU, cart.configuration_at(np.zeros(3), cart.home))
    qx, qy, _, qw = motion.pose[3:]
    assert 2.0 * math.asin(qy / qw) == pytest.approx(-math.atan(0.05), rel=0.05)  # nose up
    assert abs(qx) < 1e-3
    assert motion.notes == ()
    for _ in range(150):
        motion.advance(np.zeros(2), PERIOD)
    assert motion.nu[0] < -0.1  # downhill


def gap(robot: Robot, settings: ContactSettings, duration: float) -> tuple[float, float]:
    """Return how far MuJoCo ends from the reduced model, m and rad, after a gentle start.

    Both get the reduced model's efforts of the same acceleration of the base, open loop, and of an
    arm that is held.
    """
    dynamics = ReducedDynamics(robot)
    motion = start(robot, settings)
    q, nu = motion.q, np.zeros(robot.dof)
    count = len(robot.drive.base_speeds)
    own = count - len(robot.drive.steered)
    top = np.array({1: [0.3], 2: [0.3, 0.3], 3: [0.3, 0.2, 0.2]}[own])

    def efforts(q: Array, nu: Array, t: float) -> Array:
        acceleration = np.zeros(robot.dof)
        acceleration[:own] = top * 0.5 * math.pi / duration * math.sin(math.pi * t / duration)
        acceleration[own:count] = 0.3 * math.sin(2.0 * math.pi * t / duration)
        acceleration[count:] = 100.0 * (robot.home - robot.joint_positions(q)) - 20.0 * nu[count:]
        return dynamics.efforts(q, dynamics.inverse(q, nu, acceleration))

    for k in range(round(duration / PERIOD)):
        t = k * PERIOD
        motion.advance(efforts(motion.q, motion.nu, t), PERIOD)
        q, nu, *_ = rk4_step(dynamics, q, nu, efforts(q, nu, t), PERIOD)
    off = robot.base_pose(motion.q) - robot.base_pose(q)
    return math.hypot(*off[:2]), abs(math.remainder(off[2], 2.0 * math.pi))


def test_gentle_motion_is_the_reduced_models(paper: Robot) -> None:
    distance, turn = gap(without_losses(paper), CROWNED, 0.4)
    assert distance < 3e-4
    assert turn < 1e-3
    assert gap(without_losses(paper), ContactSettings(wheel_width=0.06), 0.4)[1] > 5e-3


@pytest.mark.parametrize(("name", "band"), [("mecanum", 5e-3), ("omni", 1e-3)])
def test_rollers_hold_along_their_axes_only(name: str, band: float) -> None:
    """Three speeds at once take it 4 cm in .3 s; rollers that lay otherwise would not let them."""
    assert gap(without_losses(rpctl.load(name)), CROWNED, 0.3)[0] < band


@pytest.mark.parametrize("name", ["car", "swerve"])
def test_tie_rods_turn_the_followers(name: str) -> None:
    robot = without_losses(rpctl.load(name))
    motion = start(robot)
    steered = [swivel.joint for swivel in robot.drive.steered]
    tau = np.array([1.0 if name == steered[0] else 0.0 for name in robot.actuators])
    angles = dict.fromkeys(steered, 0.0)
    while angles[steered[0]] < 0.2:
        motion.advance(tau, PERIOD)
        angles = {joint: robot.joint_position(motion.q, joint) for joint in steered}
    wanted = follower_positions(robot.drive, angles)
    assert max(map(abs, wanted.values())) > 0.1
    for joint, angle in wanted.items():
        off = math.remainder(robot.joint_position(motion.q, joint) - angle, math.pi)
        assert abs(off) < 3e-3


BANDS = {  # m and rad after 1.5 s, .22 to .35 m from the start
    "tiago": (1e-3, 3e-3),
    "paper": (2e-3, 3e-3),
    "mixed_chain": (2e-3, 3e-3),
    "car": (2e-3, 3e-3),
    "tricycle": (2e-3, 3e-3),
    "swerve": (2e-3, 3e-3),
    "twin_casters": (3e-3, 3e-3),
    "casters": (2e-3, 3e-3),
    "caster_drive": (5e-3, 5e-3),
    "omni": (1e-2, 5e-2),  # rollers take some energy, and a mecanum wheel's contact wanders
    "mecanum": (1.5e-2, 6e-2),
}


@pytest.mark.parametrize("name", cells(BANDS, slow=("tiago", "swerve", "mecanum")))
def test_gentle_motion_of_every_drive_is_the_reduced_models(name: str) -> None:
    distance, turn = gap(without_losses(rpctl.load(name)), CROWNED, 1.5)
    assert distance < BANDS[name][0]
    assert turn < BANDS[name][1]
