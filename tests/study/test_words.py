"""Names as people read them, and shares with digits enough."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl.simulation.config import Config
from rpctl.study.merits import MERITS, merit_words, parameter_words, percent, share_span
from rpctl.study.optimise import cost_change
from rpctl.study.scatter import scattered_paths
from rpctl.study.statistics import share
from rpctl.study.study import Optimisation


def test_no_name_that_is_read_is_an_identifier() -> None:
    names = [merit_words(name) for name in MERITS]
    assert len(set(names)) == len(names)
    paths = [path.replace("PATTERN", "arm") for path in scattered_paths(Config())]
    names += [parameter_words(path).name for path in paths]
    assert not [name for name in names if "_" in name or "plant" in name or not name]


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("plant.masses.arm_*", "mass of links arm_* (× the file's)"),
        ("plant.masses.*", "mass of all links (× the file's)"),
        ("plant.masses.tool", "mass of tool (× the file's)"),
        ("plant.radii.*", "wheel radius of all wheels (× the file's)"),
        ("plant.joint_friction.*", "dry friction of all joints (N·m or N)"),
        ("plant.centres.*.y", "centre of mass of all links along y (m)"),
        ("plant.centres.a.b.x", "centre of mass of a.b along x (m)"),
        ("run.initial_error.y", "initial error along y (m)"),
        ("plant.delay", "delay (s)"),
        ("kinematic.approach.haste", "approach haste"),
    ],
)
def test_parameters_in_words(path: str, shown: str) -> None:
    assert str(parameter_words(path)) == shown


def test_a_share_is_told_from_none_and_from_all() -> None:
    assert [percent(x) for x in (0.0, 1.0, 0.5, 0.754, 0.00037)] == [
        "0 %", "100 %", "50 %", "75.4 %", "0.04 %"]  # fmt: skip
    assert share_span(share(10_000, 10_000)) == "99.96 to 100 %"
    assert percent(1.0 - 1e-6) == "99.9999 %"


def test_the_change_of_a_cost_is_that_of_pairs() -> None:
    rng, good = np.random.default_rng(1), np.ones(200, dtype=bool)
    before = rng.uniform(1.0, 2.0, 200)
    asked = Optimisation(statistic="mean", failure_weight=1.0)
    same = cost_change(asked, (before, good), (before, good), 3)
    assert same is not None
    assert tuple(same) == (0.0, 0.0, 0.0)
    better = cost_change(asked, (before, good), (before - 0.01, good), 3)
    assert better is not None
    assert tuple(better) == pytest.approx((-0.01,) * 3)  # although runs spread a hundred times more
    failed = cost_change(asked, (before, good), (before, np.arange(200) >= 20), 3)
    assert failed is not None
    assert failed.value == pytest.approx(0.1)
    assert 0.05 < failed.low < 0.09 < 0.11 < failed.high < 0.15
    largest = cost_change(Optimisation(statistic="worst"), (before, good),
                         (before - 0.01, good), 3)  # fmt: skip
    assert largest is None
