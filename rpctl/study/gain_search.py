"""The state of a search for settings: what each point has cost, and the best so far."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.opening import read_text
from rpctl.files.strict_json import read_json
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.study.executor import Executor
from rpctl.study.optimisation import Optimisation
from rpctl.study.scatter import Scatter, with_values
from rpctl.study.study import Progress, Study


@dataclass
class SearchLog:
    """The best so far, and what each point has cost: the search walks the same way again.

    Attributes:
        folder: Where each generation is kept.
        costs: By the bytes of a point.
        history: The lowest cost after each generation.
        best: The point of the lowest cost (n,); None: nothing has a cost yet.
    """

    folder: Path
    costs: dict[bytes, float] = field(default_factory=dict)
    history: list[float] = field(default_factory=list)
    best: Array | None = None
    lowest: float = np.inf

    def load(self) -> None:
        """Read the generations that the folder keeps; one that is torn is done again."""
        for path in sorted(self.folder.glob("generation-*.json")):
            self._load(path)

    def _load(self, path: Path) -> None:
        try:
            kept = read_json(read_text(path, "MAX_TOML_BYTES", "a generation of a search"))
            points, costs = np.array(kept["points"], float), kept["costs"]
            self.costs |= dict(zip(map(point_key, points), map(float, costs), strict=True))
        except (RpctlError, ValueError, KeyError, TypeError):
            path.unlink(missing_ok=True)

    def keep(self, points: Array, costs: Array) -> bool:
        """Keep a generation; return whether it has a new best.

        Args:
            points: (P, n).
            costs: (P,).
        """
        path = self.folder / f"generation-{len(self.history):05d}.json"
        if not path.exists():
            text = json.dumps({"points": points.tolist(), "costs": costs.tolist()})
            write_atomically(path, text.encode(), follow_links=False)
        self.costs |= dict(zip(map(point_key, points), costs.tolist(), strict=True))
        at = int(np.argmin(costs))
        is_better = bool(costs[at] < self.lowest)
        if is_better:
            self.best, self.lowest = points[at].copy(), float(costs[at])
        self.history.append(self.lowest)
        return is_better


@dataclass(frozen=True)
class GainSearch:
    """A search of one study's settings.

    Attributes:
        robot: The robot.
        study: The study, which says what to optimise.
        out: The folder to write to.
        executor: What runs the chunks.
        progress: Called with the runs done and their number.
    """

    robot: Robot
    study: Study
    out: Path
    executor: Executor
    progress: Progress

    @property
    def asked(self) -> Optimisation:
        """What to optimise."""
        if self.study.optimisation is None:
            raise RpctlError("the study says nothing to optimise; write [optimize.parameters]")
        return self.study.optimisation

    @property
    def generations(self) -> int:
        """How many fit the budget."""
        return self.asked.evaluations // self.asked.population

    @property
    def total(self) -> int:
        """Number of all runs, the validation's with them."""
        asked = self.asked
        return self.generations * asked.population * asked.runs + 2 * asked.validation

    def config_at(self, point: Array) -> Config:
        """Return the study's configuration with the settings at a point (n,)."""
        found = self.asked.ranges.values(point[None])[0]
        return with_values(self.study.experiment.config, self.asked.ranges.names, found)


def setting(config: Config, path: str) -> float | None:
    """Return a setting of a configuration; None if it is no number there.

    Args:
        config: The configuration.
        path: Of the setting.
    """
    value: Any = config
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else getattr(value, key, None)
    return float(value) if isinstance(value, int | float) else None


def range_table(ranges: Scatter) -> dict[str, list[float]]:
    """Return the ends and the middle of each setting's range, by its path."""
    ends = [ranges.values(np.full((1, len(ranges.names)), p))[0].tolist() for p in (0.0, 0.5, 1.0)]
    return {name: list(each) for name, *each in zip(ranges.names, *ends, strict=True)}


def point_key(point: Iterable[float] | Array) -> bytes:
    """Return a point (n,) as the key of what it costs."""
    return np.ascontiguousarray(point, float).tobytes()
