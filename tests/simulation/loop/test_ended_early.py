"""A loop that ends early leaves whole samples: a run like any other, as far as it came."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts
from rpctl.control.safeguards import Guards
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import recorder
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.collision_facts import NOT_LOOKED_FOR
from rpctl.simulation.run.log import COLUMNS, MIN_SAMPLES

SETTINGS = Config(run=RunSettings("eight", 0.03, (0.1, -0.2, 0.3)))


def ended_run(
    robot: Robot,
    error: type[BaseException],
    config: Config = SETTINGS,
    watch: Callable[[LoopSample], None] | None = None,
) -> Run:
    """Return what is kept of a simulation that an exception ends."""
    kept: list[Run] = []
    with pytest.raises(error):
        simulate(robot, config, ended=kept.append, watch=watch)
    (run,) = kept
    return run


def check_is_beginning(run: Run, whole: Run, count: int) -> None:
    """Assert that a run is the first samples of another one."""
    assert len(run.t) == count
    for name in COLUMNS.keys() - {"active_limits"}:  # which has a column for what bound so far
        logged, expected = getattr(run.log, name), getattr(whole.log, name)[:count]
        np.testing.assert_allclose(logged, expected, rtol=1e-12, atol=1e-12, err_msg=name)


def test_watcher_that_ends_it_leaves_the_samples_so_far(paper: Robot, tmp_path: Path) -> None:
    def watch(sample: LoopSample) -> None:
        if sample.t > 0.0129:
            raise KeyboardInterrupt

    whole = simulate(paper, SETTINGS)
    run = ended_run(paper, KeyboardInterrupt, watch=watch)
    count = 8  # 0, 2, ..., 14 ms
    check_is_beginning(run, whole, count)
    assert run.config.run.duration == run.t[-1] == pytest.approx(0.014)
    assert (
        run.notes[-1] == "ended at 0.014 of 0.03 s (interrupted); the samples until then are kept"
    )
    again = Run.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.q, run.q)
    assert again.notes == run.notes
    assert rpctl.summarize(again).duration == pytest.approx(0.014)


@pytest.mark.parametrize("bad", range(1, 9))
def test_sample_that_is_no_motion_ends_the_run_before_it(
    paper: Robot, monkeypatch: pytest.MonkeyPatch, bad: int
) -> None:
    """Wherever in a batch it is; what was simulated behind it does not count."""
    monkeypatch.setattr(recorder, "BATCH", 4)
    whole, take = simulate(paper, SETTINGS), recorder.Recorder.add

    def spoilt(self: recorder.Recorder, sample: LoopSample) -> None:
        nu = np.full(4, np.inf) if sample.t == whole.t[bad] else sample.nu
        take(self, sample._replace(nu=nu))

    monkeypatch.setattr(recorder.Recorder, "add", spoilt)
    kept: list[Run] = []
    with pytest.raises(RpctlError, match=rf"the motion diverged at t = {whole.t[bad]:g} s"):
        simulate(paper, SETTINGS, ended=kept.append)
    if bad < MIN_SAMPLES:
        assert kept == []
    else:
        check_is_beginning(kept[0], whole, bad)
        assert (
            f"ended at {whole.t[bad - 1]:.4g} of 0.03 s (the motion diverged" in kept[0].notes[-1]
        )


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
    note = "ended at 0.01 of 0.03 s (no effort for this); the samples until then are kept"

    def later(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        if nu[0] > 0.00149:
            raise ValueError("no effort for this")
        return Efforts(np.array([1.0, 1.0, 0.0, 0.0]))

    run = ended_run(paper, ValueError, config=Config(run=SETTINGS.run, dynamic=later))
    assert run.notes == (NOT_LOOKED_FOR, note.replace("0.01", f"{run.t[-1]:.4g}", 1))


def test_motion_that_nothing_moves_with_ends_the_run_which_can_be_read(
    paper: Robot, tmp_path: Path
) -> None:
    calls: list[float] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        calls.append(0.0)
        return Efforts(np.full(4, 1e40 if len(calls) > 5 else 0.0))

    config = Config(run=SETTINGS.run, dynamic=law, guards=Guards(effort_rate=1e12))
    with np.errstate(all="ignore"):
        run = ended_run(paper, RpctlError, config=config)
    assert len(run.t) == 6
    assert all(np.isfinite(getattr(run.log, name)).all() for name in COLUMNS)
    assert len(Run.load(run.save(tmp_path / "run.npz")).t) == len(run.t)
