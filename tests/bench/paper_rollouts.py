"""Many runs of the paper's robot in chunks, as a study does them: processor time and memory.

``python -m tests.bench.paper_rollouts COUNT`` prints them as JSON; loading the robot and building
the loop, which an earlier process may have cached, are not counted.
"""

from __future__ import annotations

import json
import resource
import sys
import time

import numpy as np

import rpctl
from rpctl.control.controller import default_laws
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.merits.outcome import TRACKED
from rpctl.study.experiment import Design, Experiment
from rpctl.study.runner import Runner
from rpctl.study.scatter import scatter_of, settings_at
from tests.bench.sections.rollouts import SCATTER, SECONDS

CHUNK = 256  # runs, as of a study


def main() -> None:
    """Do the runs, and print what they took."""
    count = int(sys.argv[1])
    robot = rpctl.load("paper")
    config = Config(*default_laws(robot), run=RunSettings(duration=SECONDS, reference="eight"))
    scatter = scatter_of(SCATTER, config)
    experiment = Experiment(config, scatter.names, backend="compiled")
    values = settings_at(scatter, Design(count=count).points(len(scatter.names)))
    numbers = np.arange(count)
    runner = Runner(robot, experiment)
    runner.rows(values[:1], numbers[:1])
    began, succeeded = time.process_time(), 0.0
    for first in range(0, count, CHUNK):
        rows = slice(first, first + CHUNK)
        table = runner.rows(values[rows], numbers[rows])
        succeeded += table.outcomes.count(TRACKED)
    seconds = time.process_time() - began
    if succeeded < 0.9 * count:
        raise ValueError(f"only {succeeded:g} of {count} runs succeeded")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # kB on Linux
    print(json.dumps({"seconds": seconds, "peak": peak}))


if __name__ == "__main__":
    main()
