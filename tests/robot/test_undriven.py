"""An effort limit of 0 says that nothing drives a joint."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.errors import ActuationError, DescriptionError
from rpctl.robot.vary import set_limits
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

# A mass of 2 kg at .5 m below a level hinge, .5 m high in the middle of the axle.
PENDULUM = """
<link name="bob"><inertial><origin xyz="0 0 -.5"/><mass value="2"/>
  <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/>
  <origin xyz="0 0 .5"/><axis xyz="0 1 0"/><limit effort="0" velocity="9"/></joint>
"""
IDLE = '<limit effort="0" velocity="9"/>'
WHEELS = ("left_joint", "right_joint")


def transmission(joint: str) -> str:
    return f'<transmission name="t_{joint}"><joint name="{joint}"/></transmission>'


def idle_wheels(text: str) -> str:
    """Return a platform whose wheels have the effort limit 0."""
    return text.replace("</joint>", f"{IDLE}</joint>", 2)


def cart(folder: Path, extra: str = "") -> Path:
    return write(folder, platform(SET_A, extra=PENDULUM + extra))


def findings(robot: rpctl.Robot, severity: str) -> list[str]:
    return [f.message for f in robot.findings if f.severity == severity]


def test_a_hinge_without_a_motor_is_a_state_and_no_actuator(tmp_path: Path) -> None:
    robot = rpctl.load(cart(tmp_path))
    assert robot.quasi_velocities == ("v", "omega", "hinge")
    assert robot.actuators == WHEELS
    line = robot.description.joint["hinge"].line
    (told,) = [f for f in robot.findings if "hinge" in f.message]
    assert (told.severity, told.line) == ("info", line)
    assert "no motor drives it, so it coasts" in told.message and "--lock hinge" in told.message


def test_it_coasts_as_a_pendulum_does(tmp_path: Path) -> None:
    """Released at rest at θ with the base held: θ̈ = −m g l sin θ/(I + m l²)."""
    robot = rpctl.load(cart(tmp_path))
    dynamics = rpctl.ReducedDynamics(robot)
    q, nu = robot.state((0.0, 0.0, 0.0), (0.0, 0.0), joints={"hinge": 0.3}, rates={"hinge": 0.0})
    M, h, B = dynamics.inertia(q), dynamics.bias(q, nu), dynamics.actuation(q)
    assert B.shape == (3, 2) and not B[2].any()
    assert h[2] == pytest.approx(2.0 * 9.81 * 0.5 * math.sin(0.3))
    assert M[2, 2] == pytest.approx(0.1 + 2.0 * 0.5**2)
    tau = np.array([0.4, -0.3])
    np.testing.assert_allclose(M @ dynamics.forward(q, nu, tau) + h, B @ tau, atol=1e-12)


def test_its_dynamics_are_verified_without_a_motor_there(tmp_path: Path) -> None:
    certificate = rpctl.verify(rpctl.load(cart(tmp_path)), samples=2)
    assert all(check.passed for check in certificate.checks if "B" in check.name.split())
    motion = ("forward dynamics", "reduced inertia M", "reduced bias h", "inverse dynamics")
    assert all(check.passed for check in certificate.checks if check.name.startswith(motion))


def test_no_law_tracks_it_before_it_is_held_or_driven(tmp_path: Path) -> None:
    path = cart(tmp_path)
    with pytest.raises(
        ActuationError,
        match=r"drives hinge of .*; freeze it with --lock hinge, "
        r"or",
    ):
        rpctl.track(rpctl.load(path), "circle", duration=0.1)
    robot = rpctl.load(path)
    held = rpctl.load(path, lock=["hinge"])
    assert held.quasi_velocities == ("v", "omega") and not findings(held, "info")
    assert set_limits(robot, effort={"hinge": 5.0}).actuators == (*WHEELS, "hinge")
    with pytest.raises(ActuationError):
        rpctl.Controller(robot, "line")
    assert len(rpctl.Controller(held, "line").step(0.0, *held.state()).efforts) == 2


def test_wheels_without_effort_drive_nothing(tmp_path: Path) -> None:
    path = write(tmp_path, idle_wheels(platform(SET_A)))
    robot = rpctl.load(path)
    assert not any(wheel.driven for wheel in robot.drive.wheels) and robot.actuators == ()
    (told,) = findings(robot, "warning")
    assert told.startswith("nothing drives the base") and "driven = true" in told
    q, nu = robot.state(twist=(1.0, 0.5))
    assert rpctl.ReducedDynamics(robot).forward(q, nu, np.zeros(0)).shape == (2,)
    with pytest.raises(ActuationError, match=r"drives v, omega .*driven = true .*left_joint"):
        rpctl.track(robot, "circle", duration=0.1)
    with pytest.raises(DescriptionError, match="nothing drives the base"):
        rpctl.load(path, strict=True)


@pytest.mark.parametrize(
    "evidence",
    [
        "".join(map(transmission, WHEELS)),
        '<gazebo><plugin name="d" filename="libgazebo_ros_diff_drive.so">'
        "<left_joint>left_joint</left_joint><right_joint>right_joint</right_joint>"
        "</plugin></gazebo>",
        "drive file",
    ],
)
def test_a_motor_that_the_file_names_outweighs_the_limit(tmp_path: Path, evidence: str) -> None:
    drive = None
    if evidence == "drive file":
        drive, evidence = tmp_path / "drive.toml", ""
        said = "".join(f'[[wheel]]\njoint = "{name}"\ndriven = true\n' for name in WHEELS)
        drive.write_text('type = "differential"\n' + said)
    path = write(tmp_path, idle_wheels(platform(SET_A, extra=evidence)))
    robot = rpctl.load(path, drive)
    assert robot.actuators == WHEELS and np.isinf(robot.effort_limits).all()
    told = findings(robot, "warning")
    assert len(told) == 2 and all("has a motor there" in text for text in told)


def test_an_arm_with_a_transmission_is_driven_whatever_its_limit(tmp_path: Path) -> None:
    robot = rpctl.load(cart(tmp_path, "".join(map(transmission, (*WHEELS, "hinge")))))
    assert robot.actuators == (*WHEELS, "hinge") and math.isinf(robot.effort_limits[2])


def test_the_certificate_names_what_nothing_drives(tmp_path: Path) -> None:
    scope = rpctl.verify(rpctl.load(cart(tmp_path)), samples=1).scope
    assert {"driven wheels: all", "undriven joints of the arm: hinge"} <= {*scope.assumes}
    idle = write(tmp_path, idle_wheels(platform(SET_A)))
    assert "driven wheels: none" in rpctl.verify(rpctl.load(idle), samples=1).scope.assumes


def test_minus_one_is_no_limit(tmp_path: Path) -> None:
    path = cart(tmp_path)
    path.write_text(path.read_text().replace(IDLE, '<limit effort="-1" velocity="-1"/>'))
    joint = rpctl.load(path).description.joint["hinge"]
    assert math.isinf(joint.effort) and math.isinf(joint.velocity)


def test_a_car_that_no_motor_steers_is_told(tmp_path: Path) -> None:
    text = vehicle("tricycle").replace('effort="40"', 'effort="0"')
    robot = rpctl.load(write(tmp_path, text))
    assert not robot.drive.swivels[0].driven
    (told,) = findings(robot, "warning")
    assert told.startswith('effort limit of joint "steer" is 0: no motor steers with it')
    drive = tmp_path / "drive.toml"
    drive.write_text('type = "tricycle"\n[[swivel]]\njoint = "steer"\ndriven = true\n')
    assert "steer" in rpctl.load(tmp_path / "robot.urdf", drive).actuators


def test_what_nothing_moves_is_verified(tmp_path: Path) -> None:
    """A level slide without a motor: no force acts, and none is divided by."""
    slide = PENDULUM.replace('type="continuous"', 'type="prismatic"')
    limit = '<limit lower="0" upper="0" effort="0" velocity="0"/>'
    slide = slide.replace('<limit effort="0" velocity="9"/>', limit)
    base = '<link name="base"><inertial><mass value="3"/><inertia ixx=".1" iyy=".1" izz=".1"'
    base += ' ixy="0" ixz="0" iyz="0"/></inertial></link>'
    robot = rpctl.load(write(tmp_path, f'<robot name="slide">{base}{slide}</robot>'), "fixed")
    assert robot.quasi_velocities == ("hinge",)
    assert rpctl.verify(robot, samples=2).passed
