"""Whole commands, each a process from nothing to its end."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import rpctl
from rpctl.view.plots.figures import tracking_image
from tests.bench.rows import Row, Section, cpu_seconds

VERIFY_GOAL, TRACK_GOAL, PICTURE_GOAL = 2.0, 4.0, 0.8  # s
TRACKED = ("paper", "tiago", "swerve", "car")


def section(quick: bool) -> Section:
    """Return the processor time of whole processes, and of the picture of a run."""
    rounds = 0 if quick else 2
    empty, engine, package = (
        process_seconds(rounds, "-c", code)
        for code in ("pass", "import numpy, pinocchio", "import rpctl")
    )
    importing = 'python -c "import rpctl"'
    peer = "`import numpy, pinocchio`"
    rows = [
        Row("Python alone", empty, "s", "python -c pass"),
        Row(peer, engine, "s", 'python -c "import numpy, pinocchio"'),
        Row("`import rpctl`", package, "s", importing, peer, engine),
    ]
    with tempfile.TemporaryDirectory() as out:
        commands: list[tuple[str, float | None]] = [
            ("--version", None),
            ("inspect tiago", None),
            ("verify tiago", VERIFY_GOAL),
            *(
                (f"track {robot} --reference line --duration 40", TRACK_GOAL)
                for robot in TRACKED[: 1 if quick else None]
            ),
        ]
        for text, goal in commands:
            where = ["--out", str(Path(out, "run"))] if text.startswith("track") else []
            took = process_seconds(rounds, "-m", "rpctl", *text.split(), *where)
            rows.append(Row(f"`rpctl {text}`", took, "s", f"rpctl {text}", goal=goal))
    run = rpctl.track(rpctl.load("paper" if quick else "tiago"), "eight", duration=10.0)
    tracking_image(run)  # imports Matplotlib, finds fonts
    took = cpu_seconds(lambda: tracking_image(run), rounds=max(1, rounds))
    command = "rpctl.view.plots.figures.tracking_image(run)"
    rows.append(Row("`tracking.png` of that run", took, "s", command, goal=PICTURE_GOAL))
    note = (
        "Processor time of a whole process; what a command caches, an earlier run has cached. "
        "`track` writes its log, summary, picture and report, and does a second, perturbed run."
    )
    return Section("Start-up and whole commands", tuple(rows), note)


def process_seconds(rounds: int, *arguments: str) -> float:
    """Return the least processor time, s, of a Python process; one more comes before.

    Args:
        rounds: How often it is timed; 0: the first one is.
        arguments: Of Python.
    """
    found = []
    for _ in range(rounds + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found[1:] or found)
