"""What to optimise over a scatter: settings within ranges, against a statistic of a merit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError, require_within
from rpctl.study.scatter import Scatter

STATISTICS = ("mean", "quantile", "worst")
METHODS = ("differential-evolution",)


@dataclass(frozen=True)
class Optimisation:
    """Settings to be found, and what they are judged by.

    The cost is the statistic of the merit over the runs that have it, plus ``failure_weight`` times
    the share of runs that did not succeed.

    Attributes:
        ranges: The settings: paths, each with a distribution whose ends are those of its range.
        merit: That is to be small.
        statistic: Of the merit over the scatter: one of :data:`STATISTICS`.
        level: Of the quantile.
        failure_weight: What the share of runs that fail costs, in the merit's unit.
        evaluations: The most sets of settings that are tried.
        runs: Of each set of settings, the same scattered plants and noise for all.
        validation: Fresh runs with the settings that were found, and with those of the file.
        method: One of :data:`METHODS`.
    """

    ranges: Scatter
    merit: str = "rms_base_error"
    statistic: str = "mean"
    level: float = 0.95
    failure_weight: float = 1.0
    evaluations: int = 200
    runs: int = 32
    validation: int = 200
    method: str = METHODS[0]

    def __post_init__(self) -> None:
        """Refuse what cannot be optimised."""
        if not self.ranges.names:
            raise RpctlError("there is nothing to optimise; write settings and their ranges under "
                             "[optimize.parameters]")  # fmt: skip
        if self.statistic not in STATISTICS:
            raise UnknownNameError("statistic", self.statistic, STATISTICS)
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if not 0.0 < self.level < 1.0:
            raise RpctlError(f"level is {self.level:g}; give one between 0 and 1")
        if self.failure_weight < 0.0:
            raise RpctlError(f"failure_weight is {self.failure_weight:g}; give 0 or more")
        require_within("failure_weight", [self.failure_weight])
        fewest = {"evaluations": 2 * self.population, "runs": 1, "validation": 2}
        for name, least in fewest.items():
            if getattr(self, name) < least:
                raise RpctlError(f"{name} is {getattr(self, name)}; give {least} or more")

    @property
    def population(self) -> int:
        """Sets of settings that are tried at a time: two generations at least fit the budget."""
        return max(8, 4 * len(self.ranges.names))

    def cost(self, merit: Array, success: NDArray[np.bool_]) -> float:
        """Return what a set of settings costs.

        Args:
            merit: Of each run (N,); inf where a run has none.
            success: Which runs (N,) succeeded.
        """
        known = np.sort(merit[np.isfinite(merit)])
        if not len(known):
            return float(np.inf)
        failed = 1.0 - float(np.mean(success))
        return self.figure(known) + self.failure_weight * failed

    def figure(self, known: Array) -> float:
        """Return the statistic of merits (K,), all finite."""
        if self.statistic == "mean":
            return float(np.mean(known))
        if self.statistic == "worst":
            return float(np.max(known))
        return float(np.quantile(known, self.level, method="inverted_cdf"))
