"""The robot on a plane in MuJoCo: it stands, rolls and is shaped as its file says."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.contact import model as contact_model
from rpctl.equivalence.contact import plan as contact_plan
from rpctl.equivalence.contact.model import ContactModel, tyre
from tests.robots import SET_A, ball, cargo, four_wheels, platform, write

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

G = 9.81
SETTLED = 1e-3  # of a load: what sinking by microns and settling for .3 s leave


# --- MuJoCo's side ------------------------------------------------------------------------------


def push(model: ContactModel, **efforts: float) -> None:
    """Hold efforts of some joints for one step."""
    tau = [efforts.get(name, 0.0) for name in model.robot.actuators]
    model.advance(np.array(tau), contact_model.STEP_S)


def settled(robot: Robot, steps: int = 600) -> contact_model.Contact:
    model = ContactModel(robot)
    model.start(contact_plan.start(robot))
    for _ in range(steps):
        push(model)
    assert np.abs(model.planar).max() < 1e-6  # level ground: it stays where it is
    return model.ground


def test_loads_at_rest_are_those_of_the_lever_rule(tmp_path: Path) -> None:
    """Base 30 kg at x = .3 m, cargo 8 kg at (.4, .3) m, wheels 1 kg each at x = 0, y = ±.75 m.

    The ball at x = .6 m bears (30·.3 + 8·.4)/.6 = 20.333 kg; the wheels 19.667 kg, of which the
    left one has 8·.3/1.5 = 1.6 kg more than half.
    """
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.6) + cargo(8, 0.4, 0.3, 0.2))))
    ground = settled(robot)
    assert ContactModel(robot).contacts == ("left_joint", "right_joint", "ball")
    expected = G * np.array([19.66666667 / 2 + 1.6, 19.66666667 / 2 - 1.6, 20.33333333])
    np.testing.assert_allclose(ground.load, expected, rtol=SETTLED)
    np.testing.assert_allclose(ground.force, [0.0, 0.0, 40.0 * G], atol=SETTLED * 40.0 * G)
    np.testing.assert_allclose(ground.zmp, np.array([12.2, 2.4]) / 40.0, atol=1e-4)


def test_the_turn_of_a_base_that_leans_is_where_its_forward_axis_points(paper: Robot) -> None:
    """Turned by .5 rad about z, then by .3 about y, then by .2 about x."""
    model = ContactModel(paper)
    model.start(paper.configuration(1.0, 2.0))
    half = [(math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (0.2, 0.3, 0.5)]
    (cx, sx), (cy, sy), (cz, sz) = half
    model.data.qpos[3:7] = (  # the product of the three quaternions
        cz * cy * cx + sz * sy * sx,
        cz * cy * sx - sz * sy * cx,
        cz * sy * cx + sz * cy * sx,
        sz * cy * cx - cz * sy * sx,
    )
    np.testing.assert_allclose(model.planar, [1.0, 2.0, 0.5], atol=1e-12)


@pytest.mark.parametrize("kind", ["mecanum", "omni"])
def test_rollers_are_held_along_their_axles(tmp_path: Path, kind: str) -> None:
    """Of omni wheels that is the way they roll, each its own."""
    robot = four_wheels(tmp_path, kind) if kind == "mecanum" else rpctl.load(kind)
    model, turn = ContactModel(robot), 0.7
    model.start(robot.configuration(theta=turn))
    cos, sin = math.cos(turn), math.sin(turn)
    for wheel in robot.drive.wheels:
        x, y = wheel.direction
        expected = [cos * x - sin * y, sin * x + cos * y, 0.0]
        np.testing.assert_allclose(model.held(wheel), expected, atol=1e-9)


def test_a_mecanum_base_slides_across_its_rollers_only(tmp_path: Path) -> None:
    """All wheels forward: it drives straight, each roller's force along its axle."""
    robot = four_wheels(tmp_path, "mecanum")
    model = ContactModel(robot)
    model.start(robot.configuration())
    for _ in range(400):
        push(model)
    push(model)
    for contact in model.data.contact:
        wheel = model.rolling[int(contact.geom2)]
        along = model.held(wheel)
        np.testing.assert_allclose(contact.frame[3:6], along, atol=1e-12)
        np.testing.assert_allclose(contact.frame[6:], np.cross([0.0, 0.0, 1.0], along), atol=1e-12)
        assert contact.friction[1] < 1e-4 < contact.friction[0]


def test_a_mimic_joint_follows_in_mujoco(tmp_path: Path) -> None:
    arm = """<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="0.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
      <joint name="{name}_joint" type="revolute"><parent link="base"/><child link="{name}"/>
      <origin xyz="0.2 0 0.4"/><axis xyz="0 0 1"/>{mimic}
      <limit lower="-2" upper="2" effort="30" velocity="2"/></joint>"""
    follower_positions = '<mimic joint="first_joint" multiplier="-0.5" offset="0.2"/>'
    extra = arm.format(name="first", mimic="") + arm.format(name="second", mimic=follower_positions)
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.6) + extra)))
    model = ContactModel(robot)
    model.start(robot.configuration(joints={"first_joint": 0.4}))
    for _ in range(400):
        push(model, first_joint=0.2)
    first, second = model.joint("first_joint")[0], model.joint("second_joint")[0]
    assert first > 0.45
    assert second == pytest.approx(-0.5 * first + 0.2, abs=1e-3)


def test_a_tie_rod_is_a_spring_between_two_knuckles() -> None:
    """Of the car, 0.38 m apart and 0.62 m ahead of P: cot δ_R = cot δ_L + 0.38/0.62.

    It is 300 rad/s stiff and critically damped, and works on φ = δ_R - f(δ_L) alone: the right
    knuckle feels -(k φ + d φ̇), the left one f' = (sin δ_R / sin δ_L)² times the opposite.
    """
    robot = rpctl.load("car")
    leader, follower = "steering_left_joint", "steering_right_joint"
    left = 0.3
    right = math.atan(1.0 / (1.0 / math.tan(left) + 0.38 / 0.62))
    slope = (math.sin(right) / math.sin(left)) ** 2
    model = ContactModel(robot)
    model.start(robot.configuration(joints={leader: left}))
    data, dofs = model.data, model.dofs
    assert model.joint(follower)[0] == pytest.approx(right)
    data.qpos[dofs[follower] + 1] += 0.01
    data.qvel[dofs[leader]], data.qvel[dofs[follower]] = 0.2, 0.05
    model.pull_rods()
    pull = model.rods[follower] * 300.0 * (300.0 * 0.01 + 2.0 * (0.05 - slope * 0.2))
    expected = np.zeros(len(data.qfrc_applied))
    expected[dofs[leader]], expected[dofs[follower]] = slope * pull, -pull
    np.testing.assert_allclose(data.qfrc_applied, expected, atol=1e-5 * pull)


# --- shapes -------------------------------------------------------------------------------------


def test_a_tyre_is_the_widest_cylinder_at_its_own_place(tmp_path: Path) -> None:
    hub = """<collision><origin xyz="0 0.05 0" rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.16" length="0.06"/></geometry></collision></link>
      <joint name="left_joint\""""
    text = platform(SET_A, extra=ball(0.6)).replace('</link>\n  <joint name="left_joint"', hub)
    robot = rpctl.load(write(tmp_path, text))
    tread = tyre(robot, robot.drive.wheels[0])
    assert (tread.radius, tread.half_width, tread.note) == (0.16, 0.03, "")
    np.testing.assert_allclose(tread.pose[:3, 3], [0.0, 0.05, 0.0])
    np.testing.assert_allclose(np.abs(tread.pose[:3, 2]), [0.0, 1.0, 0.0], atol=1e-12)


def test_a_tyre_knows_nothing_of_the_drive_where_it_is_drawn(paper: Robot) -> None:
    drawn = tyre(paper, paper.drive.wheels[0])
    record = dataclasses.replace(paper.drive.wheels[0], radius=0.16, offset=0.05)
    assert tyre(paper, record).radius == drawn.radius == 0.15
    np.testing.assert_array_equal(tyre(paper, record).pose, drawn.pose)


def test_a_declared_radius_is_told(paper: Robot) -> None:
    wheel = dataclasses.replace(paper.drive.wheels[0], radius=0.2, source="drive file")
    tread = tyre(paper, wheel)
    assert (tread.radius, tread.note) == (0.2, "the radius of wheel_left_joint is the drive file's")


def test_a_wheel_that_is_not_drawn_is_told(paper: Robot) -> None:
    wheel = dataclasses.replace(paper.drive.wheels[0], radius=0.17, offset=0.03)
    raw = paper.description.raw.replace(b"collision>", b"nothing>").replace(b"visual>", b"nothing>")
    bare = dataclasses.replace(paper, description=dataclasses.replace(paper.description, raw=raw))
    tread = tyre(bare, wheel)
    assert tread.radius == 0.17
    np.testing.assert_allclose(tread.pose[:3, 3], 0.03 * np.array(wheel.axis))
    assert tread.note.startswith("wheel_left_joint draws no wheel")


def meshed(folder: Path, origin: str = "", attributes: str = "", unit: float = 1.0) -> Robot:
    """Return a platform whose wheels are rings of eight corners, .15 m about y, y = .01 to .05 m.

    The file of the ring counts in a unit, m.
    """
    angles = 0.25 * math.pi * np.arange(8)
    corners = [
        f"v {0.15 * math.cos(a) / unit:.6f} {y / unit} {0.15 * math.sin(a) / unit:.6f}"
        for y in (0.01, 0.05)
        for a in angles
    ]
    faces = [f"f {k} {k % 8 + 1} {k + 8}" for k in range(1, 9)]
    (folder / "wheel.obj").write_text("\n".join(corners + faces), encoding="utf-8")
    shape = platform(SET_A).partition("<collision>")[2].partition("</collision>")[0]
    mesh = f'{origin}<geometry><mesh filename="wheel.obj" {attributes}/></geometry>'
    text = platform(SET_A, extra=ball(0.6), right_sign=-1).replace(shape, mesh)
    return rpctl.load(write(folder, text))


def test_a_mesh_is_as_wide_as_its_bounds(tmp_path: Path) -> None:
    robot = meshed(tmp_path)
    for wheel, sign in zip(robot.drive.wheels, (1.0, -1.0), strict=True):
        tread = tyre(robot, wheel)
        assert tread.radius == pytest.approx(0.15)
        assert tread.half_width == pytest.approx(0.02)
        np.testing.assert_allclose(tread.pose[:3, 3], [0.0, 0.03, 0.0], atol=1e-9)
        np.testing.assert_allclose(tread.pose[:3, 2], [0.0, sign, 0.0], atol=1e-12)
        np.testing.assert_allclose(tread.pose[:3, :3] @ tread.pose[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_mesh_in_millimetres_that_is_turned_and_moved(tmp_path: Path) -> None:
    """Half a turn about z takes y = .03 m to -.03 m, and the origin lies .02 m along y."""
    origin = f'<origin xyz="0 0.02 0" rpy="0 0 {math.pi}"/>'
    robot = meshed(tmp_path, origin, 'scale="0.001 0.001 0.001"', unit=1e-3)
    tread = tyre(robot, robot.drive.wheels[0])
    assert (tread.radius, tread.half_width) == pytest.approx((0.15, 0.02))
    np.testing.assert_allclose(tread.pose[:3, 3], [0.0, -0.01, 0.0], atol=1e-9)
