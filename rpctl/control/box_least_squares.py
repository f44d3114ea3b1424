"""Least squares within bounds, with a bounded multiplier, and its time derivative."""

from __future__ import annotations

import math
from typing import NamedTuple

import daqp
import numpy as np
from scipy.optimize import brentq

from rpctl.arrays import Array
from rpctl.errors import SolverError

MIN_KAPPA = 1e-6  # of κ: small enough for rows to be met, large enough for 1/κ to keep its digits
LOG_KAPPA_TOLERANCE = 1e-12  # of log κ
DAQP_INFINITY = 1e30  # what DAQP takes for no bound
DAQP_OPTIMAL = 1  # DAQP's flag of an optimum


class WithRate(NamedTuple):
    """A quantity and its derivative by time."""

    value: Array
    rate: Array


class Box(NamedTuple):
    """Bounds, with their derivatives."""

    lower: WithRate
    upper: WithRate


class _Problem(NamedTuple):
    G: WithRate  # (m, n)
    y: WithRate  # (m,)
    posture: WithRate  # (n,)
    box: Box


class _Solution(NamedTuple):
    z: Array  # (n,)
    pull: Array  # (m,): what the rows pull with; z = posture + Gᵀ pull where no bound holds
    lower: Array  # (n,) bool: held by the lower bound
    upper: Array  # (n,) bool


def nearest(G: WithRate, y: WithRate, posture: WithRate, box: Box, strongest: float) -> WithRate:
    """Return the z (n,) in a box that has G z = y as nearly as it can, and is near a posture.

    It minimises ½ |z − posture|² + P(|G z − y|) over the box. P has the slope ``strongest``, down
    to next to nothing where it is rounded off. Such a penalty is exact: G z = y is met as long as
    the pull it takes, the multiplier of G z = y, is no longer than ``strongest``. Where it would
    be, near a singular G or in a corner of the box, the pull is ``strongest`` long and z is that of
    damped least squares, P = ½ |G z − y|²/κ with the κ that makes it so. So z never strays from the
    posture by more than ``strongest`` times what it moves.

    The derivative holds the bounds that are active, which is the derivative wherever none of them
    is just being met or left; there it jumps, but z does not.

    Args:
        G: Matrix (m, n).
        y: What G z should be (m,).
        posture: What z should be (n,) as far as G z = y leaves it open.
        box: Bounds of z (n,).
        strongest: Longest pull.

    Raises:
        SolverError: The quadratic program was not solved.
    """
    problem = _Problem(G, y, posture, box)
    kappa = MIN_KAPPA
    solution = _solve(problem, kappa)
    length = float(np.linalg.norm(solution.pull))
    bounded = length > strongest
    if bounded:
        # |pull| falls as κ grows, and κ |pull| = |G z − y| does not: so the root is between.
        kappa = math.exp(
            brentq(
                lambda x: math.log(np.linalg.norm(_solve(problem, math.exp(x)).pull) / strongest),
                math.log(MIN_KAPPA),
                math.log(_farthest(problem) / strongest) + 1.0,
                xtol=LOG_KAPPA_TOLERANCE,
            )
        )
        solution = _solve(problem, kappa)
    return WithRate(solution.z, _rate(problem, solution, kappa, bounded))


def _farthest(problem: _Problem) -> float:
    """Return |G z − y| where nothing pulls."""
    lower, upper = problem.box
    z = np.clip(problem.posture.value, lower.value, upper.value)
    return float(np.linalg.norm(problem.G.value @ z - problem.y.value))


def _solve(problem: _Problem, kappa: float) -> _Solution:
    """Minimise ½ |z − posture|² + ½ |G z − y|²/κ over the box."""
    G, y, posture = (part.value for part in problem[:3])
    lower, upper = (bound.value for bound in problem.box)
    none = np.zeros(len(posture), dtype=bool)
    z, pull = _held(G, y, posture, none, kappa)
    if (z >= lower).all() and (z <= upper).all():
        return _Solution(z, pull, none, none)
    _, _, flag, info = daqp.solve(
        np.eye(len(z)) + G.T @ G / kappa,
        G.T @ (G @ posture - y) / kappa,
        np.empty((0, len(z))),
        np.clip(upper - posture, -DAQP_INFINITY, DAQP_INFINITY),
        np.clip(lower - posture, -DAQP_INFINITY, DAQP_INFINITY),
        np.zeros(len(z), dtype=np.intc),
    )
    if flag != DAQP_OPTIMAL:
        raise SolverError(
            f"no rates of the arm were found (DAQP ended with flag {flag}); shorten the control "
            "period or lengthen the horizons"
        )
    at_lower, at_upper = info["lam"] < 0.0, info["lam"] > 0.0
    start = np.where(at_upper, upper, np.where(at_lower, lower, posture))
    z, pull = _held(G, y, start, np.logical_or(at_lower, at_upper), kappa)
    return _Solution(np.clip(z, lower, upper), pull, at_lower, at_upper)


def _held(G: Array, y: Array, start: Array, held: Array, kappa: float) -> tuple[Array, Array]:
    """Return the minimum with entries held where they start, and the pull: start + Fᵀ pull.

    F is G without the columns that are held, and (F Fᵀ + κ) pull = y − G start.
    """
    F = np.where(held, 0.0, G)
    pull = np.linalg.solve(F @ F.T + kappa * np.eye(len(y)), y - G @ start)
    return start + F.T @ pull, np.asarray(pull)


def _rate(problem: _Problem, solution: _Solution, kappa: float, bounded: bool) -> Array:
    """Return ż (n,), the active bounds held; where the pull is bounded, so is its length."""
    (G, G_rate), (_, y_rate), posture, (lower, upper) = problem
    pull, held = solution.pull, np.logical_or(solution.lower, solution.upper)
    start, start_rate = (
        np.where(solution.upper, high, np.where(solution.lower, low, middle))
        for low, middle, high in zip(lower, posture, upper, strict=True)
    )
    F, F_rate = np.where(held, 0.0, G), np.where(held, 0.0, G_rate)
    half = F_rate @ F.T
    right = y_rate - G_rate @ start - G @ start_rate - (half + half.T) @ pull
    N = F @ F.T + kappa * np.eye(len(pull))
    pull_rate, along = np.linalg.solve(N, np.column_stack([right, pull])).T
    if bounded:
        pull_rate = pull_rate - along * (pull @ pull_rate) / (pull @ along)  # κ̇ keeps |pull|
    return np.asarray(start_rate + F_rate.T @ pull + F.T @ pull_rate)
