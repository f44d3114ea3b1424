"""Rollouts: a row is the run of its configuration, and nothing else changes it."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpctl import Guards, PaperDynamic, Robot, RpctlError
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.compiled import build
from rpctl.simulation.config import Config, RunSettings, read_config, write_config
from rpctl.simulation.loop.track import simulate
from rpctl.study.experiment import Design, Experiment
from rpctl.study.merits import run_merits
from rpctl.study.rollout import Rollouts, rollout
from rpctl.study.runner import Runner
from rpctl.study.scatter import AnyOf, Normal, Uniform, scatter_of, settings_at

SCATTER = {
    "run.initial_error.y": Normal(0.0, 0.05),
    "kinematic.horizon": Uniform(0.3, 0.5),
    "plant.joint_friction.wheel_*": Uniform(0.0, 0.1),
    "plant.payload.mass": Uniform(0.1, 2.0),
    "plant.losses": Uniform(0.5, 3.0),
    "plant.effort": Uniform(0.1, 0.9),
    "plant.effort_lag": Uniform(0.001, 0.02),
    "plant.backlash.arm_*": Uniform(0.0, 0.001),
    "plant.encoder_bits": Uniform(10.0, 16.0),
    "plant.sensor_bias.heading": Uniform(-0.01, 0.01),
    "plant.slope.along_x": Uniform(-0.02, 0.02),
}
SHORT: dict[str, Any] = {"duration": 0.1, "control_period": 0.01, "plant_step": 0.01}


@pytest.fixture(scope="module")
def runs(paper: Robot) -> Rollouts:
    return rollout(
        paper, "eight", SCATTER, count=4, seed=3, samples=4, backend="pinocchio", **SHORT
    )


def test_a_row_is_replayed_by_its_configuration_file(
    runs: Rollouts, paper: Robot, tmp_path: Path
) -> None:
    config = read_config(write_config(runs.config(2), tmp_path / "run.toml"))
    run = simulate(paper, config, collisions=False)
    drawn = dict(zip(runs.names, runs.parameters[2].tolist(), strict=True))
    plant = config.plant
    assert plant.encoder_bits == round(drawn["plant.encoder_bits"])
    found = plant.payload.mass, plant.losses, plant.effort, plant.effort_lag, plant.slope[0]
    names = "payload.mass", "losses", "effort", "effort_lag", "slope.along_x"
    assert found == tuple(drawn[f"plant.{name}"] for name in names)
    merits, verdict = run_merits(run)
    assert {name: runs.merits[name][2] for name in merits} == merits
    assert verdict == (runs.outcomes[2], runs.results.reasons[2])
    away = np.hypot(run.log.e[:, 0], run.log.e[:, 1])
    assert runs.t.tolist() == run.t[::3].tolist()
    np.testing.assert_allclose(runs.base_error[2], away[::3], rtol=1e-14)
    assert runs.lateral_error[2].tolist() == np.abs(run.log.e[::3, 1]).tolist()
    reach = np.linalg.norm(run.log.ee - run.log.ee_ref, axis=1)
    assert runs.end_effector_error[2].tolist() == reach[::3].tolist()


EVERYTHING: dict[str, Any] = {
    "plant.masses.*": Uniform(0.9, 1.1),
    "plant.centres.*.x": Normal(0.0, 0.01),
    "plant.inertias.base_link": Uniform(0.9, 1.1),
    "plant.joint_friction.*": Uniform(0.0, 0.05),
    "plant.damping.wheel_*": Uniform(0.0, 0.05),
    "plant.tau_bias.wheel_left_joint": Normal(0.0, 0.1),
    "plant.radii.*": Normal(1.0, 0.01),
    "plant.track": Normal(1.0, 0.01),
    "plant.delay": Uniform(0.0, 0.03),
    "plant.noise.heading": Uniform(0.0, 0.005),
    "run.initial_error.y": Normal(0.0, 0.1),
    "kinematic.horizon": Uniform(0.3, 0.5),
}


@pytest.fixture(scope="module")
def compiled(paper: Robot) -> Rollouts:
    return rollout(
        paper, "eight", EVERYTHING, count=3, seed=3, samples=7, backend="compiled",
        duration=0.3, control_period=0.01, plant_step=0.01,
    )  # fmt: skip


@pytest.mark.slow
def test_machine_code_gives_what_its_configuration_gives(compiled: Rollouts, paper: Robot) -> None:
    for i in range(3):
        merits, judged = run_merits(
            simulate(paper, compiled.config(i), collisions=False, backend="pinocchio")
        )
        found = {name: float(compiled.merits[name][i]) for name in merits}
        assert found == pytest.approx(merits, rel=1e-9, abs=1e-12)
        assert compiled.outcomes[i] == judged.outcome
    slow = dataclasses.replace(compiled.experiment, backend="pinocchio")
    python = Runner(paper, slow).rows(compiled.parameters, [0, 1, 2])
    assert np.array_equal(compiled.t, python.t)
    for name, series in python.series.items():
        np.testing.assert_allclose(compiled.results.series[name], series, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_lanes_do_not_know_of_each_other(compiled: Rollouts, paper: Robot) -> None:
    """Bit for bit, alone and in any order, and beside refused and lossless runs."""
    experiment, values = compiled.experiment, compiled.parameters
    odd = values[[0, 0]].copy()
    names = list(compiled.names)
    odd[0, names.index("plant.masses.*")] = -1.0
    odd[1, [names.index("plant.joint_friction.*"), names.index("plant.damping.wheel_*")]] = 0.0
    table = Runner(paper, experiment).rows(np.vstack([odd, values[[2, 0]]]), [7, 8, 2, 0])
    assert table.outcomes[0] == "refused"
    assert "masses of * is -1" in table.reasons[0]
    assert table.outcomes[2:] == (compiled.outcomes[2], compiled.outcomes[0])
    for name, found in table.merits.items():
        assert found[2:].tolist() == compiled.merits[name][[2, 0]].tolist(), name
    for name, series in table.series.items():
        assert np.array_equal(series[2:], compiled.results.series[name][[2, 0]]), name
    merits, _ = run_merits(
        simulate(paper, experiment.config_of(odd[1], 8), collisions=False, backend="pinocchio")
    )
    assert table.merits["work"][1] == merits["work"]
    assert table.merits["lost"][1] == 0.0


def test_machine_code_that_cannot_be_is_refused(paper: Robot) -> None:
    with pytest.raises(RpctlError, match=r"cannot be compiled: samples are dropped; take"):
        rollout(paper, scatter={"plant.dropped": 0.1}, count=1, backend="compiled", **SHORT)
    with pytest.raises(RpctlError, match="backend 'fast' is not known"):
        rollout(paper, count=1, backend="fast", **SHORT)


def test_more_runs_are_added_behind() -> None:
    scatter = scatter_of(SCATTER, Config())
    more, few, other = (
        settings_at(scatter, Design(count=count, seed=seed).points(len(scatter.names)))
        for count, seed in ((7, 5), (4, 5), (4, 6))
    )
    assert np.array_equal(more[:4], few)
    assert not np.array_equal(few, other)


@pytest.mark.parametrize("backend", ["pinocchio", "compiled"])
def test_a_run_that_fails_is_a_row(paper: Robot, backend: str) -> None:
    guards = Guards(effort_rate=1e12)  # at the usual rate the last one ends in time
    config = Config(dynamic=PaperDynamic(), run=RunSettings(**SHORT), guards=guards)
    experiment = Experiment(config, ("kinematic.horizon", "run.initial_error.y"), backend=backend)
    values = np.array([[-1.0, 0.0], [0.4, 0.01], [1e-6, 1.0]])
    table = Runner(paper, experiment).rows(values, [0, 1, 2])
    assert table.outcomes == ("refused", "tracked", "diverging")
    assert "horizon is -1" in table.reasons[0]
    assert [math.isinf(x) for x in table.merits["work"].tolist()] == [True, False, True]
    assert np.isnan(table.series["base_error"][0]).all()
    assert table.series["base_error"][2, 0] == pytest.approx(1.0)
    assert np.isnan(table.series["base_error"][2, -1])


def test_quantiles_and_worst_count_failures_last(runs: Rollouts) -> None:
    merits = {"work": np.array([3.0, math.inf, 1.0, 2.0])}
    results = dataclasses.replace(runs.results, merits=merits)
    made = dataclasses.replace(runs, results=results)
    assert [made.quantile("work", p) for p in (0.0, 0.25, 0.5, 0.75, 0.76)] == [
        1,
        1,
        2,
        3,
        math.inf,
    ]
    assert made.worst("work", 3).tolist() == [1, 0, 3]
    with pytest.raises(RpctlError, match="merit 'wrk' is not known; did you mean work"):
        made.quantile("wrk", 0.5)


def test_progress_never_goes_back(paper: Robot) -> None:
    told: list[tuple[int, int]] = []
    rollout(
        paper,
        count=3,
        progress=lambda done, count: told.append((done, count)),
        dynamic=PaperDynamic(),
        **SHORT,
    )
    assert told == sorted(told)
    assert told[-1] == (3, 3)


def test_the_table_has_a_column_of_each(runs: Rollouts) -> None:
    table = runs.table()
    assert table["run"].tolist() == [0, 1, 2, 3]
    assert table["kinematic.horizon"].tolist() == runs.parameters[:, 1].tolist()
    assert table["work"].tolist() == runs.merits["work"].tolist()
    assert table["outcome"].tolist() == list(runs.outcomes)


def test_runs_without_losses_among_those_with_some_are_python_s(paper: Robot) -> None:
    """They step otherwise; here all are such runs."""
    scatter = {"plant.joint_friction.*": AnyOf(0.0), "run.initial_error.y": Uniform(0.0, 0.1)}
    found = rollout(paper, "eight", scatter, count=2, backend="compiled", **SHORT)
    plain = rollout(paper, "eight", scatter, count=2, backend="pinocchio", **SHORT)
    np.testing.assert_array_equal(found.base_error, plain.base_error)


def test_a_rollout_whose_loop_is_kept_builds_no_graph(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process, and in another one, which has what is on disk only."""
    scatter = {"plant.masses.*": Uniform(0.9, 1.1), "run.initial_error.y": Normal(0.0, 0.05)}
    settings: dict[str, Any] = {**SHORT, "backend": "compiled"}
    first = rollout(paper, "eight", scatter, count=8, **settings)

    def refused(*_: object) -> None:
        raise AssertionError("a graph is built")

    monkeypatch.setattr(SymbolicDynamics, "p", property(refused))
    monkeypatch.setattr(SymbolicDynamics, "_known", property(refused))
    for kept in (build._kept_runs, {}):
        monkeypatch.setattr(build, "_kept_runs", kept)
        again = rollout(paper, "eight", scatter, count=8, **settings)
        np.testing.assert_array_equal(again.base_error, first.base_error)
    with pytest.raises(AssertionError, match="a graph is built"):
        rollout(paper, "eight", {"plant.inertias.*": Uniform(0.9, 1.1)}, count=8, **settings)
