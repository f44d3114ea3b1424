"""The quintic splines of which references are made: their fourth derivative is continuous."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse import csr_array, diags_array

from rpctl.arrays import Array

DEGREE = 5


class Curves:
    """A spline of a path parameter s, with its first two derivatives."""

    def __init__(self, spline: BSpline) -> None:
        self._orders = spline, spline.derivative(1), spline.derivative(2)

    def __call__(self, s: float | Array) -> tuple[Array, Array, Array]:
        """Return values, and first and second derivatives by s, (n,) or (K, n) each."""
        value, slope, bend = (order(s) for order in self._orders)
        return value, slope, bend


def quintic(knots: Array, coefficients: Array) -> BSpline:
    """Return the spline with coefficients (m, ...) over knots (m + 6,)."""
    return BSpline(knots, coefficients, DEGREE)


def basis(knots: Array) -> BSpline:
    """Return the m basis functions over knots (m + 6,), as one spline with values (m,)."""
    return quintic(knots, np.eye(len(knots) - DEGREE - 1))


def basis_at(knots: Array, points: Array, order: int) -> csr_array:
    """Return the m basis functions, or a derivative of them, at points: (N, m), six in a row.

    Args:
        knots: (m + 6,), clamped.
        points: (N,), between the outer knots.
        order: Of the derivative; 0 for the functions.
    """
    to_derivative = diags_array(np.ones(len(knots) - DEGREE - 1))
    for degree in range(DEGREE, DEGREE - order, -1):
        # The derivative's coefficients are differences of the spline's: de Boor, 1978, ch. X.
        width = knots[degree + 1 : -1] - knots[1 : -degree - 1]
        rate = degree / width
        shape = len(rate), len(rate) + 1
        to_derivative = diags_array([-rate, rate], offsets=[0, 1], shape=shape) @ to_derivative
        knots = knots[1:-1]
    functions = BSpline.design_matrix(points, knots, DEGREE - order)
    return csr_array(csr_array(functions) @ to_derivative)


def through(t: Array, values: Array, ends: Any = None) -> BSpline:
    """Return the spline through points.

    Args:
        values: Values there (K, n).
        ends: Derivatives at both ends, as ``bc_type`` of SciPy's ``make_interp_spline``; None
            takes the knots from the parameters alone.
    """
    return make_interp_spline(t, values, k=DEGREE, bc_type=ends)


def clamped_knots(points: Array) -> Array:
    """Return the knots (K + 10,) of a spline that begins and ends at the outer points (K,)."""
    return np.concatenate([np.full(DEGREE, points[0]), points, np.full(DEGREE, points[-1])])


def uniform_knots(count: int) -> Array:
    """Return the knots (count + 6,) of ``count`` coefficients, 1 apart; the spline begins at 0."""
    return np.arange(count + DEGREE + 1.0) - DEGREE
