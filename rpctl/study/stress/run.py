"""Runs a battery, in processes if asked, and goes on where another stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpctl.control.settings import to_table
from rpctl.errors import RpctlError
from rpctl.robot.identity import robot_identity
from rpctl.simulation.config import write_config
from rpctl.study.executor import Executor, SerialExecutor
from rpctl.study.identity import reference_digest
from rpctl.study.stress.battery import Battery
from rpctl.study.stress.cell_run import StressChunk, StressTask
from rpctl.study.stress.journal import Journal
from rpctl.study.stress.report import StressReport, report_of
from rpctl.study.versions import installed

Progress = Callable[[int, int], object]


def run_battery(
    battery: Battery,
    out: Path,
    tolerance: float,
    executor: Executor | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> StressReport:
    """Run a battery, and keep each run on disk as it ends.

    Its rows depend neither on the executor, nor on what ended it before. A battery with more laws,
    plants, stresses or combinations may go on with the runs of a smaller one.

    Args:
        battery: The battery.
        out: The folder of its runs.
        tolerance: How far from its reference a run that passes may be, m.
        executor: What runs the cells; None: this process.
        progress: Called with the runs done and their number.
        resume: Whether to go on with what the folder holds.

    Raises:
        RpctlError: The folder holds something else, or no run could be made.
    """
    worker, notify = executor or SerialExecutor(), progress or (lambda done, total: None)
    configs = {cell.key: battery.config_of(cell) for cell in battery.cells}
    journal = Journal(out, identity_of(battery))
    done = journal.begin(resume)
    missing = [StressChunk(key, config) for key, config in configs.items() if key not in done]
    count = len(configs) - len(missing)
    notify(count, len(configs))
    for chunk, figures in worker.map_chunks(StressTask(battery.robot), missing):
        journal.add(chunk.key, figures)
        done[chunk.key] = figures
        count += 1
        notify(count, len(configs))
    journal.close({**{key: done[key] for key in configs}, **done})
    report = report_of(battery, done, tolerance)
    if not report.worst():
        raise RpctlError(f"no run could be made: {report.rows[0].verdict.reason}")
    return report


def identity_of(battery: Battery) -> dict[str, Any]:
    """Return what the runs of a battery follow from, besides their cells."""
    return {
        "robot": robot_identity(battery.robot),
        "run": to_table(battery.run),
        "reference": reference_digest(battery.run.reference),
        "versions": dict(installed()),
    }


def write_worst(report: StressReport, out: Path) -> list[Path]:
    """Write the configurations of the worst cases, in the place of any before.

    Args:
        report: The report.
        out: Its folder.

    Returns:
        The files, in the order of ``report.worst()``.
    """
    for left in out.glob("worst-*.toml"):
        left.unlink(missing_ok=True)
    paths = []
    for k, row in enumerate(report.worst(), start=1):
        path = out / f"worst-{k}.toml"
        paths.append(write_config(report.battery.config_of(row.cell), path))
    return paths
