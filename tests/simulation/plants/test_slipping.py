"""A robot on tyres: paper and pencil, conservation, and the rolling model as its limit."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.drive.detect import detect
from rpctl.drive.drive import DriveSpec
from rpctl.dynamics.ground_reaction import contact_points, find_contacts, ground_reaction
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError
from rpctl.robot.load import load
from rpctl.simulation.plants.rolling import SlippingMotion
from rpctl.simulation.plants.settings import Slipping, Wrench
from tests import urdf
from tests.grids import cells
from tests.robots import SET_A, add_losses, ball, cargo, platform, wheel, write
from tests.vehicles import vehicle

G = 9.81
STIFFNESSES = (40.0, 80.0, 160.0)


def motion_of(
    robot: Robot,
    q: Array | None = None,
    friction: float = 0.7,
    longest: float = 0.002,
    **settings: float,
) -> SlippingMotion:
    """Return a robot at rest on tyres."""
    place = robot.configuration() if q is None else q
    return SlippingMotion(robot, Slipping(**settings), friction, place, longest)


def throw(motion: SlippingMotion, v: Array) -> None:
    """Give a robot the velocity v (nv,)."""
    motion.state = motion._stepper.start(motion.q, v)


def still(robot: Robot) -> Array:
    return np.zeros(len(robot.actuators))


def energy(motion: SlippingMotion) -> float:
    """Return kinetic and potential energy, J, by Pinocchio."""
    model, v = motion.robot.model, motion.state.v
    data = model.createData()
    moving = pin.computeKineticEnergy(model, data, motion.q, v) + 0.5 * model.armature @ v**2
    return float(moving + pin.computePotentialEnergy(model, data, motion.q))


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A platform on two wheels and a frictionless ball, 32 kg; its mass at its axle's middle."""
    parameters = SET_A | {"d": 0.0}
    return load(write(tmp_path_factory.mktemp("cart"), platform(parameters, extra=ball(0.5))))


# Paper and pencil


def test_a_robot_pushed_aside_creeps_by_force_over_stiffness(cart: Robot) -> None:
    motion = motion_of(cart, slip_stiffness=25.0, creep_speed=0.02)
    push = Wrench("base", (0.0, 30.0, 0.0), (0.0, 0.0, 0.0))
    for _ in range(50):
        motion.advance(still(cart), 0.002, [push])
    loads = motion.ground().load
    np.testing.assert_allclose(loads.sum(), 32.0 * G)
    assert loads[2] == pytest.approx(0.0, abs=1e-6)  # all masses are over the axle
    ratio = 1.0 - (1.0 - 30.0 / (0.7 * 32.0 * G)) ** (1.0 / 3.0)  # of the slip at which it slides
    creep = ratio * 3.0 * 0.7 / 25.0 * 0.02
    assert creep == pytest.approx(30.0 * 0.02 / (25.0 * 32.0 * G), rel=0.1)  # F V₀/(C Σ N)
    slip = motion.ground().slip
    np.testing.assert_allclose(slip[:, 1], creep, rtol=1e-3)
    np.testing.assert_allclose(slip[:, 0], 0.0, atol=1e-3 * creep)
    assert loads[1] - loads[0] == pytest.approx(0.0, abs=0.1 * 30.0)  # the push is at the ground


def test_a_robot_thrown_aside_slows_down_by_friction(cart: Robot) -> None:
    motion = motion_of(cart, friction=0.3)
    v = np.zeros(cart.nv)
    v[1] = 2.0
    throw(motion, v)
    for _ in range(100):
        motion.advance(still(cart), 0.002)
    assert motion.state.v[1] == pytest.approx(2.0 - 0.3 * G * 0.2, rel=1e-6)
    loads = motion.ground().load
    height = (30.0 * 0.2 + 2.0 * 0.15) / 32.0  # of the centre of mass, m
    moved = 0.3 * 32.0 * G * height / 1.5  # μ m g h / track moves to the wheel that leads
    assert 0.5 * (loads[0] - loads[1]) == pytest.approx(moved, rel=1e-6)


def test_a_rolling_robot_is_slowed_down_by_rolling_resistance(cart: Robot) -> None:
    motion = motion_of(cart, rolling_resistance=0.015, creep_speed=1e-3, slip_stiffness=1e4)
    v = np.zeros(cart.nv)
    v[0] = 1.0
    for tyre in cart.drive.wheels:
        v[cart.velocity_index(tyre.joint)] = 1.0 / 0.15
    throw(motion, v)
    for _ in range(50):
        motion.advance(still(cart), 0.002)
    # At a deceleration a, the ball at .5 m takes (Σ m h a + 2 I a/r)/.5 off the wheels.
    inertia, lever = 32.0 + 2.0 * 0.005 / 0.15**2, (6.3 + 2.0 * 0.005 / 0.15) / 0.5
    slowing = 0.015 * 32.0 * G / (inertia + 0.015 * lever)
    assert motion.nu[0] == pytest.approx(1.0 - 0.1 * slowing, abs=2e-6)


def test_a_skid_steer_scrubs_as_if_its_track_were_wider(tmp_path: Path) -> None:
    b, a = SET_A["b"], 0.45  # half the track, half the wheelbase, m
    rear = [
        *wheel("rear_left", (-2 * a, b), 1, SET_A),
        *wheel("rear_right", (-2 * a, -b), 1, SET_A),
    ]
    text = platform(SET_A | {"d": -a}, extra="\n".join(rear))
    path = write(tmp_path, text)
    robot = load(path, drive=detect(FrozenTree(read(path)), DriveSpec("skid-steer")))
    assert robot.drive.track == pytest.approx(2.0 * b)  # the reduced model takes what is given
    motion = motion_of(robot, friction=0.5, longest=0.004)
    wheels = [robot.velocity_index(name) for name in robot.actuators]
    wanted = np.array([2.0 if "right" in name else -2.0 for name in robot.actuators])  # m/s
    for _ in range(250):
        motion.advance(6.0 * (wanted - 0.15 * motion.state.v[wheels]), 0.004)
    # Forces lie along the slips, longitudinal over lateral F/L = u/(a ω), and F b = L a: so
    # u = ω a²/b, and the wheels run as on a track of 2 b (1 + a²/b²).
    speed = 0.15 * float(np.abs(motion.state.v[wheels]).mean())
    assert 2.0 * speed / motion.nu[1] == pytest.approx(2.0 * b * (1.0 + (a / b) ** 2), rel=1e-2)
    np.testing.assert_allclose(np.abs(motion.ground().slip[:, 1]), a * motion.nu[1], rtol=1e-2)


def test_the_harder_it_brakes_the_more_the_front_bears_until_it_tips(tmp_path: Path) -> None:
    tall = platform(SET_A | {"d": 0.1}, extra=ball(0.5) + cargo(40.0, 0.1, 0.0, 2.0))
    robot = load(write(tmp_path, tall))
    motion = motion_of(robot, friction=0.9)
    v = np.zeros(robot.nv)
    v[1] = 3.0
    throw(motion, v)
    for _ in range(10):
        motion.advance(still(robot), 0.002)
    load_now = motion.ground().load
    assert load_now.min() == 0.0
    assert load_now.sum() == pytest.approx(72.0 * G, rel=1e-3)
    assert [note[:14] for note in motion.notes if "would tip" in note] == ["from 0.002 s o"]
    assert all("tip" not in note for note in motion_of(robot).notes)


# Conservation


@pytest.mark.parametrize("friction", [0.7, 0.15])
def test_the_tyres_forces_and_loads_are_what_changes_the_momentum(
    friction: float, tmp_path: Path
) -> None:
    robot = load(write(tmp_path, vehicle("car-like")))
    q = robot.configuration(0.3, -0.2, 0.7, joints={"steer_left": 0.2, "arm_joint": 0.4})
    motion = motion_of(robot, q, friction)
    hold = np.array([30.0, 10.0, 1.0, 0.5, 8.0])
    push = Wrench("arm", (3.0, -2.0, 5.0), (1.0, 0.5, -0.3))
    for _ in range(30):
        motion.advance(hold, 0.004, [push])
    dt = 1e-5
    data = robot.model.createData()
    for _ in range(2):  # the second step knows the accelerations
        before = pin.computeCentroidalMomentum(robot.model, data, motion.q, motion.state.v).vector
        before, centre = before.copy(), data.com[0].copy()
        motion.advance(hold, dt, [push])
    after = pin.computeCentroidalMomentum(robot.model, data, motion.q, motion.state.v).vector
    rate = (after - before) / dt

    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    points = contact_points(dynamics, contacts.supports, motion.q)
    pin.forwardKinematics(robot.model, data, motion.q)
    root = data.oMi[1]
    height = robot.drive.ground
    places = np.array([root.act(np.array([*point, height])) for point in points])
    grip = motion._stepper.law.grip(
        motion.state.contact_velocity,
        motion._stepper.law.rolling_speed(motion.state.contact_velocity[2]),
    )
    loads = motion.ground().load
    total, moment = np.zeros(3), np.zeros(3)
    for i, (place, load_here) in enumerate(zip(places, loads, strict=True)):
        tyre = robot.drive.wheels[i]
        angle = math.atan2(motion.q[3], motion.q[2])
        if tyre.swivel is not None:
            swivel = next(s for s in robot.drive.swivels if s.joint == tyre.swivel)
            position = robot.joint_position(motion.q, swivel.joint)
            angle += swivel.heading + swivel.sign * position
        d, left = (
            np.array([math.cos(angle), math.sin(angle)]),
            np.array([-math.sin(angle), math.cos(angle)]),
        )
        horizontal = -load_here * (grip.force[0, i] * d + grip.force[1, i] * left)
        force = np.array([*horizontal, load_here])
        total += force
        moment += np.cross(place - centre, force)
    pin.updateFramePlacements(robot.model, data)
    arm = data.oMf[robot.model.getFrameId("arm", pin.FrameType.BODY)].translation
    pushed = np.array(push.force)
    total += pushed + robot.mass * robot.model.gravity.linear
    moment += np.array(push.moment) + np.cross(arm - centre, pushed)
    np.testing.assert_allclose(rate[:3], total, atol=2e-3 * robot.mass * G)
    np.testing.assert_allclose(rate[3:], moment, atol=2e-3 * robot.mass * G)
    assert np.abs(total[:2]).max() > 1.0


@pytest.mark.parametrize("friction", [0.7, 0.1])
def test_work_less_losses_is_the_gain_of_energy(friction: float, paper: Robot) -> None:
    motion = motion_of(paper, friction=friction)
    start, work, lost, least = energy(motion), 0.0, 0.0, 0.0
    for k in range(60):
        done = motion.advance(np.array([12.0, -3.0, 6.0 * math.sin(0.1 * k), 9.0]), 0.004)
        work, lost, least = work + done.work, lost + done.lost, min(least, done.lost)
    assert lost > 1e-3
    assert least >= -1e-9
    assert energy(motion) - start == pytest.approx(work - lost, abs=2e-5 * (work + lost))


# The rolling model as the limit of stiff tyres


def gentle(robot: Robot, dynamics: ReducedDynamics, q: Array) -> Array:
    """Return efforts (n_act,) that accelerate a robot gently."""
    rest, wanted = np.zeros(robot.dof), np.linspace(0.3, 0.1, robot.dof)
    return dynamics.efforts(q, dynamics.inverse(q, rest, wanted))


def slip_error(robot: Robot, q: Array, stiffness: float, dt: float, steps: int) -> float:
    """Return how far rates are from those of wheels that roll."""
    dynamics = ReducedDynamics(robot)
    tau = gentle(robot, dynamics, q)
    motion = motion_of(robot, q, longest=dt, slip_stiffness=stiffness)
    there, nu = q, np.zeros(robot.dof)
    for _ in range(steps):
        motion.advance(tau, dt)
        there, nu, *_ = step(dynamics, there, nu, tau, dt)
    return float(np.abs(motion.nu - nu).max())


DRIVES = (
    *("paper", "tiago", "casters", "car-like", "tricycle", "bicycle", "steered", "twin"),
    *("omni", "mecanum", "powered"),
)


@pytest.mark.parametrize("kind", cells(DRIVES, ("paper", "omni"), ("car-like", "tiago")))
def test_gentle_motion_converges_to_rolling_with_the_stiffness(kind: str, tmp_path: Path) -> None:
    named = kind in ("paper", "tiago", "mecanum")
    robot = rpctl.load(kind) if named else load(write(tmp_path, vehicle(kind)))
    q = robot.configuration(
        0.1, 0.2, 0.3, joints=dict(zip(robot.joint_names, robot.home, strict=True))
    )
    errors = [slip_error(robot, q, each, 0.001, 60) for each in STIFFNESSES]
    assert errors[0] > 1e-7
    for softer, stiffer in pairwise(errors):
        assert softer / stiffer == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("kind", ["platform", "parallel"])
def test_joints_lose_what_they_lose_where_wheels_roll(kind: str, tmp_path: Path) -> None:
    text = platform(SET_A, extra=ball(0.5)) if kind == "platform" else vehicle(kind)
    robot = load(write(tmp_path, text))
    joints = robot.moving_joint_names
    damping, friction = (dict.fromkeys(joints, each) for each in (0.4, 0.6))
    lossy = add_losses(robot, damping, friction)
    q = robot.configuration(0.1, 0.2, 0.3)
    assert slip_error(lossy, q, 1e4, 0.001, 30) < 1e-5
    dynamics, rest = ReducedDynamics(robot), np.zeros(robot.dof)
    tau = gentle(lossy, ReducedDynamics(lossy), q)
    motion, work, lost = motion_of(lossy, q, slip_stiffness=1e4), 0.0, 0.0
    for _ in range(30):
        done = motion.advance(tau, 0.002)
        work, lost = work + done.work, lost + done.lost
    assert lost > 1e-4
    gained = energy(motion) - dynamics.energy(q, rest)
    assert gained == pytest.approx(work - lost, abs=1e-3 * work)


def test_it_stands_on_the_ground_as_it_is_put(paper: Robot) -> None:
    q = paper.configuration(1.0, -2.0, 2.5)
    motion = motion_of(paper, q)
    turn = [0.0, 0.0, math.sin(1.25), math.cos(1.25)]
    np.testing.assert_allclose(motion.pose, [1.0, -2.0, -paper.drive.ground, *turn], atol=1e-12)
    np.testing.assert_array_equal(motion.q, q)
    dynamics = ReducedDynamics(paper)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    hold = dynamics.efforts(q, dynamics.bias(q, np.zeros(paper.dof)))
    expected = ground_reaction(dynamics, contacts, q, np.zeros(paper.dof), hold).load
    np.testing.assert_allclose(motion.ground().load, expected, rtol=1e-9)
    for _ in range(20):
        motion.advance(hold, 0.002)
    np.testing.assert_allclose(motion.q, q, atol=1e-9)


def test_very_stiff_tyres_stick_and_slide_in_whole_steps(
    paper: Robot, rng: np.random.Generator
) -> None:
    motion = motion_of(paper, slip_stiffness=1e5)
    start, work, lost = energy(motion), 0.0, 0.0
    for _ in range(12):
        tau = np.array([45.0, 45.0, 1.0, 2.0]) * rng.uniform(-1.0, 1.0, 4)
        for _ in range(5):
            done = motion.advance(tau, 0.002)
            work, lost = work + done.work, lost + done.lost
    assert energy(motion) - start == pytest.approx(work - lost, abs=1e-5 * (abs(work) + lost))
    assert motion.notes == ()  # no step without a common solution of loads and forces


# What stays a constraint, and what is refused


@pytest.mark.thorough
def test_joints_that_follow_others_still_do(tmp_path: Path) -> None:
    robot = load(write(tmp_path, vehicle("car-like")))
    motion = motion_of(robot, friction=0.2)
    tau = np.zeros(len(robot.actuators))
    tau[robot.actuators.index("steer_left")] = 8.0
    tau[: len(robot.drive.wheels) - 2] = 4.0
    for _ in range(40):
        motion.advance(tau, 0.002)
    turned = robot.joint_position(motion.q, "steer_left")
    assert abs(turned) > 0.02
    exact = robot.configuration(joints={"steer_left": turned})
    found = robot.joint_position(motion.q, "steer_right")
    assert found == pytest.approx(robot.joint_position(exact, "steer_right"), abs=1e-6)

    mimic = load(write(tmp_path, vehicle("parallel"), "mimic.urdf"))
    motion = motion_of(mimic)
    tau = np.zeros(len(mimic.actuators))
    tau[mimic.actuators.index("steer_left")] = 8.0
    for _ in range(20):
        motion.advance(tau, 0.002)
    left, right = (mimic.joint_position(motion.q, f"steer_{side}") for side in ("left", "right"))
    assert abs(left) > 1e-3
    assert right == pytest.approx(-0.9 * left, abs=1e-12)


def test_a_motion_that_leaves_the_numbers_is_named(paper: Robot) -> None:
    motion = motion_of(paper)
    with pytest.raises(DivergedError, match="diverged"):
        motion.advance(np.full(len(paper.actuators), math.nan), 0.002)


@pytest.mark.slow
def test_default_laws_track_on_tyres_until_the_grip_ends() -> None:
    robot = rpctl.load("paper")

    def circle(speed: float) -> Run:
        return rpctl.track(
            robot,
            "circle",
            plant="slipping",
            friction=0.3,
            size=1.0,
            speed=speed,
            duration=2.5,
            collisions=False,
        )

    slow, fast = circle(0.8), circle(1.8)  # v²/r is .22 g and 1.1 of the grip of .3 g
    assert rpctl.summarize(slow).final_base_error < 3e-3
    assert rpctl.summarize(fast).final_base_error > 0.1
    assert np.abs(slow.log.wheel_slip).max() < 0.1 * np.abs(fast.log.wheel_slip).max()
    assert slow.log.ground_load.sum(axis=1) == pytest.approx(G * robot.mass, rel=5e-2)


@pytest.mark.parametrize("effort", [0.0, -300.0])
def test_a_lift_falls_on_its_stop_on_tyres(tmp_path: Path, effort: float) -> None:
    """0.02 m under gravity and what its motor adds: m g h + F h is lost, and the tyres bear it.

    Pressed on, it rests, and a motor that presses does no work.
    """
    limit = urdf.limit(0.0, 0.5, 400.0, 2.0)
    parts = [
        ball(0.5),
        ball(-0.5, name="other"),
        urdf.link("carriage", urdf.inertial(6.0, (0.1, 0.1, 0.1))),
        urdf.joint("lift", "prismatic", ("base", "carriage"), "0 0 0.3", "0 0 1", limit),
    ]
    robot = load(write(tmp_path, platform(SET_A | {"d": 0.0}, extra="\n".join(parts))))
    motion = motion_of(robot, robot.configuration(joints={"lift": 0.02}))
    whole, tau, work, lost = energy(motion), still(robot), 0.0, 0.0
    tau[robot.actuators.index("lift")] = effort
    for _ in range(60):
        done = motion.advance(tau, 0.002)
        work, lost = work + done.work, lost + done.lost
    assert robot.joint_position(motion.q, "lift") == 0.0
    assert motion.nu[-1] == 0.0
    late = 0.002 * math.sqrt(2.0 * (G - effort / 6.0) * 0.02)  # m: a step at the impact's speed
    assert work == pytest.approx(-0.02 * effort, abs=late * abs(effort) + 1e-9)
    assert lost == pytest.approx(work + 6.0 * G * 0.02, rel=1e-6)
    assert energy(motion) == pytest.approx(whole + work - lost, abs=1e-9)
    assert motion.ground().load.sum() == pytest.approx(38.0 * G, rel=1e-6)
