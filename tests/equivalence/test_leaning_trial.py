"""Robots that lean roll in MuJoCo as the reduced model says, and a wrong model does not."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

import rpctl
from rpctl.arrays import Array
from rpctl.cli.verify import show_certificate
from rpctl.dynamics.leaning import find_formulas
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.certificate import Skipped
from rpctl.equivalence.contact.leaning_trial import STIFF_LEGS, leaning_trial
from rpctl.equivalence.contact.trial import ContactTrial
from rpctl.robot.leaning import LeaningRobot, contact_arm
from rpctl.view.pages.certificate import certificate_page, contact_figures
from tests.grids import cells
from tests.leaning import OWN, leaning

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

ROWS = ["path", "heading", "tilt", "force of the ground", "zero-moment point", "wheel loads"]


@cache
def proved(name: str) -> rpctl.Certificate:
    """Return the certificate of a robot of the catalogue, its trial with it."""
    return rpctl.verify(leaning(name), samples=1, trials=["contact"])


def rolled(robot: LeaningRobot) -> ContactTrial:
    trial = leaning_trial(robot)
    assert isinstance(trial, ContactTrial), trial
    return trial


def broken(robot: LeaningRobot) -> set[str]:
    return {check.name for check in rolled(robot).checks if not check.passed}


def larger(robot: LeaningRobot) -> LeaningRobot:
    wheels = tuple(replace(each, radius=1.03 * each.radius) for each in robot.drive.wheels)
    return replace(robot, drive=replace(robot.drive, wheels=wheels))


def changed(robot: LeaningRobot, change: Callable[[pin.Inertia], pin.Inertia]) -> LeaningRobot:
    """Return a robot whose root link's inertia is another one in the reduced model."""
    model = robot.model.copy()
    model.inertias[1] = change(model.inertias[1])
    return replace(robot, model=model)


def heavier(robot: LeaningRobot) -> LeaningRobot:
    return changed(robot, lambda old: pin.Inertia(1.03 * old.mass, old.lever, 1.03 * old.inertia))


def moved(robot: LeaningRobot, way: Array) -> LeaningRobot:
    return changed(robot, lambda old: pin.Inertia(old.mass, old.lever + way, old.inertia))


def higher(robot: LeaningRobot) -> LeaningRobot:
    return moved(robot, np.array([0.0, 0.0, 0.05]))


@pytest.mark.parametrize("name", cells(OWN, ("balancer",), ("whipple", "wheel_legs")))
def test_both_sides_agree(name: str) -> None:
    robot, trial = leaning(name), proved(name).contact
    assert trial is not None
    assert trial.passed, [check for check in trial.checks if not check.passed]
    assert [check.name for check in trial.checks] == [*ROWS, "efforts"]
    assert trial.distance > 0.15 and abs(trial.engine.pose[-1, 2]) > 0.3  # it goes, and it turns
    tilts = [vars(side)["tilt"] for side in (trial.engine, trial.reduced)]
    assert min(np.ptp(tilt) for tilt in tilts) > 0.03
    assert trial.engine.load.sum(axis=1) == pytest.approx(9.81 * robot.mass, rel=0.05)


FAULTS: dict[str, tuple[str, Callable[[LeaningRobot], LeaningRobot], str]] = {
    "wheels 3 % larger": ("balancer", larger, "path"),
    "a base 3 % heavier": ("balancer", heavier, "wheel loads"),
    "a frame 50 mm higher": ("whipple", higher, "tilt"),
}


@pytest.mark.parametrize("fault", cells(FAULTS, [*FAULTS][:1], [*FAULTS][1:2]))
def test_a_wrong_model_does_not_roll_so(fault: str) -> None:
    name, change, row = FAULTS[fault]
    assert row in broken(change(leaning(name)))


def test_a_contact_below_the_wheels_middle_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a wheel leans, its contact moves aside; forgotten, a bicycle leans otherwise."""

    def straight_below(left: Any, axle: Any, sqrt: Any) -> list[Any]:
        return [0.0, 0.0, contact_arm(left, axle, sqrt)[2]]

    monkeypatch.setattr("rpctl.dynamics.leaning.contact_arm", straight_below)
    find_formulas.cache_clear()
    robot = rpctl.load("whipple")  # another one than others have: its formulas are kept
    assert isinstance(robot, LeaningRobot)
    try:
        assert "tilt" in broken(robot)
    finally:
        find_formulas.cache_clear()


def test_what_nothing_balances_is_skipped() -> None:
    """Its mass a metre ahead, no tilt that it takes brings it above its wheels."""
    ahead = np.array([1.0, 0.0, 0.0])
    robot = changed(
        leaning("balancer"), lambda old: pin.Inertia(old.mass, old.lever + ahead, old.inertia)
    )
    trial = leaning_trial(robot)
    assert isinstance(trial, Skipped) and "centre of mass above its wheels" in trial.note


def test_a_certificate_has_the_trial_and_its_picture(capsys: pytest.CaptureFixture[str]) -> None:
    proof = proved("balancer")
    assert proof.passed and proof.contact is not None
    assert len(proof.contact.footprint) == 2
    with pytest.raises(Exception, match="QH"):  # two contacts have no hull
        ConvexHull(proof.contact.footprint)
    contact_figures(proof.contact)
    assert not says_legs_were_stiff(proof, capsys)
    stiff = replace(proof.contact, notes=(*proof.contact.notes, STIFF_LEGS))
    assert says_legs_were_stiff(replace(proof, contact=stiff), capsys)
    assert "assumptions: both wheels press on the ground;" in proof.scope.line


def says_legs_were_stiff(proof: rpctl.Certificate, capsys: pytest.CaptureFixture[str]) -> bool:
    """Return whether terminal, JSON and page say so; all three or none."""
    show_certificate(proof)
    words = " ".join(capsys.readouterr().out.split())
    said = {"legs were held stiff" in text
            for text in (words, json.dumps(proof.to_dict()), certificate_page(proof))}  # fmt: skip
    assert len(said) == 1
    return said.pop()


@pytest.mark.slow
def test_a_certificate_says_that_legs_were_held_stiff(capsys: pytest.CaptureFixture[str]) -> None:
    assert says_legs_were_stiff(proved("wheel_legs"), capsys)
