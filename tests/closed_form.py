"""The paper robot's reduced equations by hand, from the design's closed form ([MS21, Eq. 5])."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array

# Platform, wheels, link 1 (revolute), link 2 (prismatic).
m0, J0, d = 30.0, 15.625, 0.3
m_w, I_s, I_d, b, r, l0 = 1.0, 0.005, 0.0025, 0.75, 0.15, 0.2
m1, J1, c1 = 4.0, 0.12, 0.25
m2, J2, c2 = 2.0, 0.05, -0.2


def inertia(theta1: float, eta: float) -> Array:
    """Return M (4, 4) in ν = (v, ω, θ̇1, η̇)."""
    C, S = np.cos(theta1), np.sin(theta1)
    rho = eta + c2
    p, m_a = m1 * c1 + m2 * rho, m1 + m2
    J_a = J1 + J2 + m1 * c1**2 + m2 * rho**2
    M_v = m0 + 2 * m_w + m_a + 2 * I_s / r**2
    J_w = J0 + m0 * d**2 + 2 * I_d + 2 * m_w * b**2 + 2 * I_s * b**2 / r**2 + m_a * l0**2
    J_12 = J_a + l0 * p * C
    return np.array(
        [
            [M_v, -p * S, -p * S, m2 * C],
            [-p * S, J_w + J_a + 2 * l0 * p * C, J_12, m2 * l0 * S],
            [-p * S, J_12, J_a, 0.0],
            [m2 * C, m2 * l0 * S, 0.0, m2],
        ]
    )


def bias(theta1: float, eta: float, nu: Array) -> Array:
    """Return h (4,); the paper's Re is −h."""
    C, S = np.cos(theta1), np.sin(theta1)
    v, w, theta1_dot, eta_dot = nu
    rho = eta + c2
    p, m_a = m1 * c1 + m2 * rho, m1 + m2
    W = w + theta1_dot
    first = m0 * d + m_a * l0
    return -np.array(
        [
            w**2 * first + p * W**2 * C + 2 * m2 * eta_dot * W * S,
            -v * w * (first + p * C)
            + l0 * p * S * (W**2 - w**2)
            - 2 * m2 * eta_dot * W * (rho + l0 * C),
            -p * (v * w * C + l0 * w**2 * S) - 2 * m2 * rho * eta_dot * W,
            m2 * (rho * W**2 + l0 * w**2 * C - v * w * S),
        ]
    )


def actuation() -> Array:
    """Return B (4, 4) for τ = (τL, τR, τ1, F)."""
    B = np.diag([1.0, 1.0, 1.0, 1.0])
    B[:2, :2] = [[1 / r, 1 / r], [-b / r, b / r]]
    return B
