"""Settings that are found: costs whose least is known by paper, a search that can be resumed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rpctl import IntegralDynamic, Robot, RpctlError, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.simulation.config import Config, read_config
from rpctl.study.optimise import JOURNAL_FILE, optimise, setting, start_point
from rpctl.study.scatter import LogUniform, Scatter, Uniform
from rpctl.study.study import Optimisation, Study
from rpctl.study.study_file import read_study
from tests.grids import cells
from tests.study.fake_rollouts import OddExecutor, patch_rollouts

TEXT = """
[study]
seed = 2
chunk = 100
[dynamic]
law = "integral"
gain = 15.0
[scatter]
"plant.delay" = { uniform = [0.0, 1.0] }
[optimize]
evaluations = 64
runs = 12
validation = 60
STATISTIC
[optimize.parameters]
"dynamic.gain" = [1.0, 30.0]
"""
KNOWN = "dynamic.gain"


def quadratic(numbers: Array, gain: Array, delay: Array) -> Array:
    """Return .1 + .01 (gain − 20)² + delay/100: the least mean and quantile are at a gain of 20."""
    return np.asarray(0.1 + 0.01 * (gain - 20.0) ** 2 + 0.01 * delay)


def trading(numbers: Array, gain: Array, delay: Array) -> Array:
    """Return .02 gain, without a merit where gain · (1 − delay) is below 3: a robust gain fails
    rarely, and costs."""
    return np.where(gain * (1.0 - delay) < 3.0, np.inf, 0.02 * gain)


def study_of(robot: Robot, folder: Path, statistic: str = "") -> Study:
    path = folder / "study.toml"
    path.write_text(TEXT.replace("STATISTIC", statistic))
    return read_study(path, robot)


STATISTICS = ["", "statistic = 'quantile'", "statistic = 'worst'"]


@pytest.mark.parametrize("statistic", cells(STATISTICS, STATISTICS[1:2], STATISTICS[::2]))
def test_the_least_cost_is_found_and_validated(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statistic: str
) -> None:
    patch_rollouts(monkeypatch, quadratic, KNOWN)
    out = tmp_path / "out"
    found = optimise(paper, study_of(paper, tmp_path, statistic), out)
    gain = found["settings"][KNOWN]["after"]
    assert gain == pytest.approx(20.0, abs=0.3)
    assert (found["settings"][KNOWN]["before"], found["settings"][KNOWN]["range"]) == (15, [1, 30])
    assert setting(read_config(out / "optimized.toml"), KNOWN) == gain
    assert json.loads((out / "optimum.json").read_text()) == json.loads(
        json.dumps(found).replace("Infinity", "null")
    )
    checked = found["validation"]
    assert checked["seed"] != found["seed"]
    assert checked["runs"] == 60
    assert checked["better"]["value"] == 1.0
    share = {"": 0.5, "statistic = 'quantile'": 0.95}.get(statistic, 1.0)
    for name, at in (("before", 15.0), ("after", gain)):
        expected = 0.1 + 0.01 * (at - 20.0) ** 2 + 0.01 * share
        each = checked[name]
        assert each["statistic"]["value"] == pytest.approx(expected, abs=0.002)
        failed = 1.0 - each["success"]["value"]
        assert each["cost"] == pytest.approx(each["statistic"]["value"] + failed)
    assert found["history"] == sorted(found["history"], reverse=True)
    assert found["evaluations"] == 64


@pytest.mark.slow
def test_failures_cost(paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_rollouts(monkeypatch, trading, KNOWN)
    gains = []
    for weight in (0.01, 10.0):
        found = optimise(
            paper,
            study_of(paper, tmp_path, f"failure_weight = {weight}"),
            tmp_path / f"{weight}",
        )
        gains.append(found["settings"][KNOWN]["after"])
    assert gains[0] < 6.0
    assert gains[1] > 12.0  # of 12 runs that are spread evenly the last fails below
    assert found["validation"]["after"]["missing"] < found["validation"]["before"]["missing"]


def test_a_search_goes_on_where_it_was_ended(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch_rollouts(monkeypatch, quadratic, KNOWN)
    study = study_of(paper, tmp_path)
    whole = OddExecutor()
    expected = optimise(paper, study, tmp_path / "whole", whole)
    told: list[tuple[int, int]] = []
    with pytest.raises(KeyboardInterrupt):
        optimise(paper, study, tmp_path / "part", OddExecutor(most=0),
                 lambda *x: told.append(x))  # fmt: skip
    journal = tmp_path / "part" / "optimize" / JOURNAL_FILE
    assert len(journal.read_text().splitlines()) == 1  # each generation is kept whole
    ends = OddExecutor(calls=3)
    with pytest.raises(KeyboardInterrupt):
        optimise(paper, study, tmp_path / "part", ends, resume=True)
    assert len(journal.read_text().splitlines()) == 4
    best = setting(read_config(tmp_path / "part" / "optimized.toml"), KNOWN)
    assert best == pytest.approx(20.0, abs=4.0)
    rest = OddExecutor(seed=3, workers=2)
    found = optimise(paper, study, tmp_path / "part", rest, resume=True)
    assert rest.rows == whole.rows - 3 * 8 * 12
    assert {**found, "config": ""} == {**expected, "config": ""}
    with pytest.raises(RpctlError, match="add --resume"):
        optimise(paper, study, tmp_path / "part")
    other = study_of(paper, tmp_path, "statistic = 'worst'")
    with pytest.raises(RpctlError, match=r"optimize\.statistic: mean there"):
        optimise(paper, other, tmp_path / "part", resume=True)


def test_settings_meet_the_same_scatter(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    met: dict[float, list[tuple[int, float]]] = {}

    def watched(numbers: Array, gain: Array, delay: Array) -> Array:
        for number, value, late in zip(
            numbers.tolist(), gain.tolist(), delay.tolist(), strict=True
        ):
            met.setdefault(value, []).append((number, late))
        return quadratic(numbers, gain, delay)

    patch_rollouts(monkeypatch, watched, KNOWN)
    optimise(paper, study_of(paper, tmp_path), tmp_path / "out", OddExecutor(seed=1))
    searched = [sorted(each)[:12] for each in met.values() if len(each) == 12]
    assert len(searched) > 40
    assert all(each == searched[0] for each in searched)
    assert len({late for _, late in searched[0]}) == 12
    fresh = {late for each in met.values() if len(each) >= 60 for _, late in each[-60:]}
    assert not fresh & {late for _, late in searched[0]}


def test_a_search_without_any_end_is_told(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch_rollouts(monkeypatch, lambda numbers, gain, delay: np.full(len(gain), np.inf), KNOWN)
    with pytest.raises(RpctlError, match="let a run reach its end"):
        optimise(paper, study_of(paper, tmp_path), tmp_path / "out")


def test_the_start_is_what_the_configuration_has() -> None:
    config = Config(UnifiedKinematic(horizon=0.65), IntegralDynamic(15.0))
    ranges = Scatter({KNOWN: LogUniform(1.5, 150.0), "kinematic.horizon": Uniform(0.0, 1.3)})
    assert start_point(config, ranges) == pytest.approx([0.5, 0.5])
    assert start_point(config, Scatter({KNOWN: Uniform(16.0, 17.0)})) is None
    assert start_point(config, Scatter({"plant.contact.wheel_width": Uniform(0.0, 1.0)})) is None
    slow = config.with_run(control_period=0.05)  # k = 6/11 · 0.8/(0.025 + 0.05)
    joints = Scatter({"dynamic.joint_gain": Uniform(0.0, 128.0 / 11.0)})
    assert start_point(slow, joints) == pytest.approx([0.5])


def test_the_statistics_are_those_of_their_names() -> None:
    merit = np.array([3.0, 1.0, np.inf, 2.0, 10.0])
    success = np.array([True, True, False, False, True])
    for name, figure in (("mean", 4.0), ("worst", 10.0), ("quantile", 3.0)):
        asked = Optimisation(statistic=name, level=0.75, failure_weight=5.0)
        assert asked.cost(merit, success) == figure + 5.0 * 0.4
    assert asked.cost(np.full(2, np.inf), np.zeros(2, bool)) == np.inf
