"""What a sample of the horizon law takes, by part."""

from __future__ import annotations

import numpy as np

import rpctl
from rpctl.control.horizon.law import Horizon
from tests.bench.rows import Row, Section
from tests.bench.test_horizon import part_seconds

COMMAND = "python -m tests.bench.table --only horizon"
PARTS = {
    "a sample, whole": "plan",
    "target: time scaling and look-ahead": "_target",
    "linearisation: constraints and cost": "linearise",
    "quadratic program": "_solved",
}
AHEAD = {"prepared ahead": "prepare", "left after a measurement": "feed_back"}


def section(quick: bool) -> Section:
    """Return medians over a closed loop of TIAGo, ms."""
    robot, duration = rpctl.load("tiago"), 3.0 if quick else 12.0
    found = part_seconds(robot, Horizon(), PARTS, duration)
    found |= part_seconds(robot, Horizon(prepare=True), AHEAD, duration)
    median = {name: 1e3 * float(np.median(seconds[1:])) for name, seconds in found.items()}
    whole = next(iter(PARTS))
    rows = tuple(
        Row(name, each, "ms", COMMAND)
        if name != "left after a measurement"
        else Row(name, each, "ms", COMMAND, whole, median[whole])
        for name, each in median.items()
    )
    note = (
        f"TIAGo, 20 steps ahead, medians over {duration:g} s of a figure-eight that starts where "
        "limits bind. What is left of a sample is prediction and bookkeeping."
    )
    return Section("A sample of the horizon law", rows, note)
