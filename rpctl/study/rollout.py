"""Rollouts: many closed loops of one robot, each with settings of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_known
from rpctl.libraries import library
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import TrackSettings, configured
from rpctl.simulation.merits.outcome import TRACKED
from rpctl.study.experiment import Design, Experiment, RunTable
from rpctl.study.merits import merit_unit, merit_words
from rpctl.study.runner import Runner
from rpctl.study.scatter import Scatter, scatter_of, settings_at

if TYPE_CHECKING:
    from typing import Unpack  # of Python 3.11; never imported when it runs


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Rollouts:
    """The runs of a rollout.

    Attributes:
        experiment: What all runs have in common.
        names: Paths of the settings that differ.
        parameters: Values of these settings (count, n).
        results: Merits, series and outcomes, one row per run.
    """

    experiment: Experiment
    names: tuple[str, ...]
    parameters: Array
    results: RunTable = field(repr=False)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.parameters)

    def __repr__(self) -> str:
        share = float(self.success.mean())
        return f"Rollouts({len(self)} runs, {share:.1%} succeeded, {len(self.names)} settings)"

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        told = {"runs": self, "words": merit_words, "unit": merit_unit}
        return str(library("rpctl.view.pages.page").render("notebook_rollouts.html", **told))

    @property
    def merits(self) -> Mapping[str, Array]:
        """The merits by name (count,); inf for runs that did not finish."""
        return {**self.results.merits, "success": self.success.astype(float)}

    @property
    def t(self) -> Array:
        """Times of the series (T,), s."""
        return self.results.t

    @property
    def base_error(self) -> Array:
        """Distance of P from its reference (count, T), m; NaN after a run has ended."""
        return np.asarray(self.results.series["base_error"], float)

    @property
    def lateral_error(self) -> Array:
        """Absolute lateral error of P (count, T), m; NaN after a run has ended."""
        return np.asarray(self.results.series["lateral_error"], float)

    @property
    def end_effector_error(self) -> Array:
        """Distance of the end effector from its reference (count, T), m.

        Raises:
            RpctlError: The robot has no end effector.
        """
        if "end_effector_error" not in self.results.series:
            raise RpctlError("the robot has no arm, so no end effector")
        return np.asarray(self.results.series["end_effector_error"], float)

    @property
    def outcomes(self) -> tuple[str, ...]:
        """The outcome of each run, one of :data:`rpctl.study.merits.RUN_OUTCOMES`."""
        return self.results.outcomes

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each run (count,) tracked its reference within the tolerance and all limits."""
        return np.array([outcome == TRACKED for outcome in self.outcomes], bool)

    def quantile(self, merit: str, p: float) -> float:
        """Return the p-quantile of a merit; runs that did not finish count as infinite.

        Args:
            merit: Name of the merit.
            p: Probability, 0 to 1.

        Raises:
            UnknownNameError: There is no such merit.
            RpctlError: p is not between 0 and 1.
        """
        if not 0.0 <= p <= 1.0:
            raise RpctlError(f"p is {p:g}; give a share from 0 to 1")
        return float(np.quantile(self._merit(merit), p, method="inverted_cdf"))

    def worst(self, merit: str, n: int = 1) -> NDArray[np.int64]:
        """Return the indices (n,) of the runs with the largest merit, the worst first.

        Args:
            merit: Name of the merit.
            n: Number of runs.

        Raises:
            UnknownNameError: There is no such merit.
        """
        return np.argsort(-self._merit(merit), kind="stable")[:n]

    def config(self, i: int) -> Config:
        """Return the configuration of run i, which ``rpctl track --config`` replays.

        Args:
            i: Index of the run.
        """
        return self.experiment.config_of(self.parameters[i], int(self.results.index[i]))

    def table(self) -> dict[str, Array]:
        """Return settings, merits and outcomes as columns (count,), by name."""
        columns: dict[str, Array] = {"run": np.asarray(self.results.index)}
        columns |= dict(zip(self.names, self.parameters.T, strict=True))
        return {**columns, **self.merits, "outcome": np.array(self.outcomes)}

    def _merit(self, name: str) -> Array:
        require_known("merit", [name], self.merits)
        return self.merits[name]


OWN = ("seed", "merits", "samples", "backend", "progress")  # of a rollout, and of no run


class RolloutSettings(TrackSettings, total=False):
    """What keywords of :func:`rollout` may say, besides those of :func:`rpctl.track`."""

    seed: int
    merits: Sequence[str] | None
    samples: int


def rollout(
    robot: Robot,
    reference: str | Path | Reference = RunSettings.reference,
    scatter: Scatter | Mapping[str, Any] | None = None,
    *,
    count: int = 1000,
    config: Config | str | Path | None = None,
    **settings: Unpack[RolloutSettings],
) -> Rollouts:
    """Simulate a robot many times, each time with other random settings.

    Run i depends only on the seed and on i: a larger count adds runs.

    Args:
        robot: The robot, as its controller knows it.
        reference: A reference, the name of one, or a file, as of :func:`rpctl.track`.
        scatter: Distributions by path of the setting, see :mod:`rpctl.study.scatter`; for example
            ``{"plant.masses.arm_*": Uniform(0.9, 1.1), "run.initial_error.y": Normal(0.0, 0.1)}``.
        count: Number of runs.
        config: Laws, plant and settings of all runs, or the path of their TOML file; None: the
            robot's defaults, for 10 s.
        **settings: Settings of :func:`rpctl.track`, which take precedence over ``config``, such as
            ``duration=5``; further the ``seed`` of all random numbers, the names of the ``merits``
            to compute, and the largest number of ``samples`` over time to keep per run.

    Returns:
        The runs: merits, errors over time, and outcomes.

    Raises:
        UnknownNameError: There is no such setting or merit.
        RpctlError: A setting is out of range, or the reference does not fit the robot.
    """
    if count < 1:
        raise RpctlError(f"count is {count}; give a whole number, 1 or more")
    given: dict[str, Any] = {"duration": 10.0, **settings} if config is None else {**settings}
    own = {name: given.pop(name) for name in OWN if name in given}
    progress, merits, seed = own.pop("progress", None), own.pop("merits", None), own.get("seed", 0)
    base = configured(robot, reference, config, given)
    scattered = scatter_of(scatter, base)
    own["merits"] = None if merits is None else tuple(merits)
    own["reference"] = None if isinstance(reference, str | Path) else reference
    experiment = Experiment(base, scattered.names, **own)
    values = settings_at(scattered, Design(count=count, seed=seed).points(len(scattered.names)))
    table = Runner(robot, experiment).rows(values, np.arange(count), progress)
    return Rollouts(experiment=experiment, names=scattered.names, parameters=values, results=table)
