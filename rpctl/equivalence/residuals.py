"""How two results are measured against each other, and what rounding alone may do to them.

A limit is a constant for robots of ordinary numbers. Where the products that a quantity is summed
from are far larger than the quantity (a wheel 25 m from P, an inertia taken about a far origin),
rounding of float64 grows with the products: :func:`allowed` then gives that much, and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.equivalence.row import Check

EPS = float(np.finfo(float).eps)
EXACT_TOLERANCE = 1e-12  # float64 rounding over a tree of tens of links, with two decades to spare
ROUNDINGS = 30.0  # of EPS times the products summed: three sums (tree, S, Sᵀ) of some ten terms
DIFFERENCE_TOLERANCE = (
    1e-6  # central differences: truncation against rounding, with decades to spare
)
DIFFERENCE_STEP = 1e-3  # rad; near the fifth root of EPS, where a rule of order 4 is best


def allowed(limit: float, products: float, size: float) -> float:
    """Return the limit of a residual: the constant, or what rounding of the products makes.

    Args:
        limit: Limit for a quantity that no larger products cancel to.
        products: Size of the products that the compared quantity is summed from.
        size: What the residual is relative to, in the same unit.
    """
    return max(limit, ROUNDINGS * EPS * products / size) if size > 0.0 else limit


def relative(
    name: str,
    against: str,
    value: Array,
    truth: Array,
    names: Sequence[str],
    limit: float = EXACT_TOLERANCE,
    products: float = 0.0,
) -> Check:
    """Compare two arrays relative to the largest entry.

    Args:
        name: What is compared.
        against: With what.
        value: The array under proof.
        truth: The same array by the other derivation.
        names: Names of the entries along each axis.
        limit: Largest deviation allowed, relative to the largest entry of ``truth``.
        products: As in :func:`allowed`.
    """
    scale = float(np.abs(truth).max()) if truth.size else 0.0
    bound = allowed(limit, products, scale)
    return worst(name, against, (value - truth) / (scale or 1.0), bound, names)


def worst(
    name: str,
    against: str,
    gap: NDArray[np.floating[Any]],
    limit: float,
    names: Sequence[str],
) -> Check:
    """Return the largest deviation of an array and its entry; NaN counts as infinite.

    Args:
        name: What is compared.
        against: With what.
        gap: Deviations, relative.
        limit: Largest deviation allowed.
        names: Names of the entries along each axis.
    """
    if not gap.size:
        return Check(name, against, 0.0, limit)
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    index = np.unravel_index(int(np.argmax(size)), size.shape)
    labels = [names[int(i)] if i < len(names) else str(i) for i in index]
    return Check(name, against, float(size[index]), limit, entry=", ".join(labels))


def rate(function: Callable[[float], Array], step: float) -> Array:
    """Return the derivative at 0 of a function of time (s), by central differences of order 4."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def difference_step(v: Array) -> float:
    """Return the step (s) of a difference along v: no chain of joints turns by more than
    DIFFERENCE_STEP in it."""
    return DIFFERENCE_STEP / max(1.0, float(np.abs(v).sum()))
