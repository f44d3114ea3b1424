"""The horizon law's quadratic program of robots that lean: a regulator, and what bounds change.

Over N steps ξ₊ = F ξ + G u + d the least of Σ ½(ξᵀQ ξ + uᵀR u) + ½ ξ_Nᵀ P ξ_N is u = −K ξ + k, by
Riccati's recursion from the last step back. What is left to a program are the c of

    u = −K ξ + k + c,   at a cost of ½ cᵀW c,   W = R + GᵀP₊ G,

which are 0 unless a bound binds: its Hessian is one block a step, and what moves with c is stable
where the robot is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices
from rpctl.control.horizon.qp import BROKEN, MAX_ROUNDS, SLACK_CURVATURE, least_multipliers


class Steps(NamedTuple):
    """N steps and their cost."""

    F: Array  # (N, n, n)
    G: Array  # (N, n, m)
    d: Array  # (N, n)
    Q: Array  # (n, n)
    R: Array  # (N, m, m)
    P: Array  # (n, n) after the last


class Box(NamedTuple):
    """Hard bounds of inputs, and soft ones of some states, after each step."""

    inputs: tuple[Array, Array]  # lower and upper (N, m)
    states: tuple[Array, Array]  # lower and upper (N, r)
    which: Indices  # (r,) states that have bounds


class Regulated(NamedTuple):
    """The best motion from an initial state on.

    Attributes:
        x: (N + 1, n).
        u: (N, m).
        gain: K of the first step (m, n).
        solved: Whether it is the solution; else no bound is kept.
        slack: The largest, of a state.
    """

    x: Array
    u: Array
    gain: Array
    solved: bool = True
    slack: float = 0.0


class Regulator:
    """Riccati's recursion along some steps.

    Args:
        steps: The steps.
    """

    def __init__(self, steps: Steps) -> None:
        self._steps, (N, n, m) = steps, steps.G.shape
        self._K, self._k, self._W = np.empty((N, m, n)), np.empty((N, m)), np.empty((N, m, m))
        self._closed = np.empty((N, n, n))  # F − G K
        P, p = steps.P, np.zeros(n)
        for i in reversed(range(N)):
            F, G, d = steps.F[i], steps.G[i], steps.d[i]
            PG, pushed = P @ G, P @ d + p
            self._W[i] = W = steps.R[i] + G.T @ PG
            _, found, _ = dposv(W, np.column_stack([PG.T @ F, G.T @ pushed]))
            self._K[i], self._k[i] = found[:, :n], -found[:, n]
            self._closed[i] = closed = F - G @ found[:, :n]
            P = steps.Q + F.T @ (P @ closed)
            P, p = 0.5 * (P + P.T), closed.T @ pushed

    def __call__(self, start: Array, box: Box) -> Regulated:
        """Return the best motion within box.

        Args:
            start: Initial state (n,).
            box: What it keeps to; states as far as they can.
        """
        free = self._rolled(start)
        excess = self._excess(free, box)
        if not (excess > BROKEN).any():
            return free
        rows, hard = self._rows(box), 2 * free.u.size
        inverse, above = np.linalg.inv(self._W), excess
        candidates = np.empty(0, dtype=np.intp)
        for _ in range(MAX_ROUNDS):
            candidates = np.union1d(candidates, np.flatnonzero(above > BROKEN))
            A, soft = rows[candidates], np.flatnonzero(candidates >= hard)
            blocks = A.reshape(len(A), *free.u.shape)[..., None]
            pull = (inverse @ blocks)[..., 0].reshape(A.shape)
            D = pull @ A.T
            D[soft, soft] += 1.0 / SLACK_CURVATURE
            multipliers = least_multipliers(D, -excess[candidates])
            if multipliers is None:
                return free._replace(solved=False)
            c = -(multipliers @ pull)
            above = excess + rows @ c
            slack = multipliers[soft] / SLACK_CURVATURE
            above[candidates[soft]] -= slack
            if not (above > BROKEN).any():
                found = self._rolled(start, c.reshape(free.u.shape))
                return found._replace(slack=float(slack.max(initial=0.0)))
        return free._replace(solved=False)

    def _rolled(self, start: Array, c: Array | None = None) -> Regulated:
        """Return the motion from an initial state on, under c (N, m)."""
        G, d, k = self._steps.G, self._steps.d, self._k if c is None else self._k + c
        x = np.empty((len(k) + 1, len(start)))
        x[0] = start
        for i in range(len(k)):
            x[i + 1] = self._closed[i] @ x[i] + G[i] @ k[i] + d[i]
        return Regulated(x, k - np.matvec(self._K, x[:-1]), self._K[0])

    @staticmethod
    def _excess(motion: Regulated, box: Box) -> Array:
        """Return by how much a motion exceeds each bound: of inputs, then of states."""
        sides = []
        for values, limits in ((motion.u, box.inputs),
                               (motion.x[1:, box.which], box.states)):  # fmt: skip
            lower, upper = limits
            sides += [lower - values, values - upper]
        return np.concatenate([side.ravel() for side in sides])

    def _rows(self, box: Box) -> Array:
        """Return the derivatives of all bounds by c (rows, N m)."""
        N, n, m = self._steps.G.shape
        x, unit = np.zeros((n, N * m)), np.eye(N * m)
        inputs, states = np.empty((N, m, N * m)), np.empty((N, len(box.which), N * m))
        for i in range(N):
            own = slice(i * m, (i + 1) * m)
            inputs[i] = unit[own] - self._K[i] @ x
            x = self._closed[i] @ x
            x[:, own] += self._steps.G[i]
            states[i] = x[box.which]
        parts = (-inputs, inputs, -states, states)
        return np.concatenate([part.reshape(-1, N * m) for part in parts])
