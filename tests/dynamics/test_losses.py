"""Damping and friction in the joints: what they are, what they do to a motion, and stiff ones."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.motion import Step, braked, imex_step, rk4_step
from rpctl.robot.losses import Losses
from rpctl.robot.vary import without_losses
from tests.joint_losses import joint_losses
from tests.robots import SET_A, platform, write
from tests.urdf import inertial, joint, limit, link
from tests.urdf import robot as urdf
from tests.vehicles import vehicle

LOSSY = '<dynamics damping="0.3" friction="0.2"/></joint>'
RATE = 1e-2  # rad/s: ε of a joint that turns


def lossy(folder: Path, text: str) -> Robot:
    """Return a robot all of whose joints have damping and friction."""
    return rpctl.load(write(folder, re.sub("</joint>", LOSSY, text)))


@pytest.fixture
def pendulum(tmp_path: Path) -> Robot:
    """A mass of 1 kg, 1 m from a level axle with 4 N·m of friction; hanging down at −π/2."""
    return rpctl.load(
        write(
            tmp_path,
            urdf(
                "pendulum",
                link("post", inertial(5.0, (0.1, 0.1, 0.1))),
                link("rod", inertial(1.0, (1e-4, 1e-4, 1e-4), xyz=(1.0, 0.0, 0.0))),
                joint("axle", "revolute", ("post", "rod"), axis=(0.0, -1.0, 0.0),
                      more=limit(-9, 9, 50, 9) + '<dynamics friction="4"/>'),
            ),
        ),
        drive="fixed",
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["casters", "car-like"])
def test_they_oppose_each_joint_and_act_through_the_basis(
    kind: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Wheels, casters and steered joints included, which are none of ν."""
    robot = lossy(tmp_path, vehicle(kind))
    dynamics = ReducedDynamics(robot)
    for _ in range(5):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = rng.normal(size=len(robot.actuators))
        S = dynamics.basis(q)
        force = joint_losses(robot, S @ nu)
        assert (force[3:] * (S @ nu)[3:] < 0.0).all()
        np.testing.assert_allclose(dynamics.losses(q, nu), S.T @ force, rtol=1e-12, atol=1e-12)
        ideal = ReducedDynamics(without_losses(robot))
        gap = dynamics.forward(q, nu, tau) - ideal.forward(q, nu, tau)
        np.testing.assert_allclose(dynamics.inertia(q) @ gap, S.T @ force, atol=1e-9)
        np.testing.assert_array_equal(dynamics.bias(q, nu), ideal.bias(q, nu))
        back = dynamics.inverse(q, nu, dynamics.forward(q, nu, tau))
        np.testing.assert_allclose(back, dynamics.actuation(q) @ tau, atol=1e-9)


def test_a_mimic_joint_loses_at_its_own_rate(tmp_path: Path) -> None:
    """It turns −3 times as fast: its damping of 2 counts 18 for the joint that it follows."""
    text = urdf(
        "mimic",
        link("post", inertial(5.0, (0.1, 0.1, 0.1))),
        link("first", inertial(1.0, (0.1, 0.1, 0.1))),
        link("second", inertial(1.0, (0.1, 0.1, 0.1))),
        joint("lead", "revolute", ("post", "first"), axis="0 0 1",
              more=limit(-1, 1, 99, 1) + '<dynamics damping="5"/>'),
        joint("follow", "revolute", ("post", "second"), "1 0 0", "0 0 1",
              limit(-3, 3, 99, 3) + '<mimic joint="lead" multiplier="-3"/><dynamics damping="2"/>'),
    )  # fmt: skip
    robot = rpctl.load(write(tmp_path, text), drive="fixed", armature={"follow": 0.5})
    dynamics, q = ReducedDynamics(robot), robot.configuration()
    np.testing.assert_allclose(dynamics.losses(q, np.array([0.1])), [-0.1 * (5.0 + 9.0 * 2.0)])
    np.testing.assert_allclose(dynamics.inertia(q), [[0.1 + 9.0 * (0.1 + 0.5)]])
    assert rpctl.verify(robot, samples=1, engines=()).passed


def followed(dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, steps: int) -> Step:
    """Return where a motion of 0.1 s ends."""
    work = lost = 0.0
    for _ in range(steps):
        q, nu, done, gone = imex_step(dynamics, q, nu, tau, 0.1 / steps)
        work, lost = work + done, lost + gone
    return Step(q, nu, work, lost)


def test_the_implicit_step_is_of_order_two(tmp_path: Path) -> None:
    """Against RK4, which shares nothing with it, in small steps; its energy's balance as well."""
    robot = lossy(tmp_path, vehicle("casters"))
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(3)
    q, nu = robot.random_configuration(rng), 0.5 + rng.uniform(size=robot.dof)
    tau = np.ones(len(robot.actuators))
    exact = Step(q, nu, 0.0)
    for _ in range(200):
        ahead = rk4_step(dynamics, exact.q, exact.nu, tau, 5e-4)
        exact = Step(ahead.q, ahead.nu, exact.work + ahead.work, exact.lost + ahead.lost)
    errors = []
    for steps in (25, 50):
        end = followed(dynamics, q, nu, tau, steps)
        gap = dynamics.energy(end.q, end.nu) - dynamics.energy(q, nu) - end.work + end.lost
        errors.append([np.abs(end.nu - exact.nu).max(), abs(end.lost - exact.lost), abs(gap)])
    assert (np.log2(np.array(errors[0]) / np.array(errors[1])) > 1.7).all()
    assert errors[1][0] < 1e-4 and max(errors[1]) < 3e-3 and exact.lost > 0.1


def test_what_friction_holds_creeps_as_slowly_as_told(pendulum: Robot) -> None:
    """Weight × arm = f sin 45°: the creep is ε, in steps 40000 times the time constant."""
    dynamics = ReducedDynamics(pendulum)
    arm = 4.0 * 0.5**0.5 / 9.81  # of the weight: the torque is 4/√2 N·m
    q, nu = pendulum.configuration(joints={"axle": np.arccos(arm)}), np.zeros(1)
    for _ in range(10):
        end = imex_step(dynamics, q, nu, np.zeros(1), 0.1)
        q, nu = end.q, end.nu
    torque = 9.81 * np.cos(pendulum.joint_position(q, "axle"))  # 1 % more than at first
    creep = RATE * torque / np.sqrt(4.0**2 - torque**2)
    assert nu[0] == pytest.approx(-creep, rel=5e-3) == pytest.approx(-RATE, rel=0.1)
    assert end.lost == pytest.approx(torque * creep * 0.1, rel=0.01)
    assert end.work == 0.0


def test_friction_stops_a_joint_within_two_steps(pendulum: Robot) -> None:
    """4 N·m take 0.4 rad/s of 1 kg m² in 0.1 s; in the first step it may swing back a little."""
    dynamics = ReducedDynamics(pendulum)
    down = pendulum.configuration(joints={"axle": -0.5 * np.pi})
    for part in np.linspace(0.02, 0.98, 9):
        stopped = imex_step(dynamics, down, np.array([0.4 * part]), np.zeros(1), 0.1)
        assert abs(stopped.nu[0]) < 0.4 / 8.0
        again = imex_step(dynamics, stopped.q, stopped.nu, np.zeros(1), 0.1)
        assert abs(again.nu[0]) < RATE
    slides = imex_step(dynamics, down, np.array([2.0]), np.zeros(1), 0.01)
    assert slides.nu[0] == pytest.approx(2.0 - 4.0 / 1.0001 * 0.01, abs=2e-3)


def test_the_balance_of_energy_closes_where_inertia_is_constant(tmp_path: Path) -> None:
    """Whatever the step: work and loss are impulses times mean speeds."""
    robot = lossy(tmp_path, platform({**SET_A, "d": 0.0}))
    dynamics, q, nu = ReducedDynamics(robot), robot.configuration(), np.array([0.3, 0.0])
    start, tau = dynamics.energy(q, nu), np.array([0.1, 0.1])
    end = imex_step(dynamics, q, nu, tau, 0.5)
    assert end.lost > 0.1
    balance = dynamics.energy(end.q, end.nu) - start - end.work + end.lost
    assert abs(balance) < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_braked_speeds_solve_their_equation(seed: int) -> None:
    """Also where a step of friction is worth a thousand times the momentum, or next to nothing."""
    rng = np.random.default_rng(seed)
    for _ in range(25):
        n, dof = 6, 4
        S, half = rng.normal(size=(n, dof)), rng.normal(size=(dof, dof))
        M = half @ half.T + np.diag(10.0 ** rng.uniform(-4, 1, dof))
        losses = Losses(rng.uniform(0, 1, n), 10.0 ** rng.uniform(-3, 2, n), np.full(n, 1e-3))
        nu, weight = rng.normal(size=dof), 10.0 ** rng.uniform(-4, -1)
        found = braked(losses, M, S, nu, weight, nu)
        force = weight * S.T @ losses.force(S @ found)
        scale = np.abs(M @ nu).max() + weight * losses.friction.sum()
        np.testing.assert_allclose(M @ (found - nu), force, atol=1e-8 * scale)
        # The minimum of what it minimises: no speed nearby is better braked.
        assert found @ M @ found <= nu @ M @ nu


def test_braking_refuses_what_is_no_inertia() -> None:
    losses = Losses(np.ones(1), np.ones(1), np.ones(1))
    with pytest.raises(rpctl.RpctlError, match="not positive definite"):
        braked(losses, -10.0 * np.eye(1), np.eye(1), np.ones(1), 0.1, np.ones(1))
