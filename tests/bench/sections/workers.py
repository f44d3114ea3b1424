"""A study in this process, in processes and on Dask: wall time, as several processes work."""

from __future__ import annotations

import tempfile
from pathlib import Path

import rpctl
from tests.bench.rows import Row, Section
from tests.bench.test_cluster import study_seconds

COMMAND = "python -m tests.bench.test_cluster"


def section(quick: bool) -> Section:
    """Return how many runs of a study are done in a second, starting the workers included."""
    count = 512 if quick else 8192
    with tempfile.TemporaryDirectory() as folder:
        found = study_seconds(rpctl.load("paper"), count, Path(folder))
    first, *others = ((name, count / took) for name, took in found.items())
    rows = [Row(first[0], first[1], "runs/s", COMMAND)]
    rows += [Row(name, each, "runs/s", COMMAND, *first) for name, each in others]
    note = (
        f"{count} runs of the paper's robot, 5 s each, wall time; files are the same byte by byte. "
        "Starting a process, loading the robot and the loop in it count."
    )
    return Section("Workers", tuple(rows), note)
