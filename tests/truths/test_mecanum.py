"""A mecanum base with an arm that drives to a pose, against a textbook's.

[LP17] Lynch, Park, Modern Robotics, Cambridge 2017, section 13.2, after Muir and Neuman 1987: the
wheels 1 front left, 2 front right, 3 rear right and 4 rear left turn at u = H(0) (ω, v_x, v_y),

              [ −ℓ−w   1  −1 ]
    H(0) = 1/r [  ℓ+w   1   1 ]    with 2ℓ between the axles and 2w between the sides.
              [  ℓ+w   1  −1 ]
              [ −ℓ−w   1   1 ]

The dynamics are Lagrange's under d'Alembert's principle: a body, four wheels, a turning column and
a boom that pitches on it, of which gravity has a part.
"""

from __future__ import annotations

from dataclasses import dataclass
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

ELL, W, R = 0.26, 0.21, 0.076  # m
GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Body:
    """A body: where its joint is on what carries it, mass, centre of mass, principal inertias."""

    m: float  # kg
    com: tuple[float, float, float]  # m
    I: tuple[float, float, float]  # noqa: E741 (kg m², the field's letter)
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m


BODY = Body(21.0, (0.06, -0.03, 0.15), (0.71, 0.92, 1.13))
COLUMN = Body(3.2, (0.05, -0.02, 0.12), (0.03, 0.04, 0.02), at=(0.11, 0.04, 0.33))
BOOM = Body(2.3, (0.24, 0.03, -0.05), (0.011, 0.08, 0.07), at=(0.03, 0.06, 0.21))
WHEEL = Body(1.4, (0.0, 0.0, 0.0), (0.0035, 0.0062, 0.0035))
PLACES = {"front_left": (ELL, W), "front_right": (ELL, -W)}
PLACES |= {"rear_right": (-ELL, -W), "rear_left": (-ELL, W)}  # the book's order
H = np.array([[-ELL - W, 1, -1], [ELL + W, 1, 1], [ELL + W, 1, -1], [-ELL - W, 1, 1]]) / R
PERIOD, PERIODS = 0.02, 200  # s: efforts are held over a period
GOAL = np.array([1.1, -0.7, 0.9, 0.8, -0.5])  # x, y, θ, column, boom
NEAR, DAMPED = 6.0, 5.0  # 1/s², 1/s
ROUNDING = 1e-12
INTEGRATORS = 1e-9  # m, rad, m/s, rad/s: what RK4 leaves at an eighth of PERIOD


def link(name: str, body: Body, shape: str = "") -> str:
    (x, y, z), (a, b, c) = body.com, body.I
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{body.m}"/>'
        f'<inertia ixx="{a}" ixy="0" ixz="0" iyy="{b}" iyz="0" izz="{c}"/></inertial>{shape}</link>'
    )


def joint(name: str, kind: str, parent: str, at: tuple[float, ...], axis: str) -> str:
    x, y, z = at
    limit = '<limit lower="-2" upper="2" effort="50" velocity="3"/>' * (kind == "revolute")
    return (
        f'<joint name="{name}_joint" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    tyre = '<collision><origin rpy="1.5707963267948966 0 0"/><geometry>'
    tyre += f'<cylinder radius="{R}" length="0.05"/></geometry></collision>'
    parts = [link("base", BODY), link("column", COLUMN), link("boom", BOOM)]
    parts.append(joint("column", "revolute", "base", COLUMN.at, "0 0 1"))
    parts.append(joint("boom", "revolute", "column", BOOM.at, "0 1 0"))
    for name, (x, y) in PLACES.items():
        parts.append(link(name, WHEEL, tyre))
        parts.append(joint(name, "continuous", "base", (x, y, R), "0 1 0"))
    folder: Path = tmp_path_factory.mktemp("mecanum")
    text = f'<robot name="mecanum">{"".join(parts)}</robot>'
    return rpctl.load(write(folder, text), drive="mecanum")


@pytest.fixture(scope="module")
def textbook(robot: Robot) -> Textbook:
    """Return the equations in ν = (v_x, v_y, ω, α̇, β̇), τ as the robot orders it."""
    x, y, theta, alpha, beta = places = sp.symbols("x y theta alpha beta")
    rates = sp.symbols("xd yd thetad alphad betad")
    spins = sp.symbols("u1:5")
    speeds = sp.symbols("vx vy omega alpha_rate beta_rate")
    turned = sp.rot_axis3(-theta)  # SymPy turns the axes, not the vector
    column, boom = turned * sp.rot_axis3(-alpha), sp.rot_axis2(-beta)

    def velocity(place: sp.Matrix) -> sp.Matrix:
        return place.jacobian(places) * sp.Matrix(rates)

    origin = sp.Matrix([x, y, 0])
    foot = origin + turned * sp.Matrix(COLUMN.at)
    elbow = foot + column * sp.Matrix(BOOM.at)
    up = sp.Matrix([0, 0, 1])
    in_boom = boom.T * up * (rates[2] + rates[3]) + sp.Matrix([0, rates[4], 0])
    parts = [
        (BODY, origin + turned * sp.Matrix(BODY.com), up * rates[2]),
        (COLUMN, foot + column * sp.Matrix(COLUMN.com), up * (rates[2] + rates[3])),
        (BOOM, elbow + column * boom * sp.Matrix(BOOM.com), in_boom),
    ]
    twice = potential = sp.Integer(0)
    for body, centre, omega in parts:
        v = velocity(centre)
        twice += body.m * v.dot(v) + sum(i * w**2 for i, w in zip(body.I, omega, strict=True))
        potential += body.m * GRAVITY * centre[2]
    for (px, py), u in zip(PLACES.values(), spins, strict=True):
        v = velocity(origin + turned * sp.Matrix([px, py, 0]))
        twice += WHEEL.m * v.dot(v) + WHEEL.I[2] * rates[2] ** 2 + WHEEL.I[1] * u**2
    vx, vy, omega, alpha_rate, beta_rate = speeds
    base = turned * sp.Matrix([vx, vy, 0])
    wheels = sp.Matrix(H) * sp.Matrix([omega, vx, vy])
    admitted = sp.Matrix([base[0], base[1], omega, alpha_rate, beta_rate, *wheels])
    Q = sp.zeros(9, 6)
    rows = {f"{name}_joint": 5 + k for k, name in enumerate(PLACES)}
    rows |= {"column_joint": 3, "boom_joint": 4}
    for column_of, name in enumerate(robot.actuators):
        Q[rows[name], column_of] = 1
    S = admitted.jacobian(sp.Matrix(speeds))
    angles = sp.symbols("angle1:5")
    return derive((*places, *angles), (*rates, *spins), speeds, twice / 2, potential, S, Q)


def places(robot: Robot, q: Array) -> Array:
    """Return the textbook's x; wheels' angles count for nothing."""
    arm = [robot.joint_position(q, name) for name in ("column_joint", "boom_joint")]
    return np.array([*robot.base_pose(q), *arm, 0.0, 0.0, 0.0, 0.0])


def law(textbook: Textbook, x: Array, nu: Array) -> Array:
    """Return the efforts of a computed-torque law to GOAL, by the textbook's model."""
    gap = GOAL - x[:5]
    cos, sin = np.cos(x[2]), np.sin(x[2])
    gap[:2] = cos * gap[0] + sin * gap[1], -sin * gap[0] + cos * gap[1]
    return textbook.efforts(x, nu, NEAR * gap - DAMPED * nu)


def scale(*arrays: Array) -> float:
    return max(float(np.abs(array).max()) for array in arrays)


@pytest.mark.slow  # SymPy derives them for 5 s
def test_the_equations_are_the_textbooks(robot: Robot, textbook: Textbook) -> None:
    assert robot.quasi_velocities == ("vx", "vy", "omega", "column_joint", "boom_joint")
    assert len(robot.actuators) == 6
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(0)
    for _ in range(20):
        x, y, theta = rng.uniform(-3.0, 3.0, 3)
        arm = dict(zip(("column_joint", "boom_joint"), rng.uniform(-2.0, 2.0, 2), strict=True))
        q, nu = robot.configuration(x, y, theta, joints=arm), rng.normal(size=5)
        M, h, columns, _ = textbook.terms(places(robot, q), nu)
        np.testing.assert_allclose(dynamics.inertia(q), M, rtol=0, atol=ROUNDING * scale(M))
        np.testing.assert_allclose(dynamics.bias(q, nu), h, rtol=0, atol=ROUNDING * scale(M, h))
        np.testing.assert_allclose(
            dynamics.actuation(q), columns, rtol=0, atol=ROUNDING * scale(columns)
        )


def drive(robot: Robot, textbook: Textbook, substeps: int) -> tuple[float, Array]:
    """Return how far the two closed loops get apart at most, and where the textbook's ends."""
    dynamics, farthest = ReducedDynamics(robot), 0.0
    arm = {"column_joint": -0.6, "boom_joint": 0.4}
    q, nu = robot.configuration(-0.4, 0.5, -0.7, joints=arm), np.array([0.2, -0.3, 0.4, 0.1, -0.2])
    x, speed = places(robot, q), nu
    for _ in range(PERIODS):
        tau = law(textbook, places(robot, q), nu)
        for _ in range(substeps):
            q, nu, *_ = rk4_step(dynamics, q, nu, tau, PERIOD / substeps)
        x, speed = textbook.motion(x, speed, law(textbook, x, speed), PERIOD)
        gap = np.append(places(robot, q)[:5] - x[:5], nu - speed)
        farthest = max(farthest, float(np.abs(gap).max()))
    return farthest, x[:5]


@pytest.mark.thorough  # of the car in make slow
def test_the_closed_loops_go_the_same_way(robot: Robot, textbook: Textbook) -> None:
    """They part by RK4's truncation and nothing else: half the step, a sixteenth of it."""
    (coarse, _), (fine, end) = (drive(robot, textbook, substeps) for substeps in (4, 8))
    assert fine < INTEGRATORS
    assert 10.0 < coarse / fine < 22.0
    assert np.abs(GOAL - end).max() < 0.01  # it has come to the goal
