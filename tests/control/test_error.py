"""The tracking error and its rate, and the leash that bounds it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import (
    Leash,
    ReducedDynamics,
    Robot,
)
from rpctl import math as scalars
from rpctl.arrays import Array
from rpctl.control.error import SERIES_RADIUS, base_error_rate, tracking_error, wrap
from rpctl.control.registry import read_law
from rpctl.kernels.sheet import Evaluator, Sheet
from rpctl.reference.motion import ReferenceState
from rpctl.reference.named import reference_by_name
from tests.robots import SET_A, platform, write


def test_the_error_is_seen_from_the_robot(tiago: Robot) -> None:
    state = reference_by_name(tiago, "eight")(0.0)
    state = state._replace(pose=np.array([1.0, 2.0, 0.3]))
    facing_left = tiago.configuration_at(np.array([1.0, 1.5, math.pi / 2]), tiago.home)
    e = tracking_error(tiago, state, facing_left)
    np.testing.assert_allclose(e[:3], [0.5, 0.0, 0.3 - math.pi / 2], atol=1e-15)
    assert not e[3:].any()


def test_angles_wrap() -> None:
    assert wrap(math.pi + 0.1) == pytest.approx(0.1 - math.pi)
    assert wrap(-math.pi - 0.1) == pytest.approx(math.pi - 0.1)
    assert wrap(math.pi) == math.pi
    assert wrap(20 * math.pi + 1.0) == pytest.approx(1.0)


TURRET = """<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="{name}_joint" type="{kind}"><parent link="base"/><child link="{name}"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
  <limit lower="-4" upper="4" effort="9" velocity="2"/></joint>"""


def test_only_joints_without_limits_go_the_short_way(tmp_path: Path) -> None:
    """From −3 to 3 rad it is 6 − 2π for a lidar, and 6 for a joint with stops between."""
    kinds = (("lidar", "continuous"), ("turret", "revolute"))
    extra = "".join(TURRET.format(name=name, kind=kind) for name, kind in kinds)
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=extra)))
    assert [joint.name for joint in robot.joints] == ["lidar_joint", "turret_joint"]
    q = robot.configuration_at(np.zeros(3), np.array([-3.0, -3.0]))
    for turns in (0, 2):
        joints = np.array([3.0 + 2 * math.pi * turns, 3.0])
        state = ReferenceState(*np.zeros((3, 3)), *np.zeros((3, 2)))._replace(joints=joints)
        e = tracking_error(robot, state, q)
        np.testing.assert_allclose(e, [0, 0, 0, 6.0 - 2 * math.pi, 6.0], atol=1e-12)


def test_the_rate_knows_speeds_to_the_left(rng: np.random.Generator) -> None:
    """Base and reference both slide: poses that move as their twists say, by differences."""
    robot, step = rpctl.load("mecanum"), 1e-6
    dynamics, start = ReducedDynamics(robot), reference_by_name(robot, "line")(5.0)
    for _ in range(10):
        twist, nu = rng.normal(size=3), rng.normal(size=robot.dof)
        pose = rng.normal(size=3) * [0.3, 0.3, 0.5]
        q = robot.configuration_at(np.array([0.1, -0.2, 0.3]), start.joints)
        v, (cos, sin) = dynamics.basis(q) @ nu, (math.cos(pose[2]), math.sin(pose[2]))
        moved = np.array(
            [cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1], twist[2]]
        )
        state = start._replace(pose=pose, twist=twist)
        ahead, behind = (
            tracking_error(
                robot,
                state._replace(pose=pose + s * moved, joints=state.joints + s * state.joint_rates),
                pin.integrate(robot.model, q, s * v),
            )
            for s in (step, -step)
        )
        e = tracking_error(robot, state, q)
        rate = base_error_rate(e, state.twist, dynamics.twist(q, nu))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(slope[:3], rate, atol=1e-7)


LEASH = Leash(0.3, 0.7)
STEP = 1e-6
LEASHED = ("unified", "kanayama", "feedback-linearization")


@pytest.fixture(scope="module")
def leashed() -> Evaluator:
    """An error (3,) and its rate on the leash."""
    sheet, e, e_dot = Sheet(), *(scalars.SX.sym(name, 3) for name in ("e", "e_dot"))
    for k in range(3):
        sheet.moves(e[k], e_dot[k])
    found = LEASH(sheet, scalars.vertsplit(e))
    rates = [sheet.rate(each) for each in found]
    values = [scalars.vertcat(*part) for part in (found, rates)]
    return Evaluator(scalars.Function("leash", [e, e_dot], sheet.resolved(values)))


def test_the_error_stays_on_the_leash(leashed: Evaluator, rng: np.random.Generator) -> None:
    """Its direction stays, its length grows with the error and never beyond the leash."""
    for _ in range(20):
        e = rng.normal(size=3) * [3.0, 3.0, 2.0]
        near, _ = leashed(e, np.zeros(3))
        assert math.hypot(*near[:2]) == pytest.approx(0.3 * math.tanh(math.hypot(*e[:2]) / 0.3))
        assert near[0] * e[1] == pytest.approx(near[1] * e[0])
        assert near[:2] @ e[:2] > 0.0
        assert near[2] == pytest.approx(0.7 * math.tanh(e[2] / 0.7))


@pytest.mark.parametrize("size", [1e-9, 0.5 * SERIES_RADIUS, 2.0 * SERIES_RADIUS, 0.3, 3.0])
def test_the_rate_is_exact(leashed: Evaluator, size: float, rng: np.random.Generator) -> None:
    for _ in range(5):
        e, rate = size * rng.normal(size=3), rng.normal(size=3)
        step = STEP * max(size, 1e-3)
        ahead, behind = (leashed(e + s * rate, rate)[0] for s in (step, -step))
        np.testing.assert_allclose(leashed(e, rate)[1], (ahead - behind) / (2 * step), atol=1e-7)


def test_near_the_reference_it_leaves_the_error_as_it_is(
    leashed: Evaluator, rng: np.random.Generator
) -> None:
    """To third order: of an error of a thousandth of the leash a millionth."""
    e, rate = 1e-3 * rng.uniform(-1.0, 1.0, (2, 3)) * [0.3, 0.3, 0.7]
    near, near_rate = leashed(e, rate)
    np.testing.assert_allclose(near, e, rtol=1e-6)
    np.testing.assert_allclose(near_rate, rate, atol=3e-6 * np.abs(rate).max())
    still: list[Array] = leashed(np.zeros(3), rate)
    np.testing.assert_array_equal(still[0], np.zeros(3))
    np.testing.assert_allclose(still[1], rate, rtol=1e-15)


@pytest.mark.parametrize("name", LEASHED)
def test_a_far_start_asks_for_bounded_speeds(paper: Robot, name: str) -> None:
    """Without a leash v_d grows with the square of the error, or with the error."""
    dynamics = ReducedDynamics(paper)
    law = read_law("kinematic", name).start(dynamics, 0.01)
    reference = reference_by_name(paper, "reverse")
    pose, nu = reference(4.0).pose, np.array([-0.3, 0.0, 0.0, 0.0])
    for far in (3.0, 1e3):
        for angle in np.linspace(-math.pi, math.pi, 9):
            q = paper.configuration(pose[0] + far, pose[1] - far, angle)
            nu_d, nu_d_dot = law(dynamics, reference, 4.0, q, nu)
            assert np.abs(nu_d).max() < 6.0
            assert np.isfinite(nu_d_dot).all()
