"""Ground reactions: against the full tree, Newton and Euler, and hand-made statics."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import (
    Contacts,
    GroundReaction,
    find_contacts,
    ground_reaction,
    stance_at,
)
from rpctl.dynamics.stance import even_loads, loads, make_stance, margins, width
from rpctl.robot.vary import without_losses
from tests.joint_losses import joint_losses
from tests.robots import SET_A, ball, four_wheels, platform, write
from tests.view.samples import write_cart

ROUNDING = 1e-12  # relative to the largest entry
BALANCE = 1e-9  # N·m: moments about the zero-moment point
G = 9.81
L = 0.6  # m: from the axle to the ball
M_C, D, HEIGHT, M_W, R, B, I_S = 30.0, 0.3, 0.2, 1.0, 0.15, 0.75, 0.005  # of the platform
MASS = M_C + 2 * M_W


def contacts_of(dynamics: ReducedDynamics, friction: float = 0.7) -> Contacts:
    contacts = find_contacts(dynamics, friction)
    assert contacts is not None
    return contacts


@pytest.fixture
def trolley(tmp_path: Path) -> Robot:
    """The platform of known parameters, with a ball ahead."""
    return rpctl.load(write(tmp_path, platform(SET_A, extra=ball(L))))


def reaction(
    robot: Robot,
    nu: tuple[float, ...],
    nu_dot: tuple[float, ...],
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    friction: float = 0.7,
) -> GroundReaction:
    """Return what the ground does to a robot that moves so."""
    dynamics = ReducedDynamics(robot)
    q, speed = robot.configuration(*pose), np.array(nu)
    tau = dynamics.efforts(q, dynamics.inverse(q, speed, np.array(nu_dot)))
    return ground_reaction(dynamics, contacts_of(dynamics, friction), q, speed, tau)


def states(
    robot: Robot, rng: np.random.Generator, count: int = 10
) -> list[tuple[Array, Array, Array]]:
    dynamics = ReducedDynamics(robot)
    found = []
    for _ in range(count):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = dynamics.efforts(q, dynamics.bias(q, nu)) + rng.normal(size=len(robot.actuators))
        found.append((q, nu, tau))
    return found


def directions(robot: Robot, q: Array) -> Array:
    """Return the robot's forward and left (2, 3), world."""
    theta = robot.base_pose(q)[2]
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([[cos, sin, 0.0], [-sin, cos, 0.0]])


def contact_points(robot: Robot, contacts: Contacts, q: Array) -> Array:
    """Return the contacts (n, 3), world."""
    turn = np.array([[q[2], -q[3]], [q[3], q[2]]])
    points = q[:2] + contacts.points @ turn.T
    return np.column_stack([points, np.full(len(points), robot.drive.ground)])


def check_joint_forces(robot: Robot, rng: np.random.Generator) -> None:
    """M v̇ + h = B τ + Σ Jᵀ F with forces at the wheels' contacts, Jacobians from Pinocchio."""
    dynamics, model, data = ReducedDynamics(robot), robot.model, robot.model.createData()
    contacts = contacts_of(dynamics)
    for q, nu, tau in states(robot, rng):
        ground = ground_reaction(dynamics, contacts, q, nu, tau)
        v, v_dot = dynamics.basis(q) @ nu, dynamics.basis(q) @ dynamics.forward(q, nu, tau)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        needed = M @ v_dot + pin.nonLinearEffects(model, data, q, v)
        given = joint_losses(robot, v)
        for name, effort in zip(robot.actuators, tau, strict=True):
            given[robot.velocity_index(name)] += effort
        forward, left = directions(robot, q)
        forces = [force * forward for force in ground.longitudinal]
        for axle, force in zip(contacts.axles, ground.lateral, strict=True):
            forces[axle[-1]] = forces[axle[-1]] + force * left
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q)
        points = contact_points(robot, contacts, q)
        for wheel, force, point in zip(robot.drive.wheels, forces, points, strict=False):
            joint = model.getJointId(wheel.joint)
            J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
            lever = point - data.oMi[joint].translation
            given += J.T @ np.concatenate([force, np.cross(lever, force)])
        np.testing.assert_allclose(given, needed, atol=ROUNDING * np.abs(needed).max())


def check_momentum(robot: Robot, rng: np.random.Generator) -> None:
    """The contacts' wrench is the rate of momentum less gravity's; level moments about p vanish."""
    dynamics, model, data = ReducedDynamics(robot), robot.model, robot.model.createData()
    contacts = contacts_of(dynamics)
    for q, nu, tau in states(robot, rng):
        ground = ground_reaction(dynamics, contacts, q, nu, tau)
        v, v_dot = dynamics.basis(q) @ nu, dynamics.basis(q) @ dynamics.forward(q, nu, tau)
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, v_dot)
        force = data.dhg.linear - robot.mass * model.gravity.linear
        np.testing.assert_allclose(ground.force, force, atol=ROUNDING * np.abs(force).max())
        zmp = np.array([*ground.zmp, robot.drive.ground])
        moment = data.dhg.angular + np.cross(data.com[0] - zmp, force)
        np.testing.assert_allclose(moment[:2], 0.0, atol=BALANCE)
        # The contacts give this very wrench: vertical loads, forward and lateral forces.
        points = contact_points(robot, contacts, q)
        pushed = np.outer(ground.load, [0.0, 0.0, 1.0])
        wheels = len(ground.longitudinal)
        pushed[:wheels] += np.outer(ground.longitudinal, directions(robot, q)[0])
        for axle, lateral in zip(contacts.axles, ground.lateral, strict=True):
            pushed[axle[0]] += lateral * directions(robot, q)[1]
        np.testing.assert_allclose(pushed.sum(axis=0), force, atol=1e-10)
        turned = np.cross(points - zmp, pushed).sum(axis=0)
        np.testing.assert_allclose(turned, moment, atol=BALANCE)


def test_at_rest_the_levers_share_the_weight(trolley: Robot) -> None:
    ground = reaction(trolley, (0.0, 0.0), (0.0, 0.0), (2.0, -1.0, 0.6))
    front = M_C * G * D / L
    rear = 0.5 * (M_C * G - front) + M_W * G
    np.testing.assert_allclose(ground.load, [rear, rear, front], rtol=ROUNDING)
    np.testing.assert_allclose(ground.force, [0.0, 0.0, MASS * G], atol=1e-10)
    ahead = M_C * D / MASS
    zmp = [2.0 + ahead * math.cos(0.6), -1.0 + ahead * math.sin(0.6)]
    np.testing.assert_allclose(ground.zmp, zmp, rtol=ROUNDING)
    side = B * (L - ahead) / math.hypot(B, L)  # distance to the slanted edges
    assert ground.tip_margin == pytest.approx(min(ahead, side), rel=ROUNDING)
    np.testing.assert_allclose(ground.slip_ratio, 0.0, atol=1e-12)


def test_speeding_up_shifts_the_load_back(trolley: Robot) -> None:
    """Σ m a h / L leaves the ball, and so does what spins the wheels up."""
    a = 0.8
    ground = reaction(trolley, (1.2, 0.0), (a, 0.0), (0.0, 0.0, 2.0))
    np.testing.assert_allclose(ground.longitudinal, 0.5 * MASS * a, rtol=ROUNDING)
    np.testing.assert_allclose(ground.lateral, 0.0, atol=1e-11)
    shifted = (M_C * HEIGHT + 2 * M_W * R) * a + 2 * I_S * a / R
    front = (M_C * G * D - shifted) / L
    np.testing.assert_allclose(ground.load[2], front, rtol=ROUNDING)
    rear = 0.5 * (MASS * G - front)
    np.testing.assert_allclose(ground.load[:2], rear, rtol=ROUNDING)
    np.testing.assert_allclose(ground.slip_ratio, 0.5 * MASS * a / (0.7 * rear), rtol=ROUNDING)


def test_a_steady_circle_pulls_the_axle_inward(trolley: Robot) -> None:
    """m v²/R on the axle, ω² d m back along the robot, and h a/g to the outside."""
    v, omega = 1.5, 0.8
    ground = reaction(trolley, (v, omega), (0.0, 0.0))
    assert ground.lateral == pytest.approx([MASS * v * omega], rel=ROUNDING)  # R = v/ω, to the left
    np.testing.assert_allclose(ground.longitudinal.sum(), -M_C * D * omega**2, rtol=ROUNDING)
    yaw = M_C * D * v * omega  # the centre of mass is ahead: the circle needs a turning moment
    right_less_left = ground.longitudinal[1] - ground.longitudinal[0]
    np.testing.assert_allclose(B * right_less_left, yaw, rtol=1e-11)
    gyroscopic = 2 * I_S * v / R * omega
    outward = ((M_C * HEIGHT + 2 * M_W * R) * v * omega + gyroscopic) / (MASS * G)
    assert ground.zmp[1] == pytest.approx(-outward, rel=ROUNDING)
    left, right, _ = ground.load
    assert B * (right - left) == pytest.approx(outward * MASS * G, rel=1e-11)
    grip = [
        math.hypot(along / load, ground.lateral[0] / (left + right)) / 0.7
        for along, load in zip(ground.longitudinal, (left, right), strict=True)
    ]
    np.testing.assert_allclose(ground.slip_ratio, grip, rtol=ROUNDING)


def test_it_tips_where_the_ball_lifts(trolley: Robot) -> None:
    """The margin changes its sign with the ball's load, at the acceleration found by hand."""
    critical = M_C * G * D / (M_C * HEIGHT + 2 * M_W * R + 2 * I_S / R)
    for factor, sign in ((1.0 - 1e-9, 1.0), (1.0 + 1e-9, -1.0)):
        ground = reaction(trolley, (0.0, 0.0), (factor * critical, 0.0))
        assert ground.tip_margin is not None
        assert math.copysign(1.0, ground.tip_margin) == sign
        assert math.copysign(1.0, ground.load[2]) == sign
        assert abs(ground.tip_margin) < 1e-8
    beyond = reaction(trolley, (0.0, 0.0), (1.5 * critical, 0.0))
    assert beyond.tip_margin == pytest.approx(-0.5 * M_C * D / MASS, rel=1e-11)


def test_a_turn_tips_over_the_outer_wheel(trolley: Robot) -> None:
    """A left turn unloads the left wheel; mirrored, the right one."""
    left, right = (reaction(trolley, (6.0, omega), (0.0, 0.0)) for omega in (3.0, -3.0))
    assert left.load[0] < 0.0 < left.load[1]
    np.testing.assert_allclose(left.load, right.load[[1, 0, 2]], rtol=1e-11)
    for ground in (left, right):
        assert ground.tip_margin is not None
        assert ground.tip_margin < 0.0
        assert ground.slip_ratio.max() > 100.0  # the inner wheel is in the air


def test_a_falling_robot_stands_on_nothing(tmp_path: Path) -> None:
    """Where the ground would have to pull, the margin is negative and all figures are finite."""
    extra = (
        ball(0.6)
        + """
  <link name="weight"><inertial><mass value="10"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="weight"/><origin xyz="0.3 0 1"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9999" velocity="9"/>
  </joint>"""
    )
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=extra)))
    for pull, lifted in ((60.0, True), (4.2 * G, True), (20.0, False)):  # the second leaves no load
        ground = reaction(robot, (0.0, 0.0, 0.0), (0.0, 0.0, -pull))
        assert ground.force[2] == pytest.approx(42.0 * G - 10.0 * pull, rel=ROUNDING, abs=1e-10)
        assert ground.tip_margin is not None
        assert (ground.tip_margin < 0.0) is lifted
        assert np.isfinite(ground.slip_ratio).all()
        assert np.abs(ground.zmp).max() < 1e4


def test_the_forces_move_the_whole_tree(robot: Robot, rng: np.random.Generator) -> None:
    check_joint_forces(robot, rng)


def test_newton_and_euler_of_the_whole_robot(robot: Robot, rng: np.random.Generator) -> None:
    """Of a robot without losses, which at random rates would throw TIAGo's torso off the ground."""
    check_momentum(without_losses(robot), rng)


def test_an_axle_has_one_lateral_force(robot: Robot) -> None:
    contacts = contacts_of(ReducedDynamics(robot))
    assert contacts.axles == ((0, 1),)
    assert contacts.balanced
    assert contacts.determinate is (len(contacts.names) == 3)
    assert len(contacts.notes) == (0 if contacts.determinate else 1)


@pytest.mark.parametrize(
    ("kind", "axles"), [("skid-steer", ((0, 1, 2, 3),)), ("mecanum", ((0,), (1,), (2,), (3,)))]
)
def test_wheels_that_share_a_lateral_force(
    tmp_path: Path, kind: str, axles: tuple[tuple[int, ...], ...]
) -> None:
    contacts = contacts_of(ReducedDynamics(four_wheels(tmp_path, kind)))
    assert contacts.axles == axles


def test_rollers_carry_the_robot(tmp_path: Path, rng: np.random.Generator) -> None:
    """Each force lies along its roller, so its part to the left is the wheel's own."""
    robot = four_wheels(tmp_path, "mecanum")
    check_momentum(robot, rng)
    check_joint_forces(robot, rng)


def test_one_support_that_swivels_among_others_moves_the_polygon(tmp_path: Path) -> None:
    """A ball on the base at x = .6 m, one .1 m behind an upright joint at x = -.3 m."""
    fork = """
  <link name="fork"><inertial><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="fork_joint" type="continuous">
    <parent link="base"/><child link="fork"/><origin xyz="-0.3 0 0.05"/><axis xyz="0 0 1"/>
  </joint>"""
    trailing = ball(-0.1, z=0.0, name="trailing", parent="fork")
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ball(L) + fork + trailing)))
    dynamics = ReducedDynamics(robot)
    contacts = contacts_of(dynamics)
    for turn, place in ((0.0, [-0.4, 0.0]), (0.5 * math.pi, [-0.3, -0.1])):
        stance = stance_at(dynamics, contacts, robot.configuration(joints={"fork_joint": turn}))
        expected = [[0.0, B], [0.0, -B], [L, 0.0], place]
        np.testing.assert_allclose(stance.statics[1:].T, expected, atol=1e-12)


def test_wheels_alone_hold_no_balance(tmp_path: Path) -> None:
    robot = rpctl.load(write_cart(tmp_path), root="planar")
    dynamics = ReducedDynamics(robot)
    contacts = contacts_of(dynamics)
    assert not contacts.balanced
    assert not contacts.determinate
    (note,) = contacts.notes
    assert "left_wheel_joint, right_wheel_joint" in note
    assert "not defined" in note
    ground = ground_reaction(dynamics, contacts, robot.configuration(), np.ones(2), np.ones(2))
    assert ground.tip_margin is None
    assert ground.load.size == ground.slip_ratio.size == 0
    assert ground.lateral.shape == (1,)


def test_fixed_bases_and_wrong_frictions() -> None:
    assert find_contacts(ReducedDynamics(rpctl.load("panda"))) is None
    dynamics = ReducedDynamics(rpctl.load("paper"))
    for wrong in (0.0, -0.1, math.nan, math.inf):
        with pytest.raises(RpctlError, match=r"friction is .*; give a positive number"):
            find_contacts(dynamics, wrong)


SQUARE = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [0.2, 0.1], [-1.0, 1.0], [0.0, 1.0]])


def margin(points: Array, at: Array) -> float:
    stance = make_stance(points)
    return float((stance.inward @ at + stance.offset).min())


def test_the_margin_is_the_distance_to_the_nearest_edge(rng: np.random.Generator) -> None:
    for order in (rng.permutation(6) for _ in range(20)):
        assert margin(SQUARE[order], np.array([0.0, 0.0])) == pytest.approx(1.0)
        assert margin(SQUARE[order], np.array([0.7, -0.2])) == pytest.approx(0.3)
        assert margin(SQUARE[order], np.array([0.3, -1.0])) == pytest.approx(0.0)
        assert margin(SQUARE[order], np.array([0.3, -1.4])) == pytest.approx(-0.4)
    assert len(make_stance(SQUARE).offset) == 4


def test_three_contacts_share_by_their_levers() -> None:
    points = np.array([[0.0, 0.5], [0.0, -0.5], [0.8, 0.1]])
    at, total = np.array([0.2, -0.1]), 100.0
    moments = total * np.array([1.0, *at])
    front = total * 0.2 / 0.8
    left = 0.5 * (total - front) + (total * -0.1 - front * 0.1)
    load = loads(make_stance(points), moments, 1.0)
    np.testing.assert_allclose(load, [left, total - front - left, front], rtol=1e-13)


def test_many_contacts_only_push_and_balance(rng: np.random.Generator) -> None:
    """The split is that of equal springs: max(0, a + b x + c y), the least nonnegative one."""
    for _ in range(300):
        points = rng.normal(size=(rng.integers(4, 9), 2))
        stance = make_stance(points)
        at = rng.dirichlet(np.full(len(points), 0.3)) @ points
        moments = 50.0 * np.array([1.0, *at])
        load = loads(stance, moments, float((stance.inward @ at + stance.offset).min()))
        assert load.min() >= -1e-9
        np.testing.assert_allclose(stance.statics @ load, moments, atol=1e-9)
        pressed = load > 0.0
        plane = np.linalg.lstsq(stance.statics[:, pressed].T, load[pressed], rcond=None)[0]
        np.testing.assert_allclose(stance.statics[:, pressed].T @ plane, load[pressed], atol=1e-9)
        assert (stance.statics[:, ~pressed].T @ plane).max(initial=0.0) < 1e-8


def test_stances_that_move_have_the_margins_and_loads_of_each(rng: np.random.Generator) -> None:
    """Also of contacts on an edge, of two in one place, and outside of the polygon."""
    hexagon = np.array([[np.cos(a), np.sin(a)] for a in np.arange(6.0) * np.pi / 3.0])
    askew = rng.normal(size=(200, 6, 2))
    askew[50:, 1] = askew[50:, 0]
    points = np.concatenate([SQUARE[None], hexagon[None], askew])
    at = rng.normal(size=(len(points), 2))
    moments = np.column_stack([np.ones(len(points)), at]) * rng.uniform(1.0, 90.0, (len(at), 1))
    np.testing.assert_allclose(margins(points, at), list(map(margin, points, at)), atol=1e-12)
    expected = [make_stance(p).split @ m for p, m in zip(points, moments, strict=True)]
    np.testing.assert_allclose(even_loads(points, moments), expected, rtol=1e-9, atol=1e-9)


def test_outside_the_polygon_some_contact_pulls() -> None:
    stance = make_stance(SQUARE)
    load = loads(stance, np.array([1.0, 1.5, 0.0]), -0.5)
    assert load.min() < 0.0
    np.testing.assert_allclose(stance.statics @ load, [1.0, 1.5, 0.0], atol=1e-12)


def test_where_no_split_only_pushes_that_of_the_plane_stays() -> None:
    """Rounding may call a margin positive that is not."""
    stance, moments = make_stance(SQUARE), np.array([1.0, 1.5, 0.0])
    np.testing.assert_array_equal(loads(stance, moments, 1e-17), stance.split @ moments)


def test_contacts_on_a_line_have_no_width() -> None:
    assert width(SQUARE[:2]) == 0.0
    assert width(np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]])) == pytest.approx(0.0, abs=1e-15)
    assert width(SQUARE) > 1.0
