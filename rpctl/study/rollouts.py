"""``Rollouts``: the runs of a rollout, and questions about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.simulation.config import Config
from rpctl.study.experiment import Experiment, RolloutTable
from rpctl.study.merits import SUCCESS


@dataclass(frozen=True, eq=False, repr=False)
class Rollouts:
    """The runs of a rollout.

    Attributes:
        experiment: What they have in common.
        names: Paths of the settings that differ.
        parameters: Their values (count, n).
        results: Merits, series and outcomes, a row each.
    """

    experiment: Experiment
    names: tuple[str, ...]
    parameters: Array
    results: RolloutTable = field(repr=False)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.parameters)

    def __repr__(self) -> str:
        share = float(self.success.mean())
        return f"Rollouts({len(self)} runs, {share:.1%} succeeded, {len(self.names)} settings)"

    @property
    def merits(self) -> Mapping[str, Array]:
        """The merits by name (count,); inf of runs that came to no end."""
        return self.results.merits

    @property
    def t(self) -> Array:
        """Times of the series (T,), s."""
        return self.results.t

    @property
    def base_error(self) -> Array:
        """Distance of P from its reference (count, T), m; NaN after a run has ended."""
        return self.results.series["base_error"]

    @property
    def lateral_error(self) -> Array:
        """Size of its lateral part (count, T), m."""
        return self.results.series["lateral_error"]

    @property
    def end_effector_error(self) -> Array:
        """Distance of the end effector from its reference (count, T), m.

        Raises:
            RpctlError: The robot has none.
        """
        if "end_effector_error" not in self.results.series:
            raise RpctlError("the robot has no arm, so no end effector")
        return self.results.series["end_effector_error"]

    @property
    def outcomes(self) -> tuple[str, ...]:
        """What became of each run, in a word of :data:`rpctl.study.merits.RUN_OUTCOMES`."""
        return self.results.outcomes

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs (count,) tracked within the tolerance and all limits."""
        return np.asarray(self.merits[SUCCESS] > 0.0)

    def quantile(self, merit: str, p: float) -> float:
        """Return the merit that a share p (0 to 1) of the runs do not exceed; runs that failed do.

        Args:
            merit: Its name.
            p: The share.

        Raises:
            UnknownNameError: There is no such merit.
        """
        if not 0.0 <= p <= 1.0:
            raise RpctlError(f"p is {p:g}; give a share from 0 to 1")
        return float(np.quantile(self._merit(merit), p, method="inverted_cdf"))

    def worst(self, merit: str, n: int = 1) -> NDArray[np.int64]:
        """Return the numbers (n,) of the runs with the largest merit, the worst first.

        Args:
            merit: Its name.
            n: How many.

        Raises:
            UnknownNameError: There is no such merit.
        """
        return np.argsort(-self._merit(merit), kind="stable")[:n]

    def config(self, i: int) -> Config:
        """Return the configuration of run i, which ``rpctl track --config`` replays.

        Args:
            i: Its number.
        """
        return self.experiment.config_of(self.parameters[i], int(self.results.indices[i]))

    def table(self) -> dict[str, Array]:
        """Return settings, merits and outcomes as columns (count,), by name."""
        columns: dict[str, Array] = {"run": np.asarray(self.results.indices)}
        columns |= dict(zip(self.names, self.parameters.T, strict=True))
        return {**columns, **self.merits, "outcome": np.array(self.outcomes)}

    def _merit(self, name: str) -> Array:
        if name not in self.merits:
            raise UnknownNameError("merit", name, self.merits)
        return self.merits[name]
