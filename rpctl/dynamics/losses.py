"""The speeds that losses leave: one implicit step of damping and friction alone."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.losses import Losses

CONVERGED = 1e-9  # of the largest rate: the error after a correction that small is its square
NEWTON_STEPS = 25  # tried before only the sure ones are; from rest or from sliding it takes 1 to 4
SURE_STEPS = 500
OVERSHOOT = 0.5  # of the slope along a Newton step at its start: more at its end is too far


def braked(losses: Losses, M: Array, S: Array, nu: Array, weight: float, guess: Array) -> Array:
    """Return the ν (dof,) that M (ν − ν₀) = w ℓ(ν), ℓ(ν) = Sᵀ force(S ν), leaves of ν₀.

    It is the one minimum of the strictly convex ½ |ν − ν₀|²_M + w Σ potential(S ν). Newton's steps
    find it in a few; a step that crosses the bend of the friction law goes too far, and one with
    the curvature f/√(q̇² + ε²) is taken instead, which never does (it minimises a parabola that lies
    above the potential).

    Args:
        losses: The losses.
        M: Reduced inertia (dof, dof).
        S: Basis (nv, dof).
        nu: ν₀ (dof,).
        weight: w, s.
        guess: Where to start (dof,).

    Raises:
        RpctlError: M is not positive definite, or a number is not finite.
    """
    found, v = guess, S.dot(guess)
    gradient = M.dot(found - nu) - weight * S.T.dot(losses.force(v))
    for attempt in range(NEWTON_STEPS + SURE_STEPS):
        step = solve_positive(M + S.T.dot((weight * losses.slope(v))[:, None] * S), -gradient)
        ahead = found + step
        v_ahead = S.dot(ahead)
        gradient_ahead = M.dot(ahead - nu) - weight * S.T.dot(losses.force(v_ahead))
        bound = OVERSHOOT * abs(float(gradient.dot(step)))
        small = np.abs(v_ahead - v).max() <= CONVERGED * (losses.rate.min() + np.abs(v).max())
        if not small and (attempt >= NEWTON_STEPS or abs(float(gradient_ahead.dot(step))) > bound):
            step = solve_positive(M + S.T.dot((weight * losses.secant(v))[:, None] * S), -gradient)
            ahead = found + step
            v_ahead = S.dot(ahead)
            gradient_ahead = M.dot(ahead - nu) - weight * S.T.dot(losses.force(v_ahead))
        if small:
            return np.asarray(ahead)
        found, v, gradient = ahead, v_ahead, gradient_ahead
    raise RpctlError("the friction in the joints determines no speeds; its numbers are not finite")


def solve_positive(H: Array, force: Array) -> Array:
    """Return H⁻¹ force (dof,).

    Raises:
        RpctlError: H is not positive definite.
    """
    _, found, info = dposv(H, force)
    if info:
        raise RpctlError("the reduced inertia is not positive definite")
    return np.asarray(found)
