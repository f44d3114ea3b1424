"""Simulates the runs of an experiment, by machine code where it can, as any process does it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import DiffersError, DivergedError, RpctlError
from rpctl.files.caps import read_input
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.loop.backend import pays, plant_refusal, refusal
from rpctl.simulation.loop.track import require_affordable, simulate
from rpctl.simulation.merits.measures import measures
from rpctl.simulation.merits.outcome import DIVERGING
from rpctl.simulation.run.run import Run
from rpctl.study.executor import Executor
from rpctl.study.experiment import SERIES, Experiment, Progress, RunTable
from rpctl.study.merits import REFUSED, RunVerdict, merits_for, run_merits

if TYPE_CHECKING:
    from rpctl.study.lanes import Lanes

RUNS = 10  # that a loop is built for, at least: whether it pays depends on no one's chunks
LARGEST_CHUNK = 256  # runs
CHUNKS_EACH = 8  # for each worker, where there are enough runs
LANES = 8  # chunks are whole numbers of them: the most that any processor runs side by side
BLOCK = 256  # runs that are done at a time, and after which progress is told


@dataclass(frozen=True)
class RunChunk:
    """Runs that are done together.

    Attributes:
        rows: Their rows (K,) among all that is asked.
        indices: Numbers (K,) from which their random numbers follow.
        values: Their settings (K, n).
    """

    rows: NDArray[np.int64]
    indices: NDArray[np.int64]
    values: Array

    def __str__(self) -> str:
        """Return ``runs 0 to 9``."""
        first, last = int(self.rows[0]), int(self.rows[-1])
        return f"run {first}" if first == last else f"runs {first} to {last}"


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What is the same for all runs: found once."""

    reference: Reference
    merits: tuple[str, ...]
    series: tuple[str, ...]
    count: int  # samples of a run
    stride: int  # of those that are kept over time
    lanes: Lanes | None  # machine code; None: Python does the runs


@dataclass(frozen=True, eq=False)
class Runner:
    """Simulates runs of an experiment; it can be sent to another process, on any machine.

    Attributes:
        robot: The robot, as its controller knows it.
        experiment: What all runs have in common.
    """

    robot: Robot
    experiment: Experiment
    _file: bytes | None = field(default=None, repr=False)  # of a reference: others need not have it

    def __post_init__(self) -> None:
        """Keep what is in the file of the reference, where it is one."""
        if self.experiment.reference is None and self._file is None:
            object.__setattr__(self, "_file", _content(self.experiment.config.run.reference))

    def __getstate__(self) -> Mapping[str, Any]:
        """Return what another process needs; it prepares itself."""
        return {name: value for name, value in vars(self).items() if name != "_prepared"}

    def __call__(self, chunk: RunChunk) -> RunTable:
        """Return the rows of a chunk, which depend on its settings and numbers only."""
        return replace(self.rows(chunk.values, chunk.indices), index=chunk.rows)

    def rows(
        self,
        values: Array,
        indices: NDArray[np.int64] | Sequence[int],
        progress: Progress | None = None,
    ) -> RunTable:
        """Simulate runs; each is the same whichever others run beside it.

        A run that diverges, or that is refused for its settings, is a row with that outcome.

        Args:
            values: Settings of each run (K, n), in the order of ``experiment.names``.
            indices: Numbers of the runs (K,), from which their random numbers follow.

        Raises:
            RpctlError: The experiment fits no run: its reference or a merit is not the robot's.
        """
        prepared, count, notify = self._prepared, len(indices), progress or (lambda *told: None)
        t: Array = np.arange(0, prepared.count, prepared.stride, dtype=float)
        t *= self.experiment.config.run.control_period
        table = RunTable(  # of runs that came to no end
            index=np.asarray(indices, dtype=np.int64),
            parameters=dict(zip(self.experiment.names, values.T, strict=True)),
            merits={name: np.full(count, np.inf) for name in prepared.merits},
            series={name: np.full((count, len(t)), np.nan) for name in prepared.series},
            t=t,
            outcomes=(),
            reasons=(),
        )
        verdicts, lanes = dict[int, RunVerdict](), prepared.lanes
        for first in range(0, count, BLOCK):
            rows = slice(first, min(first + BLOCK, count))
            if lanes is not None:

                def told(done: int, _: int, first: int = first) -> None:
                    notify(first + done, count)

                verdicts |= lanes.fill(table, rows, values[rows], told)
            for row in range(rows.start, rows.stop):
                if row not in verdicts:
                    verdicts[row] = self._run_row(table, row, values[row])
                if lanes is None:
                    notify(row + 1, count)
            notify(rows.stop, count)
        ordered = [verdicts[row] for row in range(count)]
        return replace(
            table,
            outcomes=tuple(verdict.outcome for verdict in ordered),
            reasons=tuple(verdict.reason for verdict in ordered),
        )

    @cached_property
    def _prepared(self) -> _Prepared:
        robot, experiment = self.robot, self.experiment
        config, reference = experiment.config, experiment.reference or self._reference()
        count = require_affordable(robot, config, reference).periods + 1
        placed = robot.end_effector is not None
        stride = -(-count // experiment.samples)
        return _Prepared(
            reference=reference,
            merits=merits_for(robot, experiment.merits),
            series=tuple(name for name, measure in SERIES.items() if placed or measure != "tip"),
            count=count,
            stride=stride,
            lanes=_lanes(config.limits.apply(robot), experiment, reference, count, stride),
        )

    def _reference(self) -> Reference:
        """Return the reference by its name, or of the file that was sent if it is not here."""
        config = self.experiment.config
        name, known = config.run.reference, config.limits.apply(self.robot)
        if self._file is None or _content(name) == self._file:
            return config.run.load_reference(known)
        with TemporaryDirectory() as folder:
            path = Path(folder, Path(name).name)
            path.write_bytes(self._file)
            return replace(config.run, reference=str(path)).load_reference(known)

    def _run_row(self, table: RunTable, row: int, settings: Array) -> RunVerdict:
        """Simulate a run by Python, fill its row, and return what became of it."""
        prepared, experiment = self._prepared, self.experiment

        def keep(run: Run) -> None:
            kept = measures(run)
            for name, series in table.series.items():
                shown = getattr(kept, SERIES[name])[:: prepared.stride]
                series[row, : len(shown)] = shown

        try:
            run = simulate(
                self.robot,
                experiment.config_of(settings, int(table.index[row])),
                prepared.reference,
                ended=keep,
                collisions=False,
                backend="pinocchio",
            )
        except DivergedError as error:
            return RunVerdict(DIVERGING, str(error))
        except RpctlError as error:
            return RunVerdict(REFUSED, str(error))
        keep(run)
        merits, verdict = run_merits(run, experiment.tolerance)
        for name, column in table.merits.items():
            column[row] = merits[name]
        return verdict


def run_rows(
    runner: Runner,
    rows: NDArray[np.int64],
    numbers: NDArray[np.int64],
    values: Array,
    executor: Executor,
    size: int | None = None,
) -> Iterator[RunTable]:
    """Yield the rows of runs, a chunk at a time, as they end.

    Args:
        runner: What simulates them.
        rows: Which (K,) of all rows.
        numbers: Of the runs (K,), from which their random numbers follow.
        values: Settings of all rows (N, n).
        executor: What runs the chunks.
        size: Of a chunk; None: as suits the workers.
    """
    size = size or chunk_size(len(rows), executor.workers)
    chunks = [
        RunChunk(rows[k : k + size], numbers[k : k + size], values[rows[k : k + size]])
        for k in range(0, len(rows), size)
    ]
    for _, table in executor.map_chunks(runner, chunks):
        yield table


def chunk_size(rows: int, workers: int) -> int:
    """Return how many of some rows are done at a time."""
    share = max(1, min(LARGEST_CHUNK, rows // (CHUNKS_EACH * workers)))
    return share if share < LANES else share - share % LANES


def _content(name: str) -> bytes | None:
    """Return what is in a file; None if there is none of that name."""
    try:
        return read_input(name, "MAX_SHOWN_BYTES", "a reference")
    except RpctlError:
        return None


def _lanes(
    robot: Robot, experiment: Experiment, reference: Reference, count: int, stride: int
) -> Lanes | None:
    """Return what runs an experiment as machine code; None where Python does.

    Raises:
        RpctlError: Machine code is asked for and cannot do it.
    """
    reason = refusal(robot, experiment.config)
    reason = reason or plant_refusal(experiment.config.plant, experiment.names)
    short = reason is None and experiment.backend == "auto" and not pays(robot, RUNS * count)
    if experiment.backend == "pinocchio" or short:
        return None
    if reason is None:
        from rpctl.study.lanes import Lanes

        try:
            return Lanes(robot, experiment, reference, count, stride)
        except DiffersError as error:
            reason = str(error)
    if experiment.backend == "compiled":
        raise RpctlError(f'these runs cannot be compiled: {reason}; take backend "auto"')
    return None
