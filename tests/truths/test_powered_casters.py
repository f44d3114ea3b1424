"""A base on two powered casters, against a textbook's kinematics and Lagrange's equations.

[HK00] Holmberg, Khatib, Development and control of a holonomic mobile robot for mobile manipulation
tasks, Int. J. Robotics Research 19(11), 2000: a caster whose axis stands at (h, β), polar, with a
wheel of radius r that trails it by b and heads along φ, both seen from the base, turns and rolls at

    φ̇ = (−s φ v_x + c φ v_y + h cos(β − φ) ω)/b − ω,
    ρ̇ = ( c φ v_x + s φ v_y − h sin(β − φ) ω)/r.

The dynamics are Lagrange's under d'Alembert's principle: a body, two forks and two wheels, whose
contacts stand still.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from tests import urdf
from tests.robots import write

PIVOTS = ((0.21, 0.13), (-0.24, -0.07))  # m
TRAILS, RADII, BESIDE = (0.043, 0.061), (0.055, 0.072), (0.0, 0.012)  # m
BODY = (19.0, (0.05, -0.03), 0.83)  # kg, centre of mass (m), inertia about the upright (kg m²)
FORKS = ((1.3, (-0.02, 0.01), 0.004), (1.7, (-0.03, -0.015), 0.006))
WHEELS = ((0.8, 0.0011, 0.0018), (1.1, 0.0021, 0.0035))  # kg, yaw and spin inertia, kg m²
ROUNDING = 1e-12
NAMES = ("swivel_0", "swivel_1", "wheel_0", "wheel_1")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    mass, (x, y), inertia = BODY
    parts = [urdf.link("base", urdf.inertial(mass, [inertia] * 3, xyz=(x, y, 0.2)))]
    for k, ((m, (fx, fy), turning), (w, yaw, spin)) in enumerate(zip(FORKS, WHEELS, strict=True)):
        fork, wheel = f"fork_{k}", f"tyre_{k}"
        tyre = urdf.shape(f'cylinder radius="{RADII[k]}" length="0.03"', rpy=urdf.ROUND)
        place, hub = (*PIVOTS[k], 0.1), (-TRAILS[k], BESIDE[k], RADII[k] - 0.1)
        parts += [
            urdf.link(fork, urdf.inertial(m, [turning] * 3, xyz=(fx, fy, 0.0))),
            urdf.joint(f"swivel_{k}", "continuous", ("base", fork), place, "0 0 1"),
            urdf.link(wheel, urdf.inertial(w, (yaw, spin, yaw)), tyre),
            urdf.joint(f"wheel_{k}", "continuous", (fork, wheel), hub, "0 1 0"),
        ]
    parts.append(urdf.actuated(*NAMES))
    folder: Path = tmp_path_factory.mktemp("casters")
    return rpctl.load(write(folder, urdf.robot("casters", *parts)))


@pytest.fixture(scope="module")
def textbook(robot: Robot) -> casadi.Function:
    """Return M, h and B in ν = (v_x, v_y, ω) by x = (x, y, θ, ψ, ψ, ρ, ρ) and ν.

    With T(x, ẋ) the kinetic energy and ẋ = S(x) ν, S from contacts that stand still,
    Sᵀ (d/dt ∂T/∂ẋ − ∂T/∂x) = Sᵀ Q τ. τ is in the robot's order.
    """
    x, xd, nu = (casadi.SX.sym(name, n) for name, n in (("x", 7), ("xd", 7), ("nu", 3)))
    twice, slips = casadi.SX(0), []

    def turned(angle: Any, place: tuple[float, float]) -> Any:
        cos, sin = casadi.cos(angle), casadi.sin(angle)
        return casadi.vertcat(cos * place[0] - sin * place[1], sin * place[0] + cos * place[1])

    def velocity(place: Any) -> Any:
        return casadi.jtimes(place, x, xd)

    bodies = [(BODY[0], BODY[2], x[:2] + turned(x[2], BODY[1]), xd[2])]
    for k in range(2):
        along, turn, u = x[2] + x[3 + k], xd[2] + xd[3 + k], xd[5 + k]
        pivot = x[:2] + turned(x[2], PIVOTS[k])
        centre = pivot + turned(along, (-TRAILS[k], BESIDE[k]))
        bodies.append((FORKS[k][0], FORKS[k][2], pivot + turned(along, FORKS[k][1]), turn))
        bodies.append((WHEELS[k][0], WHEELS[k][1], centre, turn))
        twice += WHEELS[k][2] * u**2
        slips.append(velocity(centre) - RADII[k] * u * turned(along, (1.0, 0.0)))
    for mass, inertia, centre, turn in bodies:
        twice += mass * casadi.sumsqr(velocity(centre)) + inertia * turn**2
    A = casadi.jacobian(casadi.vertcat(*slips), xd)
    base = casadi.diagcat(casadi.horzcat(turned(x[2], (1, 0)), turned(x[2], (0, 1))), 1)
    S = casadi.vertcat(base, -casadi.solve(A[:, 3:], A[:, :3] @ base))
    momentum = casadi.gradient(0.5 * twice, xd)
    M, admitted = casadi.jacobian(momentum, xd), S @ nu
    force = casadi.jtimes(momentum, x, xd) - casadi.gradient(0.5 * twice, x)
    force = casadi.substitute(force, xd, admitted) + M @ casadi.jtimes(admitted, x, admitted)
    rows = [3 + NAMES.index(name) for name in robot.actuators]
    return casadi.Function("terms", [x, nu], [S.T @ M @ S, S.T @ force, S.T[:, rows]])


def posture(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a random q and the textbook's coordinates; wheels' angles count for nothing."""
    q = robot.random_configuration(rng)
    swivels = [robot.joint_position(q, name) for name in NAMES[:2]]
    return q, np.array([*robot.base_pose(q), *swivels, 0.0, 0.0])


def test_the_joints_turn_as_the_paper_says(robot: Robot) -> None:
    """And so do efforts make forces: B has the same numbers, column by joint."""
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(0)
    for _ in range(5):
        q, x = posture(robot, rng)
        S, B = dynamics.basis(q), dynamics.actuation(q)
        for k, phi in enumerate(x[3:5]):
            x0, y0 = PIVOTS[k]
            h, beta = np.hypot(x0, y0), np.arctan2(y0, x0)
            cos, sin, b = np.cos(phi), np.sin(phi), TRAILS[k]
            turn = np.array([-sin, cos, h * np.cos(beta - phi) - b]) / b
            # A wheel beside the axis rolls by what the fork turns, too: ω + φ̇.
            side = BESIDE[k] * np.add(turn, [0.0, 0.0, 1.0])
            roll = (np.array([cos, sin, -h * np.sin(beta - phi)]) - side) / RADII[k]
            for name, row in ((f"swivel_{k}", turn), (f"wheel_{k}", roll)):
                np.testing.assert_allclose(S[robot.velocity_index(name)], row, atol=ROUNDING)
                column = robot.actuators.index(name)
                np.testing.assert_allclose(B[:, column], row, atol=ROUNDING)


def test_the_equations_are_lagranges(robot: Robot, textbook: casadi.Function) -> None:
    assert robot.drive.type == "powered-casters"
    assert robot.quasi_velocities == ("vx", "vy", "omega")
    assert set(robot.actuators) == set(NAMES)
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(0)
    for _ in range(20):
        (q, x), nu, tau = posture(robot, rng), rng.normal(size=3), rng.normal(size=4)
        M, h, B = (np.array(part) for part in textbook(x, nu))
        h = h.ravel()
        scale = float(max(np.abs(M).max(), np.abs(h).max()))
        np.testing.assert_allclose(dynamics.inertia(q), M, rtol=0, atol=ROUNDING * scale)
        np.testing.assert_allclose(dynamics.bias(q, nu), h, rtol=0, atol=ROUNDING * scale)
        np.testing.assert_allclose(dynamics.actuation(q), B, rtol=0, atol=ROUNDING * 100.0)
        nu_dot = np.linalg.solve(M, B @ tau - h)
        np.testing.assert_allclose(dynamics.forward(q, nu, tau), nu_dot, rtol=1e-10, atol=1e-10)
