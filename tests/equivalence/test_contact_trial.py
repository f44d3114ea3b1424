"""The robot itself, rolling in MuJoCo, agrees with the reduced model; a wrong model does not."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import Robot
from rpctl.cli.app import app
from rpctl.drive.drive import Swivel, Wheel
from rpctl.dynamics import motion
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.certificate import Skipped
from rpctl.equivalence.contact import mujoco_body
from rpctl.equivalence.contact import plan as contact_plan
from rpctl.equivalence.contact import trial as contact_trial
from rpctl.equivalence.contact.trial import ContactTrial
from rpctl.robot.vary import set_limits
from tests.grids import cells
from tests.robots import SET_A, ball, platform, write

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

G = 9.81
ROWS = ("path", "heading", "force of the ground", "zero-moment point", "wheel loads")
JOINT_ROWS = ("joint forces", "joint torques")
CATALOGUE = (
    *("mixed_chain", "skid_steer", "mecanum", "car", "tricycle", "swerve", "twin_casters"),
    *("casters", "caster_drive", "omni", "tiago", "tiago_no_hand", "tiago_dual", "tiago_pro"),
)


def rolled(robot: Robot) -> ContactTrial:
    trial = contact_trial.contact_trial(robot)
    assert isinstance(trial, ContactTrial), trial
    return trial


def broken(trial: ContactTrial) -> dict[str, float]:
    return {check.name: check.residual for check in trial.checks if not check.passed}


def wheels(robot: Robot, change: Callable[[Wheel], Wheel], *which: int) -> Robot:
    """Return the robot with some wheels of its drive changed, all of them if none is named."""
    found = tuple(
        change(wheel) if k in which or not which else wheel
        for k, wheel in enumerate(robot.drive.wheels)
    )
    return dataclasses.replace(robot, drive=dataclasses.replace(robot.drive, wheels=found))


def swivels(robot: Robot, change: Callable[[Swivel], Swivel]) -> Robot:
    first, *rest = robot.drive.swivels
    drive = dataclasses.replace(robot.drive, swivels=(change(first), *rest))
    return dataclasses.replace(robot, drive=drive)


def larger(robot: Robot) -> Robot:
    return wheels(robot, lambda wheel: dataclasses.replace(wheel, radius=1.05 * wheel.radius))


def aside(robot: Robot) -> Robot:
    return wheels(robot, lambda wheel: dataclasses.replace(wheel, offset=wheel.offset + 0.05), 0)


def off_point(robot: Robot) -> Robot:
    x, y = robot.drive.point
    return dataclasses.replace(robot, drive=dataclasses.replace(robot.drive, point=(x + 0.05, y)))


def reversed_trail(robot: Robot) -> Robot:
    return swivels(robot, lambda swivel: dataclasses.replace(swivel, trail=-swivel.trail))


def longer(robot: Robot) -> Robot:
    return swivels(robot, lambda swivel: dataclasses.replace(swivel, trail=1.1 * swivel.trail))


def upside_down(robot: Robot) -> Robot:
    return swivels(robot, lambda swivel: dataclasses.replace(swivel, sign=-swivel.sign))


def body(robot: Robot, change: Callable[[pin.Inertia], pin.Inertia]) -> Robot:
    """Return the robot with the root link's inertia changed in Pinocchio's model alone."""
    model = robot.model.copy()
    model.inertias[1] = change(model.inertias[1])
    return dataclasses.replace(robot, model=model)


def heavier(robot: Robot) -> Robot:
    return body(robot, lambda one: pin.Inertia(1.1 * one.mass, one.lever, 1.1 * one.inertia))


def shifted(robot: Robot) -> Robot:
    ahead = np.array([0.02, 0.0, 0.0])
    return body(robot, lambda one: pin.Inertia(one.mass, one.lever + ahead, one.inertia))


def test_a_sound_robot_agrees(trial: ContactTrial) -> None:
    assert tuple(check.name for check in trial.checks) == ROWS + JOINT_ROWS
    assert broken(trial) == {}
    assert trial.determinate
    assert trial.notes == ()


def test_it_travels_and_turns_as_planned(trial: ContactTrial) -> None:
    """v = ½(1 − cos(πt/2)) m/s for 2 s is 1 m; ω = .4(1 − cos πt) rad/s is .8 rad."""
    assert trial.t[-1] == pytest.approx(2.0)
    assert trial.distance == pytest.approx(1.0, abs=2e-3)
    for side in (trial.engine, trial.reduced):
        assert side.pose[-1, 2] == pytest.approx(0.8, abs=5e-3)
        assert np.abs(side.pose[0]).max() < 1e-3


@pytest.mark.parametrize("name", cells(CATALOGUE, slow=("car", "mecanum")))
def test_every_wheeled_robot_of_the_catalogue_agrees(name: str) -> None:
    trial = rolled(rpctl.load(name))
    assert broken(trial) == {}
    assert trial.distance > 0.2


FAULTS = (
    ("paper", larger, "heading"),
    ("paper", aside, "wheel loads"),
    ("paper", heavier, "force of the ground"),
    ("paper", shifted, "zero-moment point"),
    ("casters", reversed_trail, "casters"),
    ("tricycle", larger, "path"),
    ("tricycle", shifted, "zero-moment point"),
    ("tricycle", aside, "wheel loads"),
    ("tricycle", upside_down, "path"),
    ("casters", aside, "casters"),
    ("casters", upside_down, "casters"),
    ("casters", off_point, "heading"),
    ("mixed_chain", aside, "joint torques"),
    ("car", off_point, "force of the ground"),
    ("car", upside_down, "joint forces"),
    ("tiago", shifted, "heading"),
    ("mecanum", larger, "path"),
    ("omni", aside, "heading"),
    ("caster_drive", larger, "path"),
    ("caster_drive", longer, "path"),
    ("caster_drive", upside_down, "casters"),
)
TELLING = (FAULTS[8],)  # a swivel


@pytest.mark.parametrize(("name", "fault", "row"), cells(FAULTS, FAULTS[:1], TELLING))
def test_a_wrong_model_of_any_drive_is_noticed(
    name: str, fault: Callable[[Robot], Robot], row: str
) -> None:
    assert row in broken(rolled(fault(rpctl.load(name))))


@pytest.mark.thorough
def test_a_car_needs_its_tie_rod(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each front wheel's drag turns its knuckle, and only the rod holds the two against it."""
    monkeypatch.setattr(mujoco_body, "TIE_ROD_BANDWIDTH", 1e-6)
    assert {"path", "joint torques"} <= broken(rolled(rpctl.load("car"))).keys()


@pytest.mark.slow
def test_a_model_that_breaks_down_fails_and_does_not_raise(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = iter(range(10**6))
    step = motion.step

    def failing(*arguments: Any) -> Any:
        if next(calls) > 400:
            raise rpctl.RpctlError("singular")
        return step(*arguments)

    monkeypatch.setattr(contact_plan, "step", failing)
    trial = rolled(paper)
    assert not trial.passed
    assert len(trial.reduced.pose) == len(trial.engine.pose)
    assert np.isnan(trial.reduced.pose[-1]).all()
    json.dumps(trial.to_dict(), allow_nan=False)


@pytest.mark.slow
def test_a_support_off_the_wheels_ground_tilts_the_robot(tmp_path: Path) -> None:
    """A ball half a metre ahead that ends 4 mm below: atan(4/500) = .458°."""
    text = platform(SET_A, extra=ball(0.5, z=0.046))
    notes = rolled(rpctl.load(write(tmp_path, text))).notes
    assert any(note.startswith("it stands 0.46° tilted") for note in notes)


@pytest.mark.slow
def test_nothing_gentle_is_a_row_that_says_so(paper: Robot) -> None:
    found = contact_trial.contact_trial(set_limits(paper, effort={"wheel_*": 1e-6}))
    assert isinstance(found, Skipped)
    assert "is not gentle: wheel_" in found.note


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("arm", "a fixed base does not roll"),
        ("bicycle", "rpctl does not know that it stands: only wheel_"),
    ],
)
def test_what_cannot_roll_is_left_out_and_said(name: str, why: str) -> None:
    found = contact_trial.contact_trial(rpctl.load(name))
    assert isinstance(found, Skipped)
    assert found.note.startswith(why)


# --- the certificate ----------------------------------------------------------------------------


def test_json_holds_bands_and_short_paths(trial: ContactTrial) -> None:
    loaded = json.loads(json.dumps(trial.to_dict(), allow_nan=False))
    assert [check["name"] for check in loaded["checks"]] == [check.name for check in trial.checks]
    assert loaded["checks"][0]["band"] == pytest.approx(3.5e-3, rel=1e-3)
    assert loaded["checks"][0]["unit"] == "m"
    assert (
        len(loaded["t"]) == len(loaded["paths"]["mujoco"]) == len(loaded["paths"]["reduced"]) == 101
    )
    np.testing.assert_allclose(loaded["paths"]["mujoco"][-1], trial.engine.pose[-1], atol=1e-6)
    np.testing.assert_allclose(loaded["paths"]["reduced"][50], trial.reduced.pose[100], atol=1e-6)


def test_verify_makes_the_trial_when_asked(
    paper: Robot, trial: ContactTrial, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contact_trial, "contact_trial", lambda robot: trial)
    assert rpctl.verify(paper, samples=1).contact is None
    certificate = rpctl.verify(paper, samples=1, trials=["contact"])
    assert certificate.contact is trial
    assert certificate.to_dict()["contact"]["passed"]


def test_the_command_line_tells_of_the_trial(
    trial: ContactTrial, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(contact_trial, "contact_trial", lambda robot: trial)
    page = tmp_path / "paper.html"
    arguments = ["verify", "paper", "--samples", "1", "--contact", "--html", str(page)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    for text in ("zero-moment point", "3.5 mm", "rolled 1.00 m in MuJoCo, at most"):
        assert text in result.output
    assert 'class="trial"' in page.read_text(encoding="utf-8")
    wide = dataclasses.replace(trial.checks[0], residual=1.01)
    failed = dataclasses.replace(trial, checks=(wide, *trial.checks[1:]))
    monkeypatch.setattr(contact_trial, "contact_trial", lambda robot: failed)
    result = CliRunner().invoke(app, arguments[:-2])  # without the page
    assert result.exit_code == 1
    assert "not verified: path against MuJoCo, rolling on a plane" in result.output
