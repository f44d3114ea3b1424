"""``Certificate``: what was compared with what, how closely it agrees, and where it is worst.

A limit is a constant for robots of ordinary numbers. Where the products that a quantity is summed
from are far larger than the quantity (a wheel 25 m from P, an inertia taken about a far origin),
rounding of float64 grows with the products: :func:`allowed` then gives that much, and no more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array

if TYPE_CHECKING:
    from rpctl.equivalence.contact.trial import ContactTrial
    from rpctl.equivalence.onset.trial import OnsetTrial

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


def rate(function: Callable[[float], Array], step: float) -> Array:
    """Return the derivative at 0 of a function of time (s), by central differences of order 4."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def difference_step(v: Array) -> float:
    """Return the step (s) of a difference along v: no chain of joints turns by more than
    DIFFERENCE_STEP in it."""
    return DIFFERENCE_STEP / max(1.0, float(np.abs(v).sum()))


@dataclass(frozen=True)
class Certificate:
    """The outcome of :func:`rpctl.verify`: all checks of one robot.

    Attributes:
        robot: Its name.
        samples: Number of random states.
        seed: Their seed.
        checks: The comparisons; each with its worst state.
        skipped: Comparisons that were not made.
        estimated_links: Links whose mass and inertia are estimates: the equations are right for
            them, they need not be right for the robot.
        declared: How far the user's own numbers are from the file's shapes; neither passed nor
            failed.
        shared: What no derivation found for itself, in phrases.
        idealised: What the model leaves out of the file, or takes for simpler, in sentences; no
            comparison here can tell.
        contact: The trial on the ground, where it was asked for and could be made.
        onset: The trial of slip and tipping predictions, where it was asked for and could be made.
        loaded_with: The arguments with which :func:`rpctl.load` gives this robot.
    """

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]
    skipped: tuple[Skipped, ...] = ()
    estimated_links: tuple[str, ...] = ()
    declared: tuple[Check, ...] = ()
    shared: tuple[str, ...] = ()
    idealised: tuple[str, ...] = ()
    contact: ContactTrial | None = None
    onset: OnsetTrial | None = None
    loaded_with: Mapping[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every comparison that was made passed."""
        trials = [trial for trial in (self.contact, self.onset) if trial is not None]
        return all(trial.passed for trial in trials) and all(check.passed for check in self.checks)

    def strict(self) -> Certificate:
        """Return it with the declared numbers among the checks: they fail where shapes differ."""
        return replace(self, checks=(*self.checks, *self.declared), declared=())

    @property
    def notes(self) -> list[tuple[str, str]]:
        """What else there is to say, each with the name of the other side."""
        remarks = [(c.against, c.note) for c in (*self.checks, *self.declared) if c.note]
        if self.contact is not None:
            remarks += [(CONTACT_ORACLE, note) for note in self.contact.notes]
        return remarks

    @property
    def worst(self) -> Check:
        """The check nearest to its limit, or furthest beyond it."""
        return max(self.checks, key=lambda check: check.limit_ratio)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for JSON; an infinite residual is None."""
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "checks": [check.to_dict() for check in self.checks],
            "skipped": [asdict(each) for each in self.skipped],
            "estimated_links": list(self.estimated_links),
            "declared": [check.to_dict() for check in self.declared],
            "shared": list(self.shared),
            "idealised": list(self.idealised),
            "contact": None if self.contact is None else self.contact.to_dict(),
            "onset": None if self.onset is None else self.onset.to_dict(),
            "loaded_with": dict(self.loaded_with),
        }
