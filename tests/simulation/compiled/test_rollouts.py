"""Runs side by side: each is what it would be alone, and what Python makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.control.fragment import settings_of
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import native_lanes
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.build import LaneResults, LaneRunner
from rpctl.simulation.compiled.lanes import LaneInputs
from rpctl.simulation.compiled.loop import FAR
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.closed_loop import start_configuration
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.measures import Totals, fold, measures
from rpctl.simulation.plants.sensors import Sensors
from tests.grids import cells

STRIDE = 7
SAME = 1e-9


def runner(robot: Robot, config: Config) -> LaneRunner:
    count = round((config.run.duration or 0.0) / config.run.control_period) + 1
    reference = config.run.load_reference(robot)
    scattered = "plant.noise.heading", "plant.delay"
    return LaneRunner(robot, SymbolicDynamics(robot), config, scattered, reference, count)


def inputs(
    robot: Robot, config: Config, errors: Sequence[tuple[float, float, float]]
) -> LaneInputs:
    dynamics, still = rpctl.ReducedDynamics(robot), np.zeros(robot.dof)
    state = config.run.load_reference(robot)(0.0)
    q = np.array([start_configuration(robot, state, error) for error in errors])
    rest = np.array([dynamics.efforts(each, dynamics.bias(each, still)) for each in q])
    kinematic: Any = config.kinematic
    dynamic: Any = config.dynamic
    settings = settings_of(kinematic, dynamic, dynamics, config.run.control_period)
    count = len(errors)
    return LaneInputs(
        q,
        rest,
        np.zeros_like(rest),
        np.zeros((count, 0)),
        np.tile(settings, (count, 1)),
        np.full(rest.shape, np.inf),
        np.zeros(count, dtype=np.int64),
        np.zeros((count, Sensors(robot).width)),
        np.zeros((count, Sensors(robot).width)),
        tuple(range(count)),
    )


def equal(one: LaneResults, other: LaneResults, rows: Sequence[int]) -> bool:
    return all(
        np.array_equal(a[list(rows)], b, equal_nan=True) for a, b in zip(one, other, strict=True)
    )


@pytest.fixture(scope="module")
def config() -> Config:
    return Config(run=RunSettings("eight", 0.3))


@pytest.fixture(scope="module")
def lanes(paper: Robot, config: Config) -> LaneRunner:
    return runner(paper, config)


def test_a_run_is_the_same_whichever_run_beside_it(
    paper: Robot, config: Config, lanes: LaneRunner
) -> None:
    drawn = np.random.default_rng(0).uniform(-0.4, 0.4, (native_lanes() + 3, 3))
    drawn[2] *= 1e8  # one goes astray
    errors = [tuple(row) for row in drawn.tolist()]
    given = inputs(paper, config, errors)
    together = lanes.run(given, STRIDE)
    order = np.random.default_rng(1).permutation(len(errors))
    assert equal(together, lanes.run(given.rows(order), STRIDE), order.tolist())
    assert equal(together, lanes.run(given.rows(slice(4, 5)), STRIDE), [4])


@pytest.mark.parametrize("lanes", cells((2, 4, 8), slow=[2]))
def test_a_run_is_the_same_on_every_processor(
    paper: Robot, config: Config, lanes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = inputs(paper, config, [(0.1, 0.0, 0.0), (0.4, 0.3, -0.5), (-0.2, 0.1, 0.3)])
    expected = runner(paper, config).run(given, STRIDE)
    monkeypatch.setattr("rpctl.simulation.compiled.build.native_lanes", lambda: lanes)
    assert equal(expected, runner(paper, config).run(given, STRIDE), range(3))


def test_a_run_is_what_python_makes_of_it(paper: Robot, config: Config, lanes: LaneRunner) -> None:
    errors = [(0.1, -0.1, 0.1), (0.4, 0.3, -0.5)]
    results = lanes.run(inputs(paper, config, errors), STRIDE)
    for row, error in enumerate(errors):
        run = simulate(
            paper, config.with_run(initial_error=error), collisions=False, backend="pinocchio"
        )
        expected = fold(measures(run))
        for name, value in zip(Totals._fields, results.totals[row], strict=True):
            assert value == pytest.approx(float(getattr(expected, name)), rel=SAME, abs=SAME), name
        assert results.energy[row, 0] == pytest.approx(run.log.work[-1], abs=SAME)
        shown = np.array(measures(run)).T[::STRIDE]
        assert np.abs(results.measures[row] - shown).max() < SAME
    assert not results.trouble.any()


def test_a_run_that_goes_astray_is_told_from_those_beside_it(
    paper: Robot, config: Config, lanes: LaneRunner
) -> None:
    given = inputs(paper, config, [(0.1, 0.0, 0.0)] * 3)
    given.settings[1] = np.nan
    results = lanes.run(given, STRIDE)
    assert results.trouble[1] != 0.0
    assert results.trouble[[0, 2]].tolist() == [0.0, 0.0]
    assert np.isfinite(results.totals[[0, 2]]).all()


@pytest.mark.slow
def test_a_base_that_gets_far_again_is_left_to_python() -> None:
    robot = rpctl.load("car")
    config = Config(run=RunSettings("eight", 2.0))
    given = inputs(robot, config, [(0.0, 0.0, 0.0), (0.8, -0.6, 1.2)])
    lanes = runner(robot, config)
    results = lanes.run(given, STRIDE)
    assert results.trouble.tolist() == [0.0, 0.0]  # the way up brings the second there
    given.bias[0] = 300.0
    results = lanes.run(given, STRIDE)
    assert results.trouble.tolist() == [FAR, 0.0]
    assert results.trouble_at[0] > 0
