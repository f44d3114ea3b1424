"""What all runs of a rollout have in common, and the table of what became of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_positive
from rpctl.reference.motion import Reference
from rpctl.simulation.backend import require_backend
from rpctl.simulation.config import Config
from rpctl.simulation.outcome import ON_PATH_M
from rpctl.study.scatter import with_values

# What is kept over time, m, by its name in ``simulation.merits.SampleMeasures``.
SERIES = {"base_error": "base", "lateral_error": "lateral", "end_effector_error": "tip"}


@dataclass(frozen=True)
class Experiment:
    """What all runs of a rollout have in common; a pure value.

    Attributes:
        config: What no run changes.
        names: Paths of the settings that each run has its own of, see
            :mod:`rpctl.study.scatter`.
        seed: Of all that is random.
        merits: Names of the merits that are wanted; None: all that the robot has.
        samples: How many samples over time are kept of a run, at most.
        tolerance: How far from its reference a run that succeeds may end, m.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``: the first that can do it.
        reference: What the configuration's reference is; None loads it by its name.
    """

    config: Config
    names: tuple[str, ...] = ()
    seed: int = 0
    merits: tuple[str, ...] | None = None
    samples: int = 200
    tolerance: float = ON_PATH_M
    backend: str = "auto"
    reference: Reference | None = None

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        require_backend(self.backend)
        if self.samples < 2:
            raise RpctlError(f"samples is {self.samples}; give a whole number, 2 or more")
        if self.seed < 0:
            raise RpctlError(f"seed is {self.seed}; give a whole number, 0 or more")
        require_positive("tolerance", self.tolerance)

    def config_of(self, values: Array, index: int) -> Config:
        """Return the configuration of a run, which ``rpctl track --config`` replays.

        Args:
            values: Its settings (n,), in the order of the names.
            index: Its number.

        Raises:
            RpctlError: A setting is out of range.
        """
        config = with_values(self.config, self.names, values)
        plant = replace(config.plant, seed=run_seed(self.seed, index))
        return replace(config, plant=plant)


@dataclass(frozen=True, eq=False, repr=False)
class RolloutTable:
    """Some runs of a rollout, a row each; K runs, T samples over time.

    Attributes:
        indices: Numbers of the runs (K,).
        merits: By name (K,), in the units of :data:`rpctl.study.merits.MERITS`; of a run that came
            to no end each is inf. ``success`` is among them, 1 or 0.
        t: Times of the samples (T,), s.
        series: By name (K, T), m; NaN after a run has ended.
        outcomes: What became of each run, in a word of :data:`rpctl.study.merits.RUN_OUTCOMES`.
        reasons: Why, in words.
    """

    indices: NDArray[np.int64]
    merits: Mapping[str, Array]
    t: Array
    series: Mapping[str, Array]
    outcomes: tuple[str, ...]
    reasons: tuple[str, ...]


def run_seed(seed: int, index: int) -> int:
    """Return the seed of a run's plant, which follows from that of the study and its number.

    Args:
        seed: Of the study.
        index: Number of the run.
    """
    state = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))  # TOML's whole numbers have 63 bits
