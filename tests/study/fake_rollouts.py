"""Rollouts whose merits are known by paper, in the place of simulations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.study.executor import Executor
from rpctl.study.experiment import RunTable
from rpctl.study.merits import merits_for
from rpctl.study.optimise import setting
from rpctl.study.runner import Runner

T = 3
Merit = Callable[..., Array]  # of the settings by the last word of their path, and the numbers


def patch_rollouts(monkeypatch: pytest.MonkeyPatch, merit: Merit, *known: str) -> None:
    """Let runs have a merit: ``merit(numbers=..., gain=..., delay=...)``, of scattered settings.

    Args:
        monkeypatch: Of the test.
        merit: Returns ``rms_base_error`` (K,); inf of a run that diverged.
        known: Paths of settings that the merit takes from the configuration, if not scattered.
    """

    def rows(self: Runner, values: Array, indices: Any, progress: object = None) -> RunTable:
        count, numbers, names = len(values), np.asarray(indices), self.experiment.names
        given: dict[str, Any] = {}
        for path in known:
            given[path.rpartition(".")[2]] = np.full(count, setting(self.experiment.config, path))
        columns = dict(zip(names, values.T, strict=True))
        given |= {path.rpartition(".")[2]: column for path, column in columns.items()}
        error: Array = np.asarray(merit(numbers=numbers, **given), float)
        t: Array = np.linspace(0.0, 0.2, T)
        return RunTable(
            numbers, columns, dict.fromkeys(merits_for(self.robot), error * 1.0),
            {"base_error": np.asarray(np.add.outer(error, t), float)}, t,
            tuple("tracked" if x < 1.0 else "away" for x in error),
            tuple(f"it is {x:g}" for x in error),
        )  # fmt: skip

    monkeypatch.setattr(Runner, "rows", rows)
    monkeypatch.setattr("os.fsync", lambda file: None)  # tests need not outlast a loss of power


class OddExecutor(Executor):
    """Gives chunks out in an odd order, and ends as a Ctrl-C does: in a call, or before one.

    Attributes:
        rows: How many runs were done.
    """

    def __init__(
        self, workers: int = 1, most: int = 10**9, seed: int | None = None, calls: int = 10**9
    ) -> None:
        self.workers, self.rows = workers, 0
        self._most, self._seed, self._calls = most, seed, calls

    def map_chunks(self, work: Any, chunks: Any) -> Iterator[tuple[Any, Any]]:
        self._calls -= 1
        if self._calls < 0:
            raise KeyboardInterrupt
        listed = list(chunks)
        if self._seed is not None:
            listed = [listed[k] for k in np.random.default_rng(self._seed).permutation(len(listed))]
        for done, chunk in enumerate(listed):
            if done == self._most:
                raise KeyboardInterrupt
            result = work(chunk)
            self.rows += len(result)
            yield replace(chunk), result
