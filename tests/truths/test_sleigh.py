"""The Chaplygin sleigh, on wheels.

[B15] Bloch, Nonholonomic Mechanics and Control, section 1.7: a body of mass m and inertia I on a
knife edge, its centre of mass a distance a ahead of the edge, v the edge's speed:

    v̇ = a ω²,    ω̇ = −m a v ω / (I + m a²).

A differential drive without efforts is the same with two wheels (m_w, spin inertia I_s, yaw inertia
I_d, radius r, at ±b beside P) added to both inertias, M_v = m + 2m_w + 2I_s/r² and
J = I + m a² + 2I_d + 2m_w b² + 2I_s b²/r², which leave the right-hand sides as they are:

    M_v v̇ = m a ω²,    J ω̇ = −m a v ω,    E = ½ (M_v v² + J ω²) constant.

With V = √(2E/M_v), Ω = √(2E/J), s = m a V t/J + artanh(v₀/V):

    v = V tanh s,    ω = Ω sech s,    θ = √(M_v J)/(m a) · 2 atan(tanh(s/2)) + constant.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.motion import rk4_step
from tests.robots import platform, write

SLEIGH = {"m_c": 12.3, "I_c": 0.87, "d": 0.31, "m_w": 0.9, "I_s": 0.0043, "I_d": 0.0027}
SLEIGH |= {"b": 0.27, "r": 0.085}
BACK = 0.13  # m; the axle lies so far behind the root link's origin
A = SLEIGH["d"] + BACK
EXACT = 1e-12  # rounding
STEP = 0.005  # s
RK4 = 1e-9  # m, rad, m/s, rad/s: what RK4 leaves at STEP over 4 s


def sleigh(folder: Path, wheels: float) -> Robot:
    """Return the sleigh with wheels ``wheels`` times as heavy as SLEIGH says."""
    scaled = {key: wheels * SLEIGH[key] for key in ("m_w", "I_s", "I_d")}
    text = platform({**SLEIGH, **scaled}, right_sign=-1)
    return rpctl.load(write(folder, text.replace('<origin xyz="0 ', f'<origin xyz="{-BACK} ')))


def inertias(wheels: float = 1.0) -> tuple[float, float, float]:
    """Return M_v, J and m a."""
    m, I, m_w, I_s, I_d, b, r = (  # noqa: E741 (the book's letter)
        SLEIGH[key] for key in ("m_c", "I_c", "m_w", "I_s", "I_d", "b", "r")
    )
    M_v = m + wheels * (2.0 * m_w + 2.0 * I_s / r**2)
    J = I + m * A**2 + wheels * (2.0 * I_d + 2.0 * m_w * b**2 + 2.0 * I_s * b**2 / r**2)
    return M_v, J, m * A


@pytest.mark.parametrize(("v", "omega"), [(0.7, 1.9), (-1.3, 0.4), (0.2, -2.7)])
def test_it_accelerates_as_the_book_says(tmp_path: Path, v: float, omega: float) -> None:
    robot = sleigh(tmp_path, wheels=1.0)
    M_v, J, ma = inertias()
    nu_dot = ReducedDynamics(robot).forward(
        robot.configuration(0.4, -1.1, 0.6), np.array([v, omega]), np.zeros(2)
    )
    expected = [ma * omega**2 / M_v, -ma * v * omega / J]
    np.testing.assert_allclose(nu_dot, expected, rtol=EXACT)


def test_without_wheel_inertia_it_is_the_books_own(tmp_path: Path) -> None:
    """Wheels of a billionth of their inertia change v̇ and ω̇ by as little."""
    robot = sleigh(tmp_path, wheels=1e-9)
    v, omega, m, I = 0.7, 1.9, SLEIGH["m_c"], SLEIGH["I_c"]  # noqa: E741
    nu_dot = ReducedDynamics(robot).forward(
        robot.configuration(), np.array([v, omega]), np.zeros(2)
    )
    expected = [A * omega**2, -m * A * v * omega / (I + m * A**2)]
    np.testing.assert_allclose(nu_dot, expected, rtol=1e-8)


def closed_form(v: float, omega: float, t: Array) -> Array:
    """Return v, ω and the turn since t = 0 (3, n)."""
    M_v, J, ma = inertias()
    E = 0.5 * (M_v * v**2 + J * omega**2)
    V, W = math.sqrt(2.0 * E / M_v), math.copysign(math.sqrt(2.0 * E / J), omega)
    first = math.atanh(v / V)
    s = ma * V * t / J + first
    turn = 2.0 * (np.arctan(np.tanh(0.5 * s)) - math.atan(math.tanh(0.5 * first)))
    return np.array([V * np.tanh(s), W / np.cosh(s), math.copysign(turn_unit(), omega) * turn])


def turn_unit() -> float:
    M_v, J, ma = inertias()
    return math.sqrt(M_v * J) / ma


def path(pose: tuple[float, float, float], v: float, omega: float, t: Array) -> Array:
    """Return P's place (2, n) by integrating the book's equations."""
    M_v, J, ma = inertias()

    def slope(_: float, state: Array) -> list[float]:
        _, _, theta, speed, turn = state
        return [
            speed * math.cos(theta), speed * math.sin(theta), turn,
            ma * turn**2 / M_v, -ma * speed * turn / J,
        ]  # fmt: skip

    start = [*pose, v, omega]
    found = solve_ivp(slope, (t[0], t[-1]), start, "DOP853", t, rtol=1e-12, atol=1e-12)
    return np.asarray(found.y[:2])


@pytest.mark.parametrize(("v", "omega"), [(-0.9, 1.1), (0.3, -1.6)])
def test_it_moves_as_the_closed_form(tmp_path: Path, v: float, omega: float) -> None:
    """Thrown backwards it turns round, and runs straight in the end, centre of mass first."""
    robot = sleigh(tmp_path, wheels=1.0)
    dynamics, t = ReducedDynamics(robot), np.arange(0.0, 4.0, STEP)
    q, nu = robot.configuration(0.4, -1.1, 0.6), np.array([v, omega])
    first, energy = robot.base_pose(q), dynamics.energy(q, nu)
    states = [(*nu, 0.0, *first[:2])]
    turned, before = 0.0, first[2]
    for _ in t[1:]:
        q, nu, work, _ = rk4_step(dynamics, q, nu, np.zeros(2), STEP)
        x, y, theta = robot.base_pose(q)
        turned += math.remainder(theta - before, 2.0 * math.pi)
        before = theta
        states.append((*nu, turned, x, y))
        assert work == 0.0
        assert dynamics.energy(q, nu) == pytest.approx(energy, rel=RK4)
    expected = np.vstack([closed_form(v, omega, t), path(tuple(first), v, omega, t)])
    np.testing.assert_allclose(np.array(states).T, expected, rtol=0, atol=RK4)


def test_it_runs_straight_in_the_end(tmp_path: Path) -> None:
    """All its energy is forward speed then, and it has turned by what the closed form leaves."""
    robot = sleigh(tmp_path, wheels=1.0)
    dynamics, (v, omega) = ReducedDynamics(robot), (-0.9, 1.1)
    q, nu = robot.configuration(), np.array([v, omega])
    for _ in range(3200):
        q, nu, *_ = rk4_step(dynamics, q, nu, np.zeros(2), STEP)
    M_v, J, _ = inertias()
    V = math.sqrt(v**2 + J * omega**2 / M_v)
    np.testing.assert_allclose(nu, [V, 0.0], atol=1e-8)
    left = 0.5 * math.pi - 2.0 * math.atan(math.tanh(0.5 * math.atanh(v / V)))
    assert math.remainder(robot.base_pose(q)[2] - turn_unit() * left, 2.0 * math.pi) == (
        pytest.approx(0.0, abs=1e-7)
    )
