"""Smooth poses of a base whose axle does not slide: its place and heading are fitted together.

A tangent has no direction where the base stands, turns on the spot or reverses, and the tangent of
noisy rows points anywhere there. So the heading is a spline of its own, and the fit minimises

    Σ |pₖ − p(tₖ)|² + λ ∫ |p'''|² dt + Σ ℓₖ² (θₖ − θ(tₖ))² + λ ℓ² ∫ θ'''² dt + μ Σ (n(θ)·ṗ)²

with n across the heading: the last sum, with a term between every two knots and one at each end,
is of the sideways speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from rpctl.arrays import Array
from rpctl.reference.smoothing import SmoothingProblem
from rpctl.reference.splines import basis_at

SLIDING_WEIGHT = 1e6  # of the sideways speed, relative to that of the low pass: it is a constraint
STEPS = 12  # of Gauss and Newton; from a good start four are enough
STEP_TOLERANCE = 1e-6  # m: a step that moves nothing farther is the last
HALVINGS = 8  # of a step that does not lower the cost


class HeadingRows(NamedTuple):
    """What is known of the heading.

    Attributes:
        angle: At each row (K,), continuous, rad.
        lever: Weight of its residual relative to a position's, m/rad; (K,), 0: not known.
        stiffness: Weight of its third derivative, likewise, m/rad.
    """

    angle: Array
    lever: Array
    stiffness: float


class _Cost(NamedTuple):
    residual: Array
    jacobian: csr_array


def fit_rolling(
    problem: SmoothingProblem, tau: float, start: Array, heading: HeadingRows, fixed: Array
) -> Array:
    """Return the coefficients (m, 3) of a pose spline along which the base hardly slides.

    Args:
        problem: The rows' places (K, 2).
        tau: Time constant, in spacings of the rows.
        start: Coefficients (m, 3) to start from.
        heading: What is known of the heading.
        fixed: Which coefficients (m, 3) stay as they are.
    """
    rows = _RollingRows(problem, tau, heading)
    free, c = np.logical_not(fixed.ravel()), start.copy()
    now = rows.cost(c)
    for _ in range(STEPS):
        jacobian = now.jacobian[:, free]
        system = (jacobian.T @ jacobian).tocsc()
        step = np.zeros(c.size)
        step[free] = -splu(system).solve(jacobian.T @ now.residual)
        for _ in range(HALVINGS):
            tried = rows.cost(c + step.reshape(c.shape))
            if tried.residual @ tried.residual <= now.residual @ now.residual:
                break
            step *= 0.5
        else:
            break
        c, now = c + step.reshape(c.shape), tried
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    return c


class _RollingRows:
    """The residuals of a fit, and their derivatives by the coefficients, x, y, θ in turn."""

    def __init__(self, problem: SmoothingProblem, tau: float, heading: HeadingRows) -> None:
        self._places, self._heading = problem.values, heading
        breaks = problem.breaks
        at = np.concatenate([breaks[:1], 0.5 * (breaks[1:] + breaks[:-1]), breaks[-1:]])
        bend, b = tau**3 * problem.third, problem.at_rows
        lever = diags_array(heading.lever)
        self._linear = csr_array(
            block_array(
                [
                    [_column(b, 0)], [_column(b, 1)], [_column(lever @ b, 2)],
                    [_column(bend, 0)], [_column(bend, 1)], [_column(heading.stiffness * bend, 2)],
                ]
            )
        )  # fmt: skip
        places = [*problem.values.T, heading.lever * heading.angle]
        self._target = np.concatenate([*places, np.zeros(3 * bend.shape[0])])
        self._value, self._rate = (basis_at(problem.knots, at, order) for order in (0, 1))
        width = np.sqrt(np.gradient(at))
        self._weight = math.sqrt(SLIDING_WEIGHT) * max(tau, 1.0) * width

    def cost(self, c: Array) -> _Cost:
        """Return the residual of coefficients (m, 3) and its derivatives."""
        (x, y), theta = (self._rate @ c[:, :2]).T, self._value @ c[:, 2]
        cos, sin, w = np.cos(theta), np.sin(theta), self._weight
        sliding = (
            _column(diags_array(-w * sin) @ self._rate, 0)
            + _column(diags_array(w * cos) @ self._rate, 1)
            + _column(diags_array(-w * (x * cos + y * sin)) @ self._value, 2)
        )
        residual = np.concatenate(
            [self._linear @ c.ravel() - self._target, w * (y * cos - x * sin)]
        )
        return _Cost(residual, csr_array(block_array([[self._linear], [sliding]])))


def _column(matrix: csr_array, column: int) -> csr_array:
    """Return the derivatives by coefficients of one column as those by all, row by row."""
    found = matrix.tocoo()
    shape = found.shape[0], 3 * found.shape[1]
    return csr_array((found.data, (found.row, 3 * found.col + column)), shape=shape)
