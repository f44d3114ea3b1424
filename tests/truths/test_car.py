"""A rear-driven car that follows a straight line, against a textbook's.

[DOS98] De Luca, Oriolo, Samson, "Feedback control of a nonholonomic car-like robot", in Robot
Motion Planning and Control, Springer 1998: with P = (x, y) the middle of the rear axle, θ the
heading, φ the steering angle and ℓ the wheelbase (its section 2),

    ẋ = v cos θ,    ẏ = v sin θ,    θ̇ = v tan φ/ℓ,    φ̇ = w.

Its chained form: x₁ = x, x₂ = tan φ/(ℓ cos³θ), x₃ = tan θ, x₄ = y have
ẋ₁ = u₁, ẋ₂ = u₂, ẋ₃ = x₂u₁, ẋ₄ = x₃u₁, and u₂ = −u₁(k₁x₄ + k₂x₃ + k₃x₂) brings the car onto y = 0.
The dynamics are Lagrange's under d'Alembert's principle: a body, two rear wheels, a fork whose
centre of mass lies beside the steering axis, and the wheel that it carries.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.motion import rk4_step
from tests.robots import write
from tests.truths.dalembert import Textbook, derive

L, B = 0.73, 0.24  # m; wheelbase, half track
R_REAR, R_FRONT = 0.11, 0.09  # m
BODY = {"m": 18.0, "I": 0.94, "x": 0.29, "y": -0.04}  # kg, kg m²; centre of mass from P
REAR = {"m": 1.3, "spin": 0.0081, "yaw": 0.0047}
FORK = {"m": 2.1, "I": 0.031, "x": -0.05, "y": 0.02}  # centre of mass from the steering axis
FRONT = {"m": 0.9, "spin": 0.0039, "yaw": 0.0022}
PERIOD, PERIODS = 0.02, 150  # s: efforts are held over a period
SPEED, GAINS, RATE = 0.8, (8.0, 12.0, 6.0), 12.0  # m/s; of the chained form; 1/s of the speeds
ROUNDING = 1e-12
INTEGRATORS = 1e-9  # m, rad, m/s, rad/s: what RK4 leaves at an eighth of PERIOD

WHEEL = """<link name="{name}"><inertial><mass value="{m}"/>
  <inertia ixx="{yaw}" ixy="0" ixz="0" iyy="{spin}" iyz="0" izz="{yaw}"/></inertial>
  <collision><origin rpy="1.5707963267948966 0 0"/>
  <geometry><cylinder radius="{r}" length="0.03"/></geometry></collision></link>
  <joint name="{name}_joint" type="continuous"><parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{xyz}"/><axis xyz="0 {sign} 0"/></joint>"""

BLOCK = """<link name="{name}"><inertial><origin xyz="{x} {y} 0.2"/><mass value="{m}"/>
  <inertia ixx="{I}" ixy="0" ixz="0" iyy="{I}" iyz="0" izz="{I}"/></inertial></link>"""

DRIVE = """type = "tricycle"
[[wheel]]
joint = "left_joint"
[[wheel]]
joint = "right_joint"
[[wheel]]
joint = "front_joint"
driven = false
[[swivel]]
joint = "steer"
role = "steered"
driven = true
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder: Path = tmp_path_factory.mktemp("car")
    parts = [
        BLOCK.format(name="base", **BODY),
        WHEEL.format(name="left", parent="base", xyz=f"0 {B} {R_REAR}", sign=1, r=R_REAR, **REAR),
        WHEEL.format(name="right", parent="base", xyz=f"0 {-B} {R_REAR}", sign=1, r=R_REAR, **REAR),
        BLOCK.format(name="fork", **FORK),
        f'<joint name="steer" type="revolute"><parent link="base"/><child link="fork"/>'
        f'<origin xyz="{L} 0 {R_FRONT}"/><axis xyz="0 0 1"/>'
        '<limit lower="-1.2" upper="1.2" effort="40" velocity="6"/></joint>',
        WHEEL.format(name="front", parent="fork", xyz="0 0 0", sign=1, r=R_FRONT, **FRONT),
    ]
    path = write(folder, f'<robot name="car">{"".join(parts)}</robot>')
    return rpctl.load(path, drive=write(folder, DRIVE, "drive.toml"))


@pytest.fixture(scope="module")
def textbook() -> Textbook:
    """Return the car's equations in ν = (v, φ̇), τ = (left, right, steering)."""
    x, y, theta, phi = places = sp.symbols("x y theta phi")
    rates = sp.symbols("xd yd thetad phid")
    spins = sp.symbols("left right front")
    v, w = speeds = sp.symbols("v w")
    thetad, phid = rates[2:]

    def velocity_squared(px: sp.Expr, py: sp.Expr) -> sp.Expr:
        places_rates = sp.Matrix([px, py]).jacobian(places) * sp.Matrix(rates)
        return places_rates.dot(places_rates)

    def at(along: float, left: float) -> tuple[sp.Expr, sp.Expr]:
        cos, sin = sp.cos(theta), sp.sin(theta)
        return x + along * cos - left * sin, y + along * sin + left * cos

    pivot = at(L, 0.0)
    heading = theta + phi
    fork = (
        pivot[0] + FORK["x"] * sp.cos(heading) - FORK["y"] * sp.sin(heading),
        pivot[1] + FORK["x"] * sp.sin(heading) + FORK["y"] * sp.cos(heading),
    )
    twice = BODY["m"] * velocity_squared(*at(BODY["x"], BODY["y"])) + BODY["I"] * thetad**2
    for side, spin in ((B, spins[0]), (-B, spins[1])):
        twice += REAR["m"] * velocity_squared(*at(0.0, side))
        twice += REAR["yaw"] * thetad**2 + REAR["spin"] * spin**2
    twice += FORK["m"] * velocity_squared(*fork) + FORK["I"] * (thetad + phid) ** 2
    twice += FRONT["m"] * velocity_squared(*pivot)
    twice += FRONT["yaw"] * (thetad + phid) ** 2 + FRONT["spin"] * spins[2] ** 2
    turn = v * sp.tan(phi) / L
    admitted = sp.Matrix(
        [
            v * sp.cos(theta), v * sp.sin(theta), turn, w,
            (v - B * turn) / R_REAR, (v + B * turn) / R_REAR, v / (sp.cos(phi) * R_FRONT),
        ]
    )  # fmt: skip
    angles = sp.symbols("angle_left angle_right angle_front")
    Q = sp.zeros(7, 3)
    Q[4, 0] = Q[5, 1] = Q[3, 2] = 1
    S = admitted.jacobian(sp.Matrix(speeds))
    return derive((*places, *angles), (*rates, *spins), speeds, twice / 2, sp.Integer(0), S, Q)


def law(textbook: Textbook, x: Array, nu: Array) -> Array:
    """Return the efforts that bring the car onto y = 0, by the textbook's model and law."""
    _, y, theta, phi = x[:4]
    cos, sin, u1 = math.cos(theta), math.sin(theta), SPEED
    chained = np.array([y, math.tan(theta), math.tan(phi) / (L * cos**3)])
    u2 = -u1 * (np.array(GAINS) @ chained)
    w = L * cos**3 * math.cos(phi) ** 2 * u2 - 3.0 * math.sin(phi) ** 2 * sin * u1 / (L * cos**2)
    return textbook.efforts(x, nu, RATE * (np.array([u1 / cos, w]) - nu))


def places(robot: Robot, q: Array) -> Array:
    """Return the textbook's x; wheels' angles count for nothing."""
    return np.array([*robot.base_pose(q), robot.joint_position(q, "steer"), 0.0, 0.0, 0.0])


def scale(*arrays: Array) -> float:
    return max(float(np.abs(array).max()) for array in arrays)


def test_the_equations_are_the_textbooks(robot: Robot, textbook: Textbook) -> None:
    assert robot.quasi_velocities == ("v", "steer")
    assert robot.actuators == ("left_joint", "right_joint", "steer")
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(0)
    for _ in range(20):
        x, y, theta = rng.uniform(-3.0, 3.0, 3)
        q, nu = (
            robot.configuration(x, y, theta, joints={"steer": rng.uniform(-1.1, 1.1)}),
            rng.normal(size=2),
        )
        M, h, columns, _ = textbook.terms(places(robot, q), nu)
        np.testing.assert_allclose(dynamics.inertia(q), M, rtol=0, atol=ROUNDING * scale(M))
        np.testing.assert_allclose(dynamics.bias(q, nu), h, rtol=0, atol=ROUNDING * scale(M, h))
        np.testing.assert_allclose(
            dynamics.actuation(q), columns, rtol=0, atol=ROUNDING * scale(columns)
        )


def drive(robot: Robot, textbook: Textbook, substeps: int) -> tuple[float, Array]:
    """Return how far the two closed loops get apart at most, and where the textbook's ends."""
    dynamics, farthest = ReducedDynamics(robot), 0.0
    q, nu = robot.configuration(-1.0, 0.6, 0.3, joints={"steer": -0.2}), np.array([0.3, 0.1])
    x, speed = places(robot, q), nu
    for _ in range(PERIODS):
        tau = law(textbook, places(robot, q), nu)
        for _ in range(substeps):
            q, nu, *_ = rk4_step(dynamics, q, nu, tau, PERIOD / substeps)
        x, speed = textbook.motion(x, speed, law(textbook, x, speed), PERIOD)
        gap = np.append(places(robot, q)[:4] - x[:4], nu - speed)
        farthest = max(farthest, float(np.abs(gap).max()))
    return farthest, x[:4]


@pytest.mark.slow
def test_the_closed_loops_go_the_same_way(robot: Robot, textbook: Textbook) -> None:
    """They part by RK4's truncation and nothing else: half the step, a sixteenth of it."""
    (coarse, _), (fine, end) = (drive(robot, textbook, substeps) for substeps in (4, 8))
    assert fine < INTEGRATORS
    assert 10.0 < coarse / fine < 22.0
    assert abs(end[1]) < 0.12  # from 0.6 m it comes onto the line, 0.109 m off it by now
    assert end[0] > 1.3
