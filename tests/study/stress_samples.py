"""Batteries and figures for tests, without a simulation."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rpctl
from rpctl.simulation.config import RunSettings
from rpctl.study.cells import CellRunner, Figures
from rpctl.study.stress_battery import Battery, StressCell, default_pairs, stresses_by_name

RUN = RunSettings(duration=2.0, control_period=0.01, plant_step=0.01)  # of few samples
GOOD = Figures("tracked", "on its way", 2.0, late_base=0.004, late_end_effector=0.006)


def battery(*stresses: str, laws: int = 2, quick: bool = False, **more: Any) -> Battery:
    """Return a battery of the paper's robot on the plant that rolls.

    Args:
        stresses: Their names; all of them if there are none.
        laws: How many pairs, the robot's own first.
        quick: Whether ladders are their ends alone.
        more: Other settings of the battery.
    """
    robot = rpctl.load("paper")
    ladders = stresses_by_name(stresses)
    chosen = tuple(each.extremes() for each in ladders) if quick else ladders
    given = {"plants": ("rolling",), "run": RUN, **more}
    return Battery(robot, default_pairs(robot)[:laws], stresses=chosen, **given)


def made_up(key: str) -> Figures:
    """Return figures that follow from a cell's key, good and bad ones."""
    number = zlib.crc32(key.encode()) % 1000
    if not number % 5:
        return replace(GOOD, outcome="stuck", sentence=f"stands at {number}")
    return replace(GOOD, late_base=4e-5 * number, late_end_effector=None)


def patch_runs(monkeypatch: pytest.MonkeyPatch, stop_after: int | None = None) -> list[str]:
    """Let cells have made-up figures; return the list of those that run.

    Args:
        monkeypatch: Pytest's.
        stop_after: How many cells run before a Ctrl-C; None: it does not come.
    """
    ran: list[str] = []

    def run(runner: CellRunner, cell: StressCell) -> Figures:
        if stop_after is not None and len(ran) == stop_after:
            raise KeyboardInterrupt
        ran.append(cell.key)
        return made_up(cell.key)

    monkeypatch.setattr(CellRunner, "__call__", run)
    return ran


def contents(folder: Path, names: Sequence[str] = ()) -> dict[str, bytes]:
    """Return the bytes of a folder's files, by name; of all of them if none is named."""
    files = [folder / name for name in names] or sorted(folder.iterdir())
    return {file.name: file.read_bytes() for file in files}
