"""Runs of studies: the same rows however they are cut, kept, resumed, replayed."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, RpctlError
from rpctl.arrays import Array
from rpctl.simulation.config import read_config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.study.executor import Executor
from rpctl.study.experiment import DESIGNS
from rpctl.study.runner import chunk_size
from rpctl.study.store import installed, read_runs
from rpctl.study.study import Study, run_study
from rpctl.study.study_file import read_study
from rpctl.study.study_result import StudyResult, read_result
from tests.grids import cells
from tests.study.fake_rollouts import OddExecutor, patch_rollouts

SHORT = """
[study]
count = 5
duration = 0.1
samples = 3
seed = 3
[run]
reference = "circle"
control_period = 0.02
plant_step = 0.02
[limits.effort]
"*" = 50.0
[scatter]
"plant.delay" = { uniform = [0.0, 0.05] }
"run.initial_error.y" = { normal = [0.0, 0.1] }
"kinematic.horizon" = { uniform = [0.3, 0.6] }
"""
FAKE = """
[study]
count = 40
chunk = 20
design = "DESIGN"
[scatter]
"plant.delay" = { uniform = [0.0, 1.0] }
"plant.dropped" = { uniform = [0.0, 0.5] }
"""


def study_of(robot: Robot, folder: Path, text: str) -> Study:
    path = folder / "a-study.toml"
    path.write_text(text)
    return read_study(path, robot)


def chunked(study: Study, size: int) -> Study:
    return replace(study, settings=replace(study.settings, chunk=size))


def error(numbers: Array, delay: Array, dropped: Array) -> Array:
    """Return 2 delay + a little of the rest; without a merit where the delay is large."""
    return np.where(delay > 0.95, np.inf, 2.0 * delay + 0.1 * dropped + 1e-3 * np.sin(numbers))


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    patch_rollouts(monkeypatch, error)


class PickledExecutor(OddExecutor):
    """Sends work and chunks as bytes, as other processes get them."""

    def map_chunks(self, work: Any, chunks: Any) -> Iterator[tuple[Any, Any]]:
        sent = pickle.loads(pickle.dumps(work))
        through = (pickle.loads(pickle.dumps(each)) for each in chunks)
        yield from super().map_chunks(sent, through)


def test_rows_do_not_depend_on_chunks_or_their_order(paper: Robot, tmp_path: Path) -> None:
    study = study_of(paper, tmp_path, SHORT)
    files = [
        run_study(paper, chunked(study, size), tmp_path / f"{size}", executor).read_bytes()
        for size, executor in ((5, Executor()), (2, PickledExecutor(seed=1)))
    ]
    assert files[0] == files[1]
    runs = read_runs(tmp_path / "5" / "runs.parquet")[0]
    assert len({*runs.merits["rms_base_error"].tolist()}) == 5
    assert runs.series["base_error"].shape == (5, len(runs.t))
    # the worst run's file is a run like any other, and has its merit
    replayed(paper, read_result(tmp_path / "5"))


def replayed(robot: Robot, result: StudyResult) -> None:
    """Check that the configurations of the worst runs replay them."""
    merit = result.runs.merits[result.merit]
    assert result.worst[0].run == int(np.argmax(merit))
    for each in result.worst[:1]:
        config = read_config(each.config)
        known = config.limits.apply(robot)
        run = simulate(known, config, config.run.load_reference(known), collisions=False)
        found = summarize(run)
        assert found.rms_base_error == pytest.approx(each.value, rel=1e-9)
        ratio = result.runs.merits["max_effort_ratio"][each.run]
        assert found.max_effort_ratio == pytest.approx(ratio, rel=1e-9)
        assert each.value == merit[each.run]
        assert each.command == f"rpctl track paper --config {each.config} --out {each.config[:-5]}"


@pytest.mark.usefixtures("fake")
def test_what_is_done_is_kept_and_goes_on(paper: Robot, tmp_path: Path) -> None:
    study = chunked(study_of(paper, tmp_path, FAKE.replace("DESIGN", "monte-carlo")), 7)
    whole = run_study(paper, study, tmp_path / "whole").read_bytes()
    told: list[tuple[int, int]] = []
    with pytest.raises(KeyboardInterrupt):
        run_study(
            paper, study, tmp_path / "part", OddExecutor(most=2, seed=0), lambda *x: told.append(x)
        )
    assert told == [(0, 40), (7, 40), (14, 40)]
    assert not (tmp_path / "part" / "runs.parquet").exists()
    with pytest.raises(RpctlError, match="holds a study; add --resume"):
        run_study(paper, study, tmp_path / "part")
    rest = OddExecutor(seed=5)
    again = chunked(study, 4)
    path = run_study(paper, again, tmp_path / "part", rest, lambda *x: told.append(x), resume=True)
    assert rest.rows == 26
    assert told[3] == (14, 40)
    assert path.read_bytes() == whole
    nothing = OddExecutor()
    run_study(paper, study, tmp_path / "part", nothing, resume=True)
    assert nothing.rows == 0


@pytest.mark.usefixtures("fake")
def test_more_runs_extend_a_study(paper: Robot, tmp_path: Path) -> None:
    text = FAKE.replace("DESIGN", "monte-carlo")
    run_study(paper, study_of(paper, tmp_path, text), tmp_path / "out")
    more, executor = text.replace("count = 40", "count = 55"), OddExecutor()
    path = run_study(
        paper, study_of(paper, tmp_path, more), tmp_path / "out", executor, resume=True
    )
    assert executor.rows == 15
    fresh = run_study(paper, study_of(paper, tmp_path, more), tmp_path / "fresh")
    assert path.read_bytes() == fresh.read_bytes()


CHANGES = [
    ("count = 40", "count = 40\nseed = 4", r"design\.seed: 0 there, 4 here"),
    ("count = 40", "count = 40\nsamples = 9", r"experiment\.samples: 200 there, 9 here"),
    ("[0.0, 0.5]", "[0.0, 0.4]", r"dropped\.uniform: \[0.0, 0.5\] there, \[0.0, 0.4\] here"),
    ("count = 40", "count = 41", r"design\.count: 40 there, 41 here"),
    ("[scatter]", "[kinematic]\nlaw = 'paper'\n[scatter]",
     r"experiment\.config\.kinematic\.law: unified there, paper here"),
]  # fmt: skip


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(("old", "new", "difference"), cells(CHANGES, CHANGES[2:3], CHANGES[3:]))
def test_another_study_is_refused(
    paper: Robot, tmp_path: Path, old: str, new: str, difference: str
) -> None:
    text = FAKE.replace("DESIGN", "latin-hypercube")
    run_study(paper, study_of(paper, tmp_path, text), tmp_path / "out")
    other = study_of(paper, tmp_path, text.replace(old, new))
    with pytest.raises(RpctlError, match=difference):
        run_study(paper, other, tmp_path / "out", resume=True)


@pytest.mark.usefixtures("fake")
def test_another_robot_or_version_is_refused(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_of(paper, tmp_path, FAKE.replace("DESIGN", "grid"))
    run_study(paper, study, tmp_path / "out")
    other = rpctl.load("paper", home={"arm_joint": 0.3} if "arm_joint" in paper.joint_names else {
        paper.joint_names[0]: 0.3})  # fmt: skip
    with pytest.raises(RpctlError, match=rf"robot.home.{paper.joint_names[0]}: .* there, 0.3 here"):
        run_study(other, study, tmp_path / "out", resume=True)
    with pytest.raises(RpctlError, match=r"robot.model: \w+ there, \w+ here"):
        run_study(rpctl.scale_masses(paper, "*", 1.1), study, tmp_path / "out", resume=True)
    monkeypatch.setattr("rpctl.study.store.installed", lambda: {**installed(), "pin": "99.0"})
    with pytest.raises(RpctlError, match=r"versions.pin: \S+ there, 99.0 here"):
        run_study(paper, study, tmp_path / "out", resume=True)


@pytest.mark.usefixtures("fake")
def test_success_is_judged_anew(paper: Robot, tmp_path: Path) -> None:
    text = FAKE.replace("DESIGN", "latin-hypercube")
    run_study(paper, study_of(paper, tmp_path, text), tmp_path / "out")
    found = read_result(tmp_path / "out")
    error = found.runs.merits["rms_base_error"]
    assert found.success.value == np.mean(error < 1.0)
    strict, executor = text + "[success]\nrms_base_error = 0.4\nwork = 0.3", OddExecutor()
    run_study(paper, study_of(paper, tmp_path, strict), tmp_path / "out", executor, resume=True)
    assert executor.rows == 0
    found = read_result(tmp_path / "out")
    np.testing.assert_array_equal(found.succeeded, error <= 0.3)
    assert found.success.value == np.mean(error <= 0.3)
    kept = rpctl.libraries.library("pandas").read_parquet(tmp_path / "out" / "runs.parquet")
    assert kept["success"].tolist() == found.succeeded.tolist()


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(
    "kind", cells(DESIGNS, ["grid", "morris"], {*DESIGNS} - {"grid", "morris"})
)
def test_a_result_says_what_matters(paper: Robot, tmp_path: Path, kind: str) -> None:
    text = FAKE.replace("DESIGN", kind).replace("count = 40", "count = 64\nworst = 2")
    run_study(paper, study_of(paper, tmp_path, text), tmp_path / "out")
    found = read_result(tmp_path / "out")
    matters = found.sensitivity_of("rms_base_error")
    assert matters is not None
    assert matters.method == {"sobol": "sobol", "morris": "morris"}.get(kind, "rank-correlation")
    assert matters.ranking == ("plant.delay", "plant.dropped")
    failing = found.sensitivity_of("failure")
    assert failing is not None
    assert failing.ranking[0] == "plant.delay"
    (shown,) = found.maps
    assert (shown.x, shown.y) == ("plant.delay", "plant.dropped")
    assert shown.count.sum() == len(found.runs)
    missing = np.isinf(found.runs.merits["rms_base_error"])
    assert matters.replaced == missing.sum()
    merit = found.to_dict()["statistics"][0]
    assert (merit["merit"], merit["unit"], merit["missing"]) == (
        "rms_base_error",
        "m",
        missing.sum(),
    )
    worst = [each.run for each in found.worst]
    rest = np.delete(found.runs.merits["rms_base_error"], worst)
    assert all(found.runs.merits["rms_base_error"][run] >= rest.max() for run in worst)
    assert found.robot == "paper"


def test_a_folder_without_runs_is_told(tmp_path: Path) -> None:
    with pytest.raises(RpctlError, match="holds no finished study"):
        read_result(tmp_path)


@pytest.mark.parametrize(("package", "design"), [("pyarrow", "grid"), ("SALib", "sobol")])
@pytest.mark.usefixtures("fake")
def test_a_library_that_is_missing_is_named(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, design: str
) -> None:
    study = study_of(paper, tmp_path, FAKE.replace("DESIGN", design))
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RpctlError, match=f"needs {package}; run pip install 'pyarrow<"):
        run_study(paper, study, tmp_path / "out")
    assert not (tmp_path / "out" / "runs.parquet").exists()


def test_chunks_suit_the_workers() -> None:
    assert chunk_size(10_000, 2) == 256
    assert chunk_size(1000, 2) == 56  # whole numbers of lanes
    assert chunk_size(40, 2) == 2
    assert chunk_size(3, 8) == 1


def test_a_study_that_would_compute_for_ever_writes_nothing(paper: Robot, tmp_path: Path) -> None:
    study = study_of(paper, tmp_path, SHORT.replace("plant_step = 0.02", "plant_step = 1e-12"))
    with pytest.raises(RpctlError, match=r"the run would take too long: .* plant_step"):
        run_study(paper, study, tmp_path / "out")
    assert not (tmp_path / "out").exists()
