"""Lagrange's equations under d'Alembert's principle, from a kinetic and a potential energy.

Nothing of rpctl takes part. With coordinates x, velocities ẋ = S(x) ν that the constraints admit,
T = ½ ẋᵀ M(x) ẋ and V(x), virtual displacements S δ leave ([B15] Bloch, Nonholonomic Mechanics and
Control, 2nd ed., Springer 2015, chapter 5):

    Sᵀ (M S ν̇ + M Ṡ ν + Ṁ ẋ − ∂T/∂x + ∂V/∂x) = Sᵀ Q τ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

from rpctl.arrays import Array

INTEGRATION_TOLERANCE = 1e-12  # relative and absolute tolerance of the integration


@dataclass(frozen=True)
class Textbook:
    """M(x) ν̇ + h(x, ν) = B(x) τ and ẋ = S(x) ν, as functions of numbers."""

    terms: Callable[[Array, Array], tuple[Array, Array, Array, Array]]  # M, h, B, S
    nx: int

    def forward(self, x: Array, nu: Array, tau: Array) -> Array:
        """Return ν̇."""
        M, h, B, _ = self.terms(x, nu)
        return np.asarray(np.linalg.solve(M, B @ tau - h))

    def efforts(self, x: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the shortest τ that gives ν̇."""
        M, h, B, _ = self.terms(x, nu)
        return np.asarray(np.linalg.pinv(B) @ (M @ nu_dot + h))

    def motion(self, x: Array, nu: Array, tau: Array, duration: float) -> tuple[Array, Array]:
        """Return x and ν after a time (s) under constant τ."""

        def state_rate(_: float, state: Array) -> Array:
            at, speed = state[: self.nx], state[self.nx :]
            return np.append(self.terms(at, speed)[3] @ speed, self.forward(at, speed, tau))

        start = np.append(x, nu)
        found = solve_ivp(
            state_rate,
            (0.0, duration),
            start,
            "DOP853",
            rtol=INTEGRATION_TOLERANCE,
            atol=INTEGRATION_TOLERANCE,
        )
        assert found.success
        return found.y[: self.nx, -1], found.y[self.nx :, -1]


def derive(
    coordinates: Sequence[sp.Symbol],
    rates: Sequence[sp.Symbol],
    speeds: Sequence[sp.Symbol],
    kinetic: sp.Expr,
    potential: sp.Expr,
    S: sp.Matrix,
    Q: sp.Matrix,
) -> Textbook:
    """Return the equations in ``speeds`` ν from T(x, ẋ), V(x), S(x) and Q(x)."""
    x, xd, nu = sp.Matrix(coordinates), sp.Matrix(rates), sp.Matrix(speeds)
    momentum = sp.Matrix([kinetic]).jacobian(xd).T
    M = momentum.jacobian(xd)
    force = momentum.jacobian(x) * xd - sp.Matrix([kinetic - potential]).jacobian(x).T
    admitted = S * nu
    S_dot_nu = admitted.jacobian(x) * admitted
    force = force.subs(dict(zip(xd, admitted, strict=True)), simultaneous=True)
    reduced = (S.T * M * S, S.T * (M * S_dot_nu + force), S.T * Q, S)
    compiled = sp.lambdify([list(x), list(nu)], reduced, cse=True)

    def terms(at: Array, speed: Array) -> tuple[Array, Array, Array, Array]:
        M, h, B, rows = (np.array(each, dtype=float) for each in compiled(at, speed))
        return M, h.ravel(), B, rows

    return Textbook(terms, len(coordinates))
