"""A study's file: what it means, and that each fault of one is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, RpctlError
from rpctl.robot.catalog import ENTRIES
from rpctl.study.scatter import Normal, Uniform
from rpctl.study.study import Study
from rpctl.study.study_file import read_study, study_template
from tests.grids import cells

WHOLE = """
[study]
design = "latin-hypercube"
count = 20
seed = 5
duration = 2.0
samples = 11
chunk = 4
merit = "max_base_error"
worst = 2
tolerance = 0.02

[run]
reference = "line"
control_period = 0.01

[kinematic]
law = "paper"

[plant]
delay = 0.02

[limits.effort]
"*" = 12.5

[scatter]
"run.initial_error.y" = { normal = [0.0, 0.1] }
kinematic.horizon = { uniform = [0.2, 0.4] }
plant.dropped = 0.25

[success]
rms_base_error = 0.1
work = 3

[optimize]
statistic = "quantile"
level = 0.9
runs = 8

[optimize.parameters]
"kinematic.beta" = [0.5, 2.0]
"dynamic.gain" = { log-uniform = [1.0, 30.0] }
"""


def read(text: str, robot: Robot, folder: Path) -> Study:
    path = folder / "study.toml"
    path.write_text(text)
    return read_study(path, robot)


def test_a_file_says_it_all(paper: Robot, tmp_path: Path) -> None:
    study = read(WHOLE, paper, tmp_path)
    config = study.experiment.config
    assert (config.run.reference, config.run.duration, config.run.control_period) == (
        "line", 2.0, 0.01)  # fmt: skip
    assert type(config.kinematic).__name__ == "PaperKinematic"
    assert dict(config.limits.effort) == {"*": 12.5}
    assert (config.plant.delay, config.plant.dropped) == (0.02, 0.25)  # what differs in no run
    assert study.scatter.names == study.experiment.names == (
        "run.initial_error.y", "kinematic.horizon")  # fmt: skip
    assert [*study.scatter.distributions.values()] == [Normal(0.0, 0.1), Uniform(0.2, 0.4)]
    assert (study.design.kind, study.design.count, study.design.seed) == ("latin-hypercube", 20, 5)
    assert (study.experiment.seed, study.experiment.samples) == (5, 11)
    assert (study.experiment.tolerance, study.settings.chunk, study.settings.worst) == (0.02, 4, 2)
    assert study.settings.merit == "max_base_error"
    assert study.success == {"rms_base_error": 0.1, "work": 3.0}
    found = study.optimisation
    assert found is not None
    assert (found.statistic, found.level, found.runs, found.merit) == (
        "quantile", 0.9, 8, "rms_base_error")  # fmt: skip
    assert study.ranges.names == ("kinematic.beta", "dynamic.gain")
    ends = [study.ranges.values(np.full((1, 2), p))[0] for p in (0.0, 1.0)]
    np.testing.assert_allclose(ends, [[0.5, 1.0], [2.0, 30.0]])
    assert study.text == WHOLE


def test_a_run_of_a_study_is_a_configuration(paper: Robot, tmp_path: Path) -> None:
    study = read(WHOLE, paper, tmp_path)
    values, config = study.values[7], study.config_of(7)
    assert config.run.initial_error == (0.0, values[0], 0.0)
    assert config.kinematic.horizon == values[1]  # type: ignore[union-attr]
    assert 0.2 <= values[1] <= 0.4
    assert config.plant.seed != study.config_of(8).plant.seed


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ("[studdy]", "studdy: a study has no such table"),
        ("[study]\ncuont = 3", "study.cuont: setting 'cuont' is not known; did you mean count"),
        ("[study]\ncount = 2.5", "study.count: is 2.5; give a whole number"),
        ("[study]\ncount = 0", "study.*count is 0"),
        ("[study]\ndesign = 'sobl'", "study.*design is .sobl.; give monte-carlo or"),
        ("[study]\nchunk = 0", "study.*chunk is 0; give a whole number, 1 or more"),
        ("[study]\nworst = -1", "study.*worst is -1"),
        ("[study]\ntolerance = 0.0", "study.*tolerance is 0"),
        ("[study]\nmerit = 'rms'", "study.merit: merit of paper 'rms' is not known"),
        ("[study]\nduration = 1.0\n[run]\nduration = 2.0", "run.duration has another value"),
        ("[study]\ndesign = 'grid'", r"study: a grid design needs parameters"),
        ("study = 3", r"study: is 3; write \[study\]"),
        ("[kinematic]\nlaw = 'papr'", "kinematic.law: kinematic law 'papr' is not known"),
        ("[scatter]\n'plant.dely' = 0.1", "scattered setting 'plant.dely' is not known; did you"),
        ("[scatter]\nplant.delay = {unifrom = [0, 1]}", "'unifrom' is not known; did you mean uni"),
        ("[scatter]\nplant.delay = {uniform = [1, 0]}", "from 1 to 0; give the smaller"),
        ("[scatter]\nplant.delay = {uniform = [-1, 0.1]}", "scatter: delay is -0.725"),
        ("[scatter]\n'plant.masses.armm_*' = {uniform = [1, 2]}", "'armm_.' is not known"),
        ("[scatter]\n'plant.tau_bias.leg' = {uniform = [1, 2]}", "'leg' is not known"),
        ("[limits.effort]\nleg = 3.0", "'leg' is not known"),
        ("[success]\nrms = 3", "success: merit of paper 'rms' is not known"),
        ("[success]\nwork = true", "success.work: is True; give a number"),
        ("[optimize]\nruns = 3", "there is nothing to optimise"),
        ("[optimize]\nstatistic = 'max'\n[optimize.parameters]\n'dynamic.gain' = [1, 2]",
         "optimize.*statistic is .max.; give mean or"),
        ("[optimize]\nevaluations = 3\n[optimize.parameters]\n'dynamic.gain' = [1, 2]",
         "optimize: evaluations is 3; give 16 or more"),
        ("[optimize.parameters]\n'dynamic.gain' = 3.0", "'?dynamic.gain.*: has no range"),
        ("[optimize.parameters]\n'dynamic.gain' = {normal = [1, 2]}", "has no range"),
        ("[scatter]\ndynamic.gain = {uniform = [1, 2]}\n"
         "[optimize.parameters]\n'dynamic.gain' = [1, 2]", "is also under .scatter"),
    ],
)  # fmt: skip
def test_a_fault_is_named(paper: Robot, tmp_path: Path, wrong: str, text: str) -> None:
    with pytest.raises(RpctlError, match=text) as caught:
        read(wrong, paper, tmp_path)
    assert str(tmp_path / "study.toml") in str(caught.value)
    assert caught.value.exit_code == 2


def test_all_faults_are_named_at_once(paper: Robot, tmp_path: Path) -> None:
    wrong = "[study]\ncuont = 3\n[plant]\ndelay = -1.0\n[run]\nlaps = 'two'"
    with pytest.raises(RpctlError) as caught:
        read(wrong, paper, tmp_path)
    assert len(str(caught.value).splitlines()) == 3


FEW = ["paper", "mecanum", "car", "panda", "balancer"]  # arm and wheels, each alone, one that leans
ALL = [entry.name for entry in ENTRIES]


@pytest.mark.parametrize("name", cells(ALL, FEW))
def test_the_template_fits_the_robot(name: str, tmp_path: Path) -> None:
    robot = rpctl.load(name)
    study = read(study_template(robot), robot, tmp_path)
    assert study.scatter.names
    assert study.optimisation is not None
    for run in range(3):
        study.config_of(run).plant.simulated_robot(robot)
