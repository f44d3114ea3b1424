"""Grids of runs: each cell by itself, in processes if asked, and kept as it ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.study.executor import Executor
from rpctl.study.experiment import Progress

Cell = TypeVar("Cell")
Result = TypeVar("Result")


class References:
    """The references of a robot, each made once in a process: it takes as long as a run."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._known: dict[object, Reference] = {}

    def __getstate__(self) -> Mapping[str, Any]:
        """Return what another process needs; it makes its own references."""
        return {"robot": self.robot, "_known": {}}

    def __call__(self, settings: RunSettings) -> Reference:
        """Return the reference of a run."""
        key = (settings.reference, settings.size, settings.speed, settings.laps)
        if key not in self._known:
            self._known[key] = settings.load_reference(self.robot)
        return self._known[key]


def run_cells(
    work: Callable[[Cell], Result],
    cells: Sequence[Cell],
    executor: Executor,
    progress: Progress | None = None,
    keep: Callable[[Cell, Result], object] = lambda cell, result: None,
) -> list[Result]:
    """Run cells; return their results in order.

    Args:
        work: What runs one; it can be sent to another process.
        cells: Which.
        executor: On what.
        progress: Called with the cells done and their number.
        keep: Called with each cell and its result as it ends.

    Raises:
        LostChunksError: A cell ended each process that ran it.
    """
    results: dict[int, Result] = {}
    numbers = {id(cell): number for number, cell in enumerate(cells)}
    for cell, result in executor.map_chunks(work, cells):
        results[numbers[id(cell)]] = result
        keep(cell, result)
        if progress is not None:
            progress(len(results), len(cells))
    return [results[number] for number in range(len(cells))]
