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
        residual: Largest deviation over all samples, relative; NaN where nothing was compared.
        limit: Largest deviation allowed.
        sample: Index of the random state where it occurred.
        entry: Entry where it occurred, by the names of coordinates.
        note: Why nothing was compared, or what else there is to say.
    """

    name: str
    against: str
    residual: float
    limit: float
    sample: int = 0
    entry: str = ""
    note: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the residual is within the limit; None where nothing was compared."""
        return None if math.isnan(self.residual) else self.residual <= self.limit

    @property
    def share(self) -> float:
        """Residual over limit; below everything where nothing was compared."""
        return -1.0 if math.isnan(self.residual) else self.residual / self.limit


@dataclass(frozen=True)
class Certificate:
    """The outcome of :func:`rpctl.verify`: all checks of one robot."""

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every comparison that was made passed."""
        return all(check.passed is not False for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its limit, or furthest beyond it."""
        return max(self.checks, key=lambda check: check.share)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for JSON.

        ``checks`` are the comparisons that were made, ``skipped`` those that were not, with the
        reason as their note. A residual that is no number is None.
        """
        made, skipped = [], []
        for check in self.checks:
            if check.passed is None:
                skipped.append({"name": check.name, "against": check.against, "note": check.note})
                continue
            residual = check.residual if math.isfinite(check.residual) else None
            made.append({**asdict(check), "residual": residual, "passed": check.passed})
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "checks": made,
            "skipped": skipped,
        }
