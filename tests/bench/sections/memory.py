"""Memory and bytes of log, per simulated second."""

from __future__ import annotations

import tempfile
import tracemalloc
from pathlib import Path

import numpy as np

import rpctl
from tests.bench.rows import Row, Section
from tests.bench.sections.rollouts import SCATTER

COMMAND = "python -m tests.bench.table --only memory"
SECONDS, RUNS = 10.0, 64
UNIT = "kB/s"


def section(quick: bool) -> Section:
    """Return what a run of TIAGo keeps in memory and on disk, and what rollouts keep."""
    robot = rpctl.load("tiago")
    rpctl.track(robot, "eight", SECONDS)  # what is built once is not the run's
    tracemalloc.start()
    run = rpctl.track(robot, "eight", SECONDS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    log = sum(each.nbytes for each in vars(run.log).values() if isinstance(each, np.ndarray))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.npz")
        run.save(path)
        on_disk = path.stat().st_size
    found = rpctl.rollout(robot, "eight", SCATTER, RUNS, SECONDS)
    columns = [*found.results.merits.values(), *found.results.series.values(), found.parameters]
    kept = sum(each.nbytes for each in columns) / RUNS

    def row(what: str, size: float, command: str, peer: str = "", its: float = np.nan) -> Row:
        return Row(what, size / SECONDS / 1e3, UNIT, command, peer, its / SECONDS / 1e3)

    track = 'rpctl.track(robot, "eight", 10.0)'
    held = "log in memory"
    rows = (
        row("log in memory", log, track),
        row("most that the run takes", peak, track),
        row("run file", on_disk, "run.save(path)", held, log),
        row("a run of a rollout", kept, "rpctl.rollout(...)", held, log),
    )
    note = (
        "TIAGo at 2 ms: 500 samples of a simulated second are logged. The run file keeps every bit "
        "of them. A rollout keeps settings, merits and 200 samples of three errors of a run."
    )
    return Section("Memory", rows, note)
