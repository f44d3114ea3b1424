"""Steered, dragged, omni and fixed wheels: textbook kinematics and contacts that stand still."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, remainder, sin, tan
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.drive.steering import follower_positions
from rpctl.errors import SingularBasisError
from tests import random_vehicles
from tests.robots import SET_A, four_wheels, write
from tests.vehicles import vehicle

R = 0.1  # m, radius of the vehicles' wheels


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind), f"{kind}.urdf"))


def motion(
    robot: Robot, joints: dict[str, float], **rates: float
) -> tuple[Array, dict[str, float]]:
    """Return the base's twist (3,) and the joints' rates by name, for quasi-velocities by name."""
    nu = np.array([rates.get(name, 0.0) for name in robot.quasi_velocities])
    v = ReducedDynamics(robot).basis(robot.configuration(joints=joints)) @ nu
    names = robot.model.names[2:]
    return v[:3], {name: float(v[robot.velocity_index(name)]) for name in names}


def contact_velocities(robot: Robot, q: Array, v: Array) -> Array:
    """Return the velocity (n_wheels, 3) of each wheel's lowest material point, world axes.

    The wheel's centre and radius are its cylinder's, its Jacobian is that of its Pinocchio frame.
    """
    model, data = robot.model, robot.model.createData()
    found = []
    for wheel in robot.drive.wheels:
        shape = robot.description.link[robot.description.joint[wheel.joint].child].collisions[0]
        frame = model.getFrameId(wheel.joint)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)  # (6, nv)
        arm = data.oMi[model.frames[frame].parentJoint].rotation @ shape.origin[:3, 3]
        linear, angular = J[:3] @ v, J[3:] @ v
        found.append(linear + np.cross(angular, arm - [0.0, 0.0, shape.size[0]]))
    return np.array(found)


@pytest.mark.parametrize("kind", ["casters", "car-like", "tricycle", "bicycle", "steered"])
def test_no_wheel_slips(tmp_path: Path, kind: str, rng: np.random.Generator) -> None:
    """Every wheel's contact stands still in the whole tree, along its heading and across it."""
    tried = 0
    for seed in range(20):
        text, built = random_vehicles.vehicle(kind, seed)
        if built.tilt:  # a steering axis that leans moves its wheel up and down
            continue
        robot = rpctl.load(write(tmp_path, text))
        wheels = robot.drive.wheels
        lorry = sum(wheel.swivel is None for wheel in wheels) > 2 and kind == "car-like"
        if lorry or any(wheel.slides for wheel in wheels):  # which do slip sideways
            continue
        dynamics = ReducedDynamics(robot)
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        v = dynamics.basis(q) @ nu
        assert np.abs(contact_velocities(robot, q, v)).max() < 1e-11 * np.abs(v).max(), seed
        tried += 1
        if tried > 3:
            break
    assert tried > 2


@pytest.mark.parametrize("kind", ["car-like", "steered"])
def test_followers_keep_to_the_centre(tmp_path: Path, kind: str, rng: np.random.Generator) -> None:
    """A follower's rate is what its position changes by as the others steer."""
    step, tried = 1e-6, 0
    for seed in range(12):
        robot = rpctl.load(write(tmp_path, random_vehicles.vehicle(kind, seed)[0]))
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        v = ReducedDynamics(robot).basis(q) @ nu
        now = {s.joint: robot.joint_position(q, s.joint) for s in robot.drive.steered}
        ahead, behind = (
            follower_positions(
                robot.drive, {n: a + s * v[robot.velocity_index(n)] for n, a in now.items()}
            )
            for s in (step, -step)
        )
        for swivel in robot.drive.followers:
            turned = remainder(ahead[swivel.joint] - behind[swivel.joint], pi)
            rate = v[robot.velocity_index(swivel.joint)]
            assert turned / (2 * step) == pytest.approx(rate, rel=1e-5, abs=1e-5)
            tried += 1
        if tried > 8:
            break
    assert tried > 8


def test_ackermann(tmp_path: Path) -> None:
    """cot δ_R − cot δ_L = w/L and ω = v tan δ/L, cot δ the mean of the two; w between pivots."""
    robot, L, w, aside = load(tmp_path, "car-like"), 0.7, 0.5, 0.05
    for left in (0.5, -0.3, 0.02):
        q = robot.configuration(joints={"steer_left": left})
        right = -robot.joint_position(q, "steer_right")  # its axis points down
        assert 1.0 / tan(right) - 1.0 / tan(left) == pytest.approx(w / L)
        mean = 0.5 * (1.0 / tan(left) + 1.0 / tan(right))
        (vx, vy, omega), rates = motion(robot, {"steer_left": left}, v=0.6)
        assert (vx, vy) == pytest.approx((0.6, 0.0))
        assert omega == pytest.approx(0.6 / (mean * L))
        # Rear wheels are 0.3 m from P; front ones outside of their pivots.
        assert rates["rear_left"] * R == pytest.approx(0.6 - 0.3 * omega)
        assert -rates["rear_right"] * R == pytest.approx(0.6 + 0.3 * omega)
        assert rates["front_left"] * R == pytest.approx(omega * (L / sin(left) - aside))
        assert -rates["front_right"] * R == pytest.approx(omega * (L / sin(right) + aside))


def test_ackermann_linkage_keeps_its_condition(tmp_path: Path) -> None:
    """The right wheel's rate is d/dt arccot(cot δ_L + w/L)."""
    robot, left = load(tmp_path, "car-like"), 0.5
    right = atan2(1.0, 1.0 / tan(left) + 0.5 / 0.7)
    _, rates = motion(robot, {"steer_left": left}, steer_left=0.8)
    assert -rates["steer_right"] == pytest.approx(0.8 * (sin(right) / sin(left)) ** 2)


def test_tricycle(tmp_path: Path) -> None:
    """ω (L cos δ + k) = v sin δ − k δ̇, for a contact k ahead of the axis, and a left of it."""
    robot, L, k, a = load(tmp_path, "tricycle"), 0.7, 0.03, 0.01
    for delta, turning in ((0.6, 0.0), (-0.4, 0.9)):
        (vx, vy, omega), rates = motion(robot, {"steer": delta}, v=0.5, steer=turning)
        assert omega * (L * cos(delta) + k) == pytest.approx(0.5 * sin(delta) - k * turning)
        assert (vx, vy) == pytest.approx((0.5, 0.1 * omega))  # P is 0.1 m behind the root link
        front = 0.5 * cos(delta) + omega * L * sin(delta) - a * (omega + turning)
        assert rates["front"] * R == pytest.approx(front)


def test_bicycle(tmp_path: Path) -> None:
    """ω = v tan δ/L, and the front wheel is faster by 1/cos δ; its axis points down."""
    robot, L = load(tmp_path, "bicycle"), 0.8
    (vx, vy, omega), rates = motion(robot, {"steer": -0.7}, v=0.5)
    assert (vx, vy, omega) == pytest.approx((0.5, 0.0, 0.5 * tan(0.7) / L))
    assert rates["rear"] * R == pytest.approx(0.5)
    assert rates["front"] * R == pytest.approx(0.5 / cos(0.7))


@pytest.mark.parametrize("twist", [(0.4, 0.1, 0.3), (-0.1, 0.5, -0.4), (0.02, -0.3, 1.0)])
def test_swerve(tmp_path: Path, twist: tuple[float, float, float]) -> None:
    """Each wheel heads along its place's velocity (vx − ω y, vy + ω x) and rolls at its size."""
    robot, (vx, vy, omega) = load(tmp_path, "steered"), twist
    places = {"fl": (0.4, 0.3), "fr": (0.4, -0.3), "rl": (-0.35, 0.3), "rr": (-0.35, -0.3)}
    signs = {"fl": 1.0, "fr": -1.0, "rl": 1.0, "rr": -1.0}
    V = {name: (vx - omega * y, vy + omega * x) for name, (x, y) in places.items()}
    joints = {f"{name}_steer": signs[name] * atan2(V[name][1], V[name][0]) for name in ("fl", "rl")}
    # The wheels stand 0.02 m to the left of their axes, and their axes point to the right.
    base, rates = motion(robot, joints, v=hypot(*V["fl"]) - 0.02 * omega)
    assert base == pytest.approx(twist)
    q = robot.configuration(joints=joints)
    for name, (x, y) in V.items():
        angle = signs[name] * robot.joint_position(q, f"{name}_steer")
        ahead = x * cos(angle) + y * sin(angle)
        assert abs(ahead) == pytest.approx(hypot(x, y))
        assert -rates[f"{name}_wheel"] * R == pytest.approx(ahead - 0.02 * omega)
        assert rates[f"{name}_steer"] == pytest.approx(0.0, abs=1e-12)


def test_casters_follow(tmp_path: Path) -> None:
    """c (ω + φ̇) = n·V: a trail c swings a caster by the speed of its pivot across its heading."""
    robot, v, omega = load(tmp_path, "casters"), 0.5, -0.8
    angles = {"caster_0": 0.4, "caster_1": -2.0, "caster_2": 1.3}
    trails = {
        "caster_0": (0.4, 0.2, 0.06),
        "caster_1": (0.4, -0.2, 0.05),
        "caster_2": (-0.3, 0, 0.07),
    }
    _, rates = motion(robot, {n: -a for n, a in angles.items()}, v=v, omega=omega)
    for name, (x, y, c) in trails.items():
        phi, V = angles[name], (v - omega * y, omega * x)
        across = -sin(phi) * V[0] + cos(phi) * V[1]
        assert c * (omega - rates[name]) == pytest.approx(across)  # its axis points down
        along = cos(phi) * V[0] + sin(phi) * V[1]
        if name != "caster_1":
            side = 0.004 * (omega - rates[name])
            assert rates[f"{name}_roller"] * 0.05 == pytest.approx(along - side)


def test_steering_across_is_singular(tmp_path: Path) -> None:
    """At 90° the front wheel of a bicycle lets it turn about P, whatever its speed."""
    robot = load(tmp_path, "bicycle")
    with pytest.raises(SingularBasisError, match=r"steer at 90°"):
        ReducedDynamics(robot).basis(robot.configuration(joints={"steer": pi / 2}))


def test_two_axles_on_one_line_are_singular(tmp_path: Path) -> None:
    robot = load(tmp_path, "steered")
    q = robot.configuration(joints={"fl_steer": pi / 2, "rl_steer": pi / 2})
    with pytest.raises(SingularBasisError, match=r"fl_steer at 90°, rl_steer at 90°"):
        ReducedDynamics(robot).basis(q)
    apart = robot.configuration(joints={"fl_steer": pi / 2, "rl_steer": pi / 2 - 0.05})
    assert np.isfinite(ReducedDynamics(robot).basis(apart)).all()


LX, LY = 0.45, SET_A["b"]  # half wheelbase and half track, m


def wheel_rates(robot: Robot, nu: Array) -> Array:
    dynamics, q = ReducedDynamics(robot), robot.configuration()
    rates = dynamics.actuation(q).T @ nu
    return rates[:4] * [1.0, -1.0, 1.0, 1.0]  # one wheel's axis points the other way


def test_mecanum_wheels_turn_as_a_textbook_says(tmp_path: Path) -> None:
    """φ̇ r = vx ∓ vy ∓ (lx + ly) ω, about the middle of the wheels."""
    robot = four_wheels(tmp_path, "mecanum")
    assert robot.quasi_velocities == ("vx", "vy", "omega", "arm_joint")
    vx, vy, omega = 0.4, -0.3, 0.7
    middle = vy - omega * LX  # the root link is ahead of the middle
    expected = [
        vx - middle - (LX + LY) * omega,
        vx + middle + (LX + LY) * omega,
        vx + middle - (LX + LY) * omega,
        vx - middle + (LX + LY) * omega,
    ]
    found = wheel_rates(robot, np.array([vx, vy, omega, 0.0]))
    np.testing.assert_allclose(found * SET_A["r"], expected, atol=1e-12)


def test_skid_steer_wheels_turn_with_their_side(tmp_path: Path) -> None:
    robot = four_wheels(tmp_path, "skid-steer")
    assert robot.drive.point == pytest.approx((-LX, 0.0))
    v, omega = 0.4, 0.7
    left, right = v - LY * omega, v + LY * omega
    found = wheel_rates(robot, np.array([v, omega, 0.0]))
    np.testing.assert_allclose(found * SET_A["r"], [left, right, left, right], atol=1e-12)
    # Its centre does not slide sideways, the root link ahead of it swings.
    S = ReducedDynamics(robot).basis(robot.configuration())
    np.testing.assert_allclose((S @ [v, omega, 0.0])[:3], [v, omega * LX, omega], atol=1e-12)
