"""The paper robot's closed form in SymPy, as the design writes it ([MS21, Eq. 5])."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from tests import closed_form

theta1, eta = sp.symbols("theta1 eta1", real=True)
v, w, theta1_dot, eta_dot = sp.symbols("v omega theta1_dot eta1_dot", real=True)
C, S, Omega, rho, p, J_a = sp.symbols("C S Omega rho p J_a", real=True)

NAMES = ("m0", "J0", "d", "m_w", "I_s", "I_d", "b", "r", "l0", "m1", "J1", "c1", "m2", "J2", "c2")
PARAMETERS: dict[str, Any] = {name: sp.Symbol(f"{name}_", real=True) for name in NAMES}
NUMBERS: dict[str, Any] = {name: sp.Rational(repr(getattr(closed_form, name))) for name in NAMES}


@dataclass(frozen=True)
class Form:
    """M's upper triangle row by row, −h, and the names in them, each in terms of those before."""

    M: list[sp.Expr]
    minus_h: list[sp.Expr]
    definitions: list[tuple[sp.Symbol, sp.Expr]]

    def operations(self) -> int:
        parts = [*self.M, *self.minus_h, *(value for _, value in self.definitions)]
        return sum(int(sp.count_ops(part)) for part in parts)

    def expanded(self) -> tuple[sp.Matrix, sp.Matrix]:
        upper = iter(self.M)
        M = sp.zeros(4, 4)
        for i in range(4):
            for j in range(i, 4):
                M[i, j] = M[j, i] = next(upper)
        h = -sp.Matrix(self.minus_h)
        for symbol, value in reversed(self.definitions):
            M, h = M.subs(symbol, value), h.subs(symbol, value)
        return M, h


def design(values: dict[str, Any]) -> Form:
    """Return the design's form with numbers or symbols for the robot's parameters."""
    m0, J0, d, m_w, I_s, I_d, b, r, l0, m1, J1, c1, m2, J2, c2 = (values[x] for x in NAMES)
    m_a = m1 + m2
    M_v = m0 + 2 * m_w + m_a + 2 * I_s / r**2
    J_w = J0 + m0 * d**2 + 2 * I_d + 2 * m_w * b**2 + 2 * I_s * b**2 / r**2 + m_a * l0**2
    first = m0 * d + m_a * l0
    M = [M_v, -p * S, -p * S, m2 * C, J_w + J_a + 2 * l0 * p * C, J_a + l0 * p * C, m2 * l0 * S]
    M += [J_a, sp.Integer(0), m2]
    minus_h = [
        w**2 * first + p * Omega**2 * C + 2 * m2 * eta_dot * Omega * S,
        -v * w * (first + p * C)
        + l0 * p * S * (Omega**2 - w**2)
        - 2 * m2 * eta_dot * Omega * (rho + l0 * C),
        -p * (v * w * C + l0 * w**2 * S) - 2 * m2 * rho * eta_dot * Omega,
        m2 * (rho * Omega**2 + l0 * w**2 * C - v * w * S),
    ]
    definitions = [
        (C, sp.cos(theta1)),
        (S, sp.sin(theta1)),
        (Omega, w + theta1_dot),
        (rho, eta + c2),
        (p, m1 * c1 + m2 * rho),
        (J_a, J1 + J2 + m1 * c1**2 + m2 * rho**2),
    ]
    return Form(M, minus_h, definitions)
