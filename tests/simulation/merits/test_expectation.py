"""What to expect of a robot that is heavier, resists and answers late; and it never fails a run."""

from __future__ import annotations

from dataclasses import asdict, replace

import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, summarize, track
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.merits.expectation import Expectation, expect
from rpctl.simulation.merits.path_error import PathFigures
from rpctl.simulation.plants.starting import perturbed_plant
from tests.golden import part

COARSE = RunSettings("eight", 12.0, (0.3, 0.0, 0.0), control_period=0.005, plant_step=0.005)


@pytest.fixture(scope="module")
def expected(paper: Robot) -> Expectation:
    found = expect(paper, Config(run=COARSE))
    assert found is not None
    return found


def test_the_plant_is_what_is_told(paper: Robot) -> None:
    """38.6 kg of weight on two wheels of .15 m, 2 % of it: .57 N·m on each."""
    mass = sum(inertia.mass for inertia in paper.model.inertias)
    plant = perturbed_plant(paper)
    assert plant.masses == {"*": 1.1}
    assert plant.delay == 0.005
    assert plant.joint_friction == {
        name: pytest.approx(0.02 * 9.81 * mass * 0.15 / 2.0)
        for name in ("wheel_left_joint", "wheel_right_joint")
    }
    assert perturbed_plant(rpctl.load("panda")).joint_friction == {}


@pytest.mark.slow
def test_a_robot_that_takes_speeds_lags_more(paper: Robot) -> None:
    """A quarter more lag costs the way until it is learnt: some hundredths of a millimetre."""
    coarse = replace(COARSE, control_period=0.02, plant_step=0.02)
    sharp, found = (
        expect(paper, Config(run=coarse, output=rpctl.VelocityOutput(lag))) for lag in (0.0, 0.1)
    )
    assert sharp is not None and found is not None
    assert (sharp.lag_ratio, found.lag_ratio) == (None, 1.25)
    assert "friction and 25 % more lag" in found.sentence
    assert sharp.base_path is not None and found.base_path is not None
    assert 1e-5 < found.base_path.rms < 1e-3
    assert found.base_path.rms > 2.0 * sharp.base_path.rms


def test_the_lag_of_a_group_counts_as_one(paper: Robot) -> None:
    groups = {"base": rpctl.OutputGroup("twist", 0.1), "*": rpctl.OutputGroup("velocity")}
    output = rpctl.VelocityOutput(groups=groups)
    found = expect(paper, Config(run=RunSettings(control_period=0.05), output=output))
    assert found is not None
    assert found.lag_ratio == 1.25


def test_it_is_the_run_with_that_plant(paper: Robot, expected: Expectation) -> None:
    """Four of twelve seconds, from the reference's start; every second sample is kept."""
    run = track(paper, "eight", duration=4.0, control_period=0.005, plant_step=0.005,
                plant=perturbed_plant(paper))  # fmt: skip
    summary = summarize(part(run, slice(None, None, 2)))
    assert [expected.duration, expected.delay] == pytest.approx([4.0, 0.005])
    assert (expected.outcome, summary.nominal) == (summary.outcome, False)
    assert expected.outcome_sentence == summary.outcome_sentence
    for mine, theirs in (
        (expected.base_path, summary.base_path),
        (expected.end_effector_path, summary.end_effector_path),
    ):
        assert mine is not None
        assert theirs is not None
        known = {key: value for key, value in asdict(theirs).items() if value is not None}
        found = {key: asdict(mine)[key] for key in known}
        assert found == pytest.approx(known, rel=1e-9, abs=1e-12)


def test_a_third_that_is_too_short_tells_nothing(paper: Robot) -> None:
    assert expect(paper, Config(run=replace(COARSE, duration=11.98))) is None


@pytest.mark.parametrize("error", [ValueError("not now"), rpctl.RpctlError("not now")])
def test_a_law_that_gives_up_is_told_and_fails_nothing(paper: Robot, error: Exception) -> None:
    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        raise error

    found = expect(paper, Config(dynamic=law, run=COARSE))
    assert found is not None
    assert (found.outcome, found.base_path) == ("diverging", None)
    assert found.sentence == (
        "with 10 % more mass, wheel friction and 5 ms delay: diverging, it ended early (not now)"
    )


def path(rms: float, length: float = 5.0) -> PathFigures:
    return PathFigures(rms, 0.0, 0.0, None, 0.0, 0.0, 0.12, 0.034, length)


def test_the_sentence() -> None:
    cart = Expectation(1.1, {"wheel": 0.5}, 0.006, 5.0, "tracked", "it is", path(0.0031))
    head = "with 10 % more mass, wheel friction and 6 ms delay: path error 3.1 mm rms"
    assert cart.sentence == f"{head}, 0.12 s (34 mm) behind at most"
    assert cart.to_dict()["sentence"] == cart.sentence
    assert cart.to_dict()["base_path"]["rms"] == 0.0031
    stays = "; the error does not decay"
    arm = replace(cart, end_effector_path=path(0.07), outcome="stuck")
    assert arm.sentence == f"{head} (end effector 70 mm), 0.12 s (34 mm) behind at most{stays}"
    assert replace(arm, outcome="collided").sentence.endswith(" behind at most; collided")
    fixed = replace(arm, wheel_friction={}, base_path=path(0.0, 0.0), outcome="late")
    assert fixed.sentence == (
        "with 10 % more mass and 6 ms delay: path error 70 mm rms at the end effector, 0.12 s "
        "(34 mm) behind at most"
    )
    coarse = replace(fixed, delay=0.0, base_path=path(0.01, 0.0), end_effector_path=None)
    assert coarse.sentence.startswith("with 10 % more mass: path error 10 mm rms, 0.12 s")
