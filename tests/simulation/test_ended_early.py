"""A loop that ends early leaves whole samples: a run like any other, as far as it came."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation import log
from rpctl.simulation.closed_loop import WatchedSample, Watcher
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import simulate
from rpctl.simulation.run_file import ARRAY_ENTRIES

SETTINGS = Config(run=RunSettings("eight", 0.03, (0.1, -0.2, 0.3)))


def ended_run(
    robot: Robot,
    error: type[BaseException],
    config: Config = SETTINGS,
    watch: Watcher | None = None,
) -> Run:
    """Return what is kept of a simulation that an exception ends."""
    kept: list[Run] = []
    with pytest.raises(error):
        simulate(robot, config, ended=kept.append, watch=watch)
    (run,) = kept
    return run


def check_is_beginning(run: Run, whole: Run, count: int) -> None:
    """Assert that a run is the first samples of another one, bit by bit."""
    assert len(run.t) == count
    for name in ARRAY_ENTRIES - {"active_limits"}:  # which has a column for what bound so far
        np.testing.assert_array_equal(
            getattr(run.log, name), getattr(whole.log, name)[:count], err_msg=name
        )


def test_watcher_that_ends_it_leaves_the_samples_so_far(tiago: Robot, tmp_path: Path) -> None:
    def watch(sample: WatchedSample) -> None:
        if sample.t > 0.0129:
            raise KeyboardInterrupt

    whole = simulate(tiago, SETTINGS)
    run = ended_run(tiago, KeyboardInterrupt, watch=watch)
    count = 8  # 0, 2, ..., 14 ms
    check_is_beginning(run, whole, count)
    assert run.config.run.duration == run.t[-1] == pytest.approx(0.014)
    assert run.notes[-1] == "ended at 0.014 of 0.03 s (interrupted); what was simulated is kept"
    again = Run.load(run.save(tmp_path / "run.npz"))
    check_is_beginning(again, whole, count)
    assert again.notes == run.notes
    assert rpctl.summarize(again).duration == pytest.approx(0.014)


@pytest.mark.parametrize("place", ["reference_rates", "_ground", "_end_effector"])
def test_interrupt_amid_a_sample_leaves_the_whole_ones(
    paper: Robot, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    whole = simulate(paper, SETTINGS)
    inner, calls = getattr(log, place), []

    def interrupted(*values: object) -> object:
        calls.append(place)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return inner(*values)

    monkeypatch.setattr(log, place, interrupted)
    kept: list[Run] = []
    with pytest.raises(KeyboardInterrupt):
        simulate(paper, SETTINGS, ended=kept.append)
    monkeypatch.undo()
    check_is_beginning(kept[0], whole, 5)


def test_error_of_a_law_is_what_the_note_says(paper: Robot) -> None:
    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        if nu.any():
            raise ValueError("no effort for this")
        return Efforts(np.ones(4))

    config = Config(run=SETTINGS.run, dynamic=law)
    kept: list[Run] = []
    with pytest.raises(ValueError, match="no effort"):
        simulate(paper, config, ended=kept.append)
    assert kept == []  # one sample is no motion
    note = "ended at 0.01 of 0.03 s (no effort for this); what was simulated is kept"

    def later(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        if nu[0] > 0.00149:
            raise ValueError("no effort for this")
        return Efforts(np.array([1.0, 1.0, 0.0, 0.0]))

    run = ended_run(paper, ValueError, config=Config(run=SETTINGS.run, dynamic=later))
    assert run.notes == (note.replace("0.01", f"{run.t[-1]:.4g}", 1),)


def test_motion_that_leaves_the_numbers_ends_before_its_first_infinite_sample(
    paper: Robot, tmp_path: Path
) -> None:
    calls: list[float] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        calls.append(0.0)
        return Efforts(np.full(4, np.inf if len(calls) > 5 else 0.0))

    config = Config(run=SETTINGS.run, dynamic=law)
    with np.errstate(all="ignore"):
        run = ended_run(paper, RpctlError, config=config)
    assert len(run.t) == 5
    assert all(np.isfinite(getattr(run.log, name)).all() for name in ARRAY_ENTRIES)
    assert len(Run.load(run.save(tmp_path / "run.npz")).t) == len(run.t)
