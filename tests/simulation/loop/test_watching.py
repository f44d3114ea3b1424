"""What watches a simulation can neither end nor change it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate

SETTINGS = Config(run=RunSettings("eight", 0.02, (0.1, -0.2, 0.3)))


def failing(error: BaseException, after: int) -> tuple[Callable[..., None], list[object]]:
    """Return a watcher that fails at a call, and its calls."""
    calls: list[object] = []

    def watch(*values: object) -> None:
        calls.append(values)
        if len(calls) == after:
            raise error

    return watch, calls


@pytest.mark.parametrize("who", ["watch", "progress"])
@pytest.mark.parametrize("error", [ValueError("too slow"), OSError(28, "full"), MemoryError()])
def test_fault_of_a_watcher_becomes_a_note(
    paper: Robot, tmp_path: Path, who: str, error: Exception
) -> None:
    watch, calls = failing(error, 4)
    watchers: dict[str, Any] = {who: watch}
    run = simulate(paper, SETTINGS, **watchers)
    whole = simulate(paper, SETTINGS)
    np.testing.assert_array_equal(run.q, whole.q)
    np.testing.assert_array_equal(run.tau, whole.tau)
    assert len(calls) == 4, "what failed is not called again"
    (note,) = run.notes
    assert type(error).__name__ in note
    assert str(error) in note
    assert Run.load(run.save(tmp_path / "run.npz")).notes == run.notes


def test_callback_of_track_is_a_watcher(paper: Robot) -> None:
    watch, calls = failing(ZeroDivisionError("mine"), 2)
    run = rpctl.track(paper, "line", duration=0.02, watch=watch)
    assert len(run.t) == 11
    assert len(calls) == 2
    assert "ZeroDivisionError: mine" in run.notes[-1]


def test_interrupt_that_a_watcher_raises_is_obeyed(paper: Robot) -> None:
    watch, calls = failing(KeyboardInterrupt(), 3)
    with pytest.raises(KeyboardInterrupt):
        simulate(paper, SETTINGS, watch=watch)
    assert len(calls) == 3
