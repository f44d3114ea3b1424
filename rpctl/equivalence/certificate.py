"""The rows of a certificate: what was compared with what, how closely it agrees, where it is worst.

A limit is a constant for robots of ordinary numbers. Where the products that a quantity is summed
from are far larger than the quantity (a wheel 25 m from P, an inertia taken about a far origin),
rounding of float64 grows with the products: :func:`allowed` then gives that much, and no more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array

CONTACT_ORACLE = "MuJoCo, rolling on a plane"  # what the contact trial compares with
EPS = float(np.finfo(float).eps)
EXACT_TOLERANCE = 1e-12  # float64 rounding over a tree of tens of links, with two decades to spare
ROUNDINGS = 30.0  # of EPS times the products summed: three sums (tree, S, Sᵀ) of some ten terms
DIFFERENCE_TOLERANCE = (
    1e-6  # central differences: truncation against rounding, with decades to spare
)
DIFFERENCE_STEP = 1e-3  # rad; near the fifth root of EPS, where a rule of order 4 is best


@dataclass(frozen=True)
class Check:
    """One comparison and its worst case.

    Attributes:
        name: What is compared.
        against: With what.
        residual: Largest deviation over all samples, relative; infinite if one was no number.
        limit: Largest deviation allowed.
        sample: Index of the random state where it occurred.
        entry: Entry where it occurred, by the names of coordinates.
        note: What else there is to say.
    """

    name: str
    against: str
    residual: float
    limit: float
    sample: int = 0
    entry: str = ""
    note: str = ""

    @property
    def passed(self) -> bool:
        """Whether the residual is a number within the limit."""
        return bool(self.residual <= self.limit)

    @property
    def limit_ratio(self) -> float:
        """Residual over limit."""
        return self.residual / self.limit

    def to_dict(self) -> dict[str, Any]:
        """Return the row as plain values for JSON; an infinite residual is None."""
        residual = self.residual if math.isfinite(self.residual) else None
        return {**asdict(self), "residual": residual, "passed": self.passed}


@dataclass(frozen=True)
class Skipped:
    """A comparison that was not made, and why: it neither passed nor failed."""

    name: str
    against: str
    note: str


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
    products: float = 0.0,
) -> Check:
    """Compare two arrays relative to the largest entry, to rounding.

    Args:
        truth: The same array by the other derivation.
        names: Names of the entries along each axis.
    """
    scale = float(np.abs(truth).max()) if truth.size else 0.0
    bound = allowed(EXACT_TOLERANCE, products, scale)
    return worst(name, against, (value - truth) / (scale or 1.0), bound, names)


def worst(
    name: str,
    against: str,
    gap: NDArray[np.floating[Any]],
    limit: float,
    *names: Sequence[str],
) -> Check:
    """Return the largest deviation of an array and its entry; NaN counts as infinite.

    Args:
        gap: Deviations, relative.
        limit: Largest deviation allowed.
        names: Names of the entries along each axis; the last along all that follow, too.
    """
    if not gap.size:
        return Check(name, against, 0.0, limit)
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    index = np.unravel_index(int(np.argmax(size)), size.shape)
    labels = []
    for axis, i in enumerate(index):
        known = names[min(axis, len(names) - 1)]
        labels.append(known[int(i)] if i < len(known) else str(i))
    return Check(name, against, float(size[index]), limit, entry=", ".join(labels))


def worst_cases(samples: Iterable[tuple[int, Iterable[Check]]]) -> Iterator[Check]:
    """Yield every row of some samples, each with its number, at its worst one."""
    found: dict[tuple[str, str], Check] = {}
    for sample, rows in samples:
        for row in rows:
            known = found.get((row.name, row.against))
            if known is None or row.limit_ratio > known.limit_ratio:
                found[row.name, row.against] = replace(row, sample=sample)
    yield from found.values()


def rate(function: Callable[[float], Array], step: float) -> Array:
    """Return the derivative at 0 of a function of time (s), by central differences of order 4."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def difference_step(v: Array) -> float:
    """Return the step (s) of a difference along v: no chain of joints turns by more than
    DIFFERENCE_STEP in it."""
    return DIFFERENCE_STEP / max(1.0, float(np.abs(v).sum()))
