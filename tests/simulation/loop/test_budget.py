"""What a run will cost is known before it begins, and refused beyond the caps."""

from __future__ import annotations

from dataclasses import replace

import pytest

import rpctl
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.budget import find_budget, in_bytes, in_time
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.plants.plant import Plant
from tests.grids import cells

SHORT = RunSettings(duration=0.1)


@pytest.mark.parametrize("name", cells(("paper", "swerve"), ["paper"], ["swerve"]))
def test_size_of_the_log_is_foreseen(name: str) -> None:
    robot = rpctl.load(name)
    run = simulate(robot, Config(run=SHORT))
    taken = sum(array.nbytes for array in run.log.arrays().values())
    budget = find_budget(robot, SHORT, 0.1)
    assert budget.rows == len(run.t) == 51
    assert 0.85 < budget.log_bytes / taken < 1.2


def test_costs_are_those_of_periods_steps_and_rows() -> None:
    robot = rpctl.load("paper")
    plain = find_budget(robot, SHORT, 10.0)
    assert (plain.periods, plain.plant_steps, plain.rows) == (5000, 5000, 5001)
    fine = find_budget(robot, replace(SHORT, plant_step=0.0005), 10.0)
    assert (fine.periods, fine.plant_steps) == (5000, 20_000)
    assert fine.seconds > plain.seconds
    sparse = find_budget(robot, replace(SHORT, log_every=10), 10.0)
    assert sparse.rows == 501
    assert sparse.log_bytes < 0.11 * plain.log_bytes


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (RunSettings(duration=20.0, control_period=1e-9), "MAX_RUN_SECONDS"),
        (RunSettings(duration=20.0, plant_step=1e-9), "MAX_RUN_SECONDS"),
        (RunSettings(duration=1e12), "MAX_RUN_SECONDS"),
        (RunSettings(duration=50_000.0, log_every=1), "MAX_RUN_BYTES"),
    ],
)
def test_run_beyond_a_cap_is_refused_before_it_begins(settings: RunSettings, named: str) -> None:
    robot = rpctl.load("paper")
    with pytest.raises(RpctlError, match=rf"the run would .* control periods, .*RPCTL_{named}"):
        simulate(robot, Config(run=settings), watch=lambda sample: pytest.fail("it began"))


def test_cap_is_raised_as_the_message_says(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = rpctl.load("paper")
    monkeypatch.setenv("RPCTL_MAX_RUN_BYTES", "1000")
    with pytest.raises(RpctlError, match="would log too much"):
        simulate(robot, Config(run=SHORT))
    monkeypatch.setenv("RPCTL_MAX_RUN_BYTES", "100000")
    assert len(simulate(robot, Config(run=SHORT)).t) == 51


def test_delay_longer_than_the_run_is_refused() -> None:
    with pytest.raises(RpctlError, match=r"delay is 1e\+06 s, longer than the run of 0.1 s"):
        simulate(rpctl.load("paper"), Config(run=SHORT, plant=Plant(delay=1e6)))


def test_a_long_run_logs_as_many_samples_as_there_is_room_for() -> None:
    budget = find_budget(rpctl.load("paper"), SHORT, 3600.0)
    assert budget.rows == 25_001
    assert budget.log_bytes < 50e6


def test_amounts_are_said_in_units_that_suit_them() -> None:
    times, sizes = (0.5, 90.0, 7200.0, 2e6), (0, 20, 17e6, 3e15)
    assert [*map(in_time, times)] == ["0.5 s", "90 s", "2 hours", "23.1 days"]
    assert [*map(in_bytes, sizes)] == ["0 bytes", "20 bytes", "17 MB", "3e+03 TB"]
