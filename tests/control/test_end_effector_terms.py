"""The end effector first, term by term: cases small enough for paper and pencil."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.end_effector import EndEffector
from rpctl.control.law import Command, KinematicLaw, as_law
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.named import reference_by_name
from tests.robots import SET_B, platform, write
from tests.vehicles import vehicle

STEP = 1e-6
NOW = 4.0  # s
REACH = 0.5  # m: of the boom
BOOM = f"""<link name="boom"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="boom_joint" type="revolute"><parent link="base"/><child link="boom"/>
  <origin xyz="0.1 0 0.5"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="9" velocity="5"/></joint>
  <link name="tip"/><joint name="tip_joint" type="fixed"><parent link="boom"/><child link="tip"/>
  <origin xyz="{REACH} 0 0"/></joint>"""
HAND = """<link name="hand"/><joint name="hand_joint" type="fixed"><parent link="arm"/>
  <child link="hand"/><origin xyz="0.5 -0.2 0.1"/></joint></robot>"""


def asks(change: Array, start: Array) -> KinematicLaw:
    """Return a law that asks for ν at time ``NOW``, changing at a constant rate."""

    def law(dynamics: ReducedDynamics, reference: Reference, t: float, *_: Array) -> Command:
        return Command(start + (t - NOW) * change, change)

    return as_law(law)


@pytest.fixture
def boomed(tmp_path: Path) -> Robot:
    return rpctl.load(write(tmp_path, platform(SET_B, extra=BOOM)), end_effector="tip")


@pytest.mark.parametrize("lever", [0.3, 2.0])
def test_the_lever_weighs_turning_against_travelling(boomed: Robot, lever: float) -> None:
    """One joint cannot mend both: the least of (d q̇ − a)² + L² (q̇ − b)² is at
    (d a + L² b)/(d² + L²), with a = aside/h and b = turned/h."""
    dynamics, still = ReducedDynamics(boomed), np.zeros(boomed.dof)
    law = EndEffector(asks(still, still), orientation=True, lever=lever, damping=1e-6)
    started = law.start(dynamics, 0.01)
    state = ReferenceState(*np.zeros((3, 3)), *np.zeros((3, 1)))
    aside, turned, d = 0.02, 0.03, REACH
    away = boomed.configuration_at(np.array([0.0, -aside, 0.0]), np.zeros(1))
    bent = boomed.configuration_at(np.zeros(3), np.array([-turned]))
    rate = started(dynamics, lambda t: state, NOW, away, still).nu_d[2]
    assert rate == pytest.approx(d * aside / law.horizon / (d**2 + lever**2), rel=1e-4)
    # A bent boom needs turned/h for either: nothing is weighed.
    rate = started(dynamics, lambda t: state, NOW, bent, still).nu_d[2]
    assert rate == pytest.approx(turned / law.horizon, rel=1e-2)
    # A boom that is bent, its tip where it should be: only turning is left to mend.
    hub, tip = np.array([0.1, 0.0]), np.array([0.1 + d, 0.0])
    swung = hub + d * np.array([np.cos(turned), -np.sin(turned)])
    moved = boomed.configuration_at(np.array([*(tip - swung), 0.0]), np.array([-turned]))
    rate = started(dynamics, lambda t: state, NOW, moved, still).nu_d[2]
    expected = lever**2 * turned / law.horizon / (d**2 + lever**2)
    assert rate == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("kind", "orientation"), [("car-like", False), ("steered", True)])
def test_the_derivative_knows_that_steering_turns_the_basis(
    tmp_path: Path, kind: str, orientation: bool, rng: np.random.Generator
) -> None:
    """The base does what it is asked to, so d/dt of S(q) ν_d is S ν̇_d + Ṡ ν."""
    text = vehicle(kind).replace("</robot>", HAND)
    robot = rpctl.load(write(tmp_path, text), end_effector="hand")
    dynamics, reference = ReducedDynamics(robot), reference_by_name(robot, "eight")
    for _ in range(3):
        nu, change = 0.3 * rng.normal(size=(2, robot.dof))
        law = EndEffector(asks(change, nu), orientation=orientation).start(dynamics, 0.01)
        steered = {s.joint: a for s, a in zip(robot.drive.steered, (0.4, -0.3), strict=False)}
        q = robot.configuration(0.1, -0.2, 0.3, {**steered, "arm_joint": 0.2})
        v = dynamics.basis(q) @ nu
        assert np.abs(dynamics.basis_drift(q, nu)[:3]).max() > 0.01

        def asked(s: float) -> Array:
            at = pin.integrate(robot.model, q, s * v)  # noqa: B023 - called in this turn only
            return law(dynamics, reference, NOW + s, at, nu).nu_d  # noqa: B023

        slope = (asked(STEP) - asked(-STEP)) / (2 * STEP)
        rate = law(dynamics, reference, NOW, q, nu).nu_d_dot
        np.testing.assert_allclose(rate, slope, atol=1e-6 * (1 + np.abs(slope).max()))
