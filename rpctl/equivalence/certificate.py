"""``Certificate``: what was compared with what, how closely it agrees, and where it is worst."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


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
    def share(self) -> float:
        """Residual over limit."""
        return self.residual / self.limit


@dataclass(frozen=True)
class Skipped:
    """A comparison that was not made, and why: it neither passed nor failed."""

    name: str
    against: str
    note: str


@dataclass(frozen=True)
class Certificate:
    """The outcome of :func:`rpctl.verify`: all checks of one robot.

    ``estimated_links`` are those whose mass and inertia are estimates: the equations are right
    for them, they need not be right for the robot. ``idealised`` says in sentences what the model
    leaves out of the file, or takes for simpler, which no comparison here can tell.
    """

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]
    skipped: tuple[Skipped, ...] = ()
    estimated_links: tuple[str, ...] = ()
    idealised: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every comparison that was made passed."""
        return all(check.passed for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its limit, or furthest beyond it."""
        return max(self.checks, key=lambda check: check.share)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for JSON; an infinite residual is None."""
        checks = []
        for check in self.checks:
            residual = check.residual if math.isfinite(check.residual) else None
            checks.append({**asdict(check), "residual": residual, "passed": check.passed})
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "checks": checks,
            "skipped": [asdict(each) for each in self.skipped],
            "estimated_links": list(self.estimated_links),
            "idealised": list(self.idealised),
        }
