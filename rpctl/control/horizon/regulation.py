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
from rpctl.control.horizon.qp import BROKEN, MAX_ROUNDS, least_multipliers

STIFFNESS = 1e6  # of the cost of states beyond bounds: .1 rad cost as 15 m/s too much for a step


class Steps(NamedTuple):
    """N steps and their cost."""

    F: Array  # (N, n, n)
    G: Array  # (N, n, m)
    d: Array  # (N, n)
    Q: Array  # (n, n)
    R: Array  # (N, m, m)
    P: Array  # (n, n) after the last


class Box(NamedTuple):
    """Bounds of inputs, which are hard, and of r of the states after each step, which are soft."""

    lower: Array  # (N, m + r)
    upper: Array  # (N, m + r)
    states: Indices  # (r,)


class Regulated(NamedTuple):
    """The best motion from an initial state on.

    Attributes:
        x: (N + 1, n).
        u: (N, m).
        gains: K of each step (N, m, n).
        solved: Whether it is the solution; else no bound is kept.
    """

    x: Array
    u: Array
    gains: Array
    solved: bool = True


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
            F, G, pushed = steps.F[i], steps.G[i], P @ steps.d[i] + p
            PG = P @ G
            self._W[i] = steps.R[i] + G.T @ PG
            _, found, _ = dposv(self._W[i], np.column_stack([PG.T @ F, G.T @ pushed]))
            self._K[i], self._k[i] = K, _ = found[:, :n], -found[:, n]
            self._closed[i] = closed = F - G @ K
            p, P = (
                closed.T @ pushed,
                steps.Q + K.T @ steps.R[i] @ K + closed.T @ P @ closed,
            )  # stays symmetric

    def __call__(self, start: Array, box: Box) -> Regulated:
        """Return the best motion within bounds.

        Args:
            start: Initial state (n,).
            box: What it keeps to; states as far as they can.
        """
        found = free = self._rolled(start, self._k)
        above = excess = self._excess(free, box)
        candidates, shape = np.empty(0, dtype=np.intp), (*free.u.shape, 1)
        rows = self._rows(box) if (excess > BROKEN).any() else excess
        for _ in range(MAX_ROUNDS):
            broken = np.flatnonzero(above > BROKEN)
            if not len(broken):
                return found
            candidates = np.union1d(candidates, broken)
            A = rows[candidates]
            pull = np.linalg.solve(self._W, A.reshape(-1, *shape)).reshape(A.shape)
            curvature = (candidates % box.lower.shape[1] >= shape[1]) / STIFFNESS
            multipliers = least_multipliers(pull @ A.T + np.diag(curvature), -excess[candidates])
            if multipliers is None:
                break
            found = self._rolled(start, self._k - (multipliers @ pull).reshape(free.u.shape))
            above = self._excess(found, box)
            above[candidates] -= curvature * multipliers
        return free._replace(solved=False)

    def _rolled(self, start: Array, pushed: Array) -> Regulated:
        """Return the motion from an initial state on, under k + c (N, m)."""
        x, (_, G, d, *_) = [start], self._steps
        for i, push in enumerate(pushed):
            x.append(self._closed[i] @ x[-1] + G[i] @ push + d[i])
        return Regulated(np.array(x), pushed - np.matvec(self._K, x[:-1]), self._K)

    @staticmethod
    def _excess(motion: Regulated, box: Box) -> Array:
        """Return by how much a motion is below each lower bound, and above each upper one."""
        values = np.hstack([motion.u, motion.x[1:, box.states]])
        return np.concatenate([box.lower - values, values - box.upper]).ravel()

    def _rows(self, box: Box) -> Array:
        """Return the derivatives of what :meth:`_excess` returns by c (rows, N m)."""
        N, n, m = self._steps.G.shape
        x, unit, values = np.zeros((n, N * m)), np.eye(N * m).reshape(N, m, -1), list[Array]()
        for K, closed, G, own in zip(self._K, self._closed, self._steps.G, unit, strict=True):
            u, x = own - K @ x, closed @ x + G @ own
            values += [u, x[box.states]]
        found = np.concatenate(values)
        return np.concatenate([-found, found])
