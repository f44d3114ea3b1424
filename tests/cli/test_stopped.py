"""A simulation that is stopped at the terminal leaves its run, watched or not."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rpctl import Run
from rpctl.simulation.run.part import is_part

PATIENCE_S = 120.0


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rpctl", "track", "paper", "--samples", "0", *words]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for_part(process: subprocess.Popen[str], part: Path) -> None:
    """Wait until samples of a simulation that runs are on disk."""
    patience = time.monotonic() + PATIENCE_S
    while not is_part(part):
        assert process.poll() is None
        assert time.monotonic() < patience
        time.sleep(0.02)


@pytest.mark.slow
def test_interrupt_leaves_run_and_report(tmp_path: Path) -> None:
    words = ("--duration", "600", "--log-every", "2", "--no-perturbed", "--out", "out")
    with start(tmp_path, *words) as process:
        wait_for_part(process, tmp_path / "out" / "run.part")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "(interrupted); the samples until then are kept: out/report.html" in error
    assert error.splitlines()[-1] == "interrupted"
    assert "Traceback" not in error
    out = tmp_path / "out"
    names = {"run.npz", "summary.json", "tracking.png", "report.html"}
    assert {file.name for file in out.iterdir()} == names  # the part is not needed any more
    run, summary = Run.load(out / "run.npz"), json.loads((out / "summary.json").read_text())
    assert 0.0 < run.t[-1] < 600.0
    assert run.t[1] == pytest.approx(0.004)
    assert (summary["duration"], summary["log_every"]) == (run.t[-1], 2)
    assert run.notes[-1] in (out / "report.html").read_text()
