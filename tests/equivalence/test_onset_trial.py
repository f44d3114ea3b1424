"""In contact a robot slips and tips where paper and pencil say, and where rpctl does."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rpctl import ReducedDynamics, Robot
from rpctl.cli.app import app
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.certificate import Skipped
from rpctl.equivalence.onset import prediction
from rpctl.equivalence.onset import trial as trial_module
from rpctl.equivalence.onset.measurement import RUN_S, OnsetRuns, PushedBody, measure
from rpctl.equivalence.onset.prediction import SLIPS, TIPS, manoeuvres
from rpctl.equivalence.onset.trial import ASKEW, WITHIN, NoOnset, Onset, OnsetTrial, onset_trial
from rpctl.robot.load import load
from tests.equivalence import trolley as paper_and_pencil
from tests.equivalence.test_onset_prediction import DRIVES, LEFT, lifted
from tests.equivalence.trolley import trolley
from tests.grids import cells

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

MU = 0.7
PLANTED = [(1.1, 1.0), (0.9, 1.0), (1.0, 1.1), (1.0, 0.0)]
ACCURACY = 0.01  # of an onset: slipping takes time to tell, and contacts are soft


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return trolley(tmp_path_factory.mktemp("trolley"))


def measured(
    robot: Robot, which: int, ending: str, friction: float, guess: float, softness: float = 1.0
) -> float:
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics, friction)
    assert contacts is not None
    tried = list(manoeuvres(dynamics, contacts, RUN_S, ending))[which]
    body = PushedBody(robot, friction, softness)
    return measure(OnsetRuns(dynamics, contacts, tried, body), guess)


@pytest.mark.thorough
@pytest.mark.parametrize("softness", [0.5, 2.0])
def test_an_onset_is_not_the_solvers(robot: Robot, softness: float) -> None:
    """Contacts of half and of twice the time constant, and a guess that is far off."""
    slips = paper_and_pencil.slipping_force(MU, 1)
    found = measured(robot, DRIVES, SLIPS, MU, 0.4 * slips, softness)
    assert found == pytest.approx(slips, rel=ACCURACY)
    tips = paper_and_pencil.pushed_over()
    found = measured(robot, LEFT, TIPS, 2.0, 2.0 * tips, softness)
    assert found == pytest.approx(tips, rel=ACCURACY)


def test_it_starts_in_motion(robot: Robot) -> None:
    """Wheels that roll do not slide; one that is faster by δ slides by r δ."""
    body, dynamics = PushedBody(robot, MU), ReducedDynamics(robot)
    q = robot.configuration(theta=0.4)
    body.start(q)
    body.keep()
    v = dynamics.basis(q) @ np.array([1.3, 0.5])
    body.set_moving(v)
    np.testing.assert_allclose(body.slip(), 0.0, atol=1e-6)
    v[robot.velocity_index("left_joint")] += 2.0
    body.set_moving(v)
    np.testing.assert_allclose(np.abs(body.slip()), [[0.3, 0.0], [0.0, 0.0]], atol=1e-6)
    v[1] += 0.2
    body.set_moving(v)
    np.testing.assert_allclose(np.abs(body.slip()), [[0.3, 0.2], [0.0, 0.2]], atol=1e-6)


def plant(monkeypatch: pytest.MonkeyPatch, friction: float, height: float) -> None:
    """Let the prediction believe in another friction and height than there are."""
    honest = prediction.predict

    def faulty(dynamics, contacts, manoeuvre):  # type: ignore[no-untyped-def]
        wrong = ReducedDynamics(lifted(dynamics.robot, height))
        scaled = dataclasses.replace(contacts, friction=friction * contacts.friction)
        return honest(wrong, scaled, manoeuvre)

    monkeypatch.setattr(trial_module, "predict", faulty)
    monkeypatch.setattr(
        trial_module, "manoeuvres", lambda *given: [*manoeuvres(*given)][DRIVES:LEFT]
    )


TRIED = {"drives and left": (DRIVES, LEFT), "all": range(5)}  # of the first two each slips and tips


@pytest.mark.parametrize("tried", cells(TRIED, slow=["drives and left"]))
def test_a_sound_prediction_passes(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, tried: str
) -> None:
    """And it was measured: that of slipping as by paper and pencil, and not what was predicted."""
    monkeypatch.setattr(
        trial_module, "manoeuvres", lambda *given: [[*manoeuvres(*given)][k] for k in TRIED[tried]]
    )
    trial = onset_trial(robot, MU)
    assert isinstance(trial, OnsetTrial)
    assert [onset.verdict for onset in trial.onsets] == [WITHIN] * (8 if tried == "all" else 4)
    assert all(0.0 < abs(onset.gap) < ACCURACY for onset in trial.onsets)
    slips = [each.measured for each in trial.onsets if each.manoeuvre.startswith("drives")]
    assert slips[0] == pytest.approx(paper_and_pencil.slipping_force(MU, 1), rel=ACCURACY)
    assert [each.manoeuvre.split()[:2] for each in trial.untried] == (
        [["brakes"], ["pushed", "ahead"]] if tried == "all" else []
    )


@pytest.mark.parametrize(("friction", "height"), cells(PLANTED))
def test_a_planted_fault_fails(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, friction: float, height: float
) -> None:
    plant(monkeypatch, friction, height)
    trial = onset_trial(robot, MU)
    assert isinstance(trial, OnsetTrial)
    assert not trial.passed


@pytest.mark.parametrize("name", cells(["paper", "tiago", "tricycle", "mecanum"]))
def test_robots_slip_and_tip_when_predicted(name: str) -> None:
    """The paper's robot within 1 %; the loads of the others in brackets."""
    trial = onset_trial(load(name))
    assert isinstance(trial, OnsetTrial)
    assert trial.passed
    assert trial.determinate == (name in ("paper", "tricycle"))
    if name == "paper":
        assert max(abs(onset.gap) for onset in trial.onsets) < ACCURACY
    for onset in trial.onsets:  # on the safe side, or within the solver's accuracy
        assert onset.equal <= onset.measured * (1.0 + ACCURACY), onset


def test_what_cannot_be_tried_is_told() -> None:
    for name, reason in (("arm", "fixed base"), ("bicycle", "rpctl does not know that it stands")):
        skipped = onset_trial(load(name))
        assert isinstance(skipped, Skipped)
        assert reason in skipped.note


def fail(robot: Robot) -> OnsetTrial:
    onset = Onset("brakes", SLIPS, "N", MU, 110.0, 110.0, 110.0, 100.0)
    return OnsetTrial((onset,), (NoOnset("drives off", TIPS, "it slips before"),), True)


@pytest.mark.parametrize(("tilt", "verdict"), [(0.0, "wrong"), (1e-3, "wrong"), (5e-3, ASKEW)])
def test_a_robot_that_leans_is_not_judged(robot: Robot, tilt: float, verdict: str) -> None:
    """2e-3 rad is the border: a level robot's wrong prediction stays wrong."""
    (onset,) = fail(robot).onsets
    leaning = dataclasses.replace(onset, tilt=tilt)
    assert leaning.verdict == leaning.to_dict()["verdict"] == verdict
    assert leaning.passed is (verdict == ASKEW)


def test_a_wrong_prediction_ends_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_module, "onset_trial", fail)
    command = ["verify", "paper", "--onset", "--samples", "1", "--engines", "none"]
    shown = CliRunner().invoke(app, command)
    assert shown.exit_code == 1
    words = " ".join(shown.output.split())
    assert "not verified: brakes until it slips at 100 N, predicted at 110 N" in words
    assert "+10.0 % wrong" in words
    assert "not tried drives off until it tips: it slips before" in words
    printed = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    assert printed["passed"] is False
    assert printed["onset"]["onsets"][0]["verdict"] == "wrong"
