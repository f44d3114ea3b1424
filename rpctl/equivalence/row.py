"""The rows of a certificate: a comparison that was made, or one that could not be."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

CONTACT_ORACLE = "MuJoCo, rolling on a plane"  # what the contact trial compares with


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
