"""Wrong objects of a user's end in a message that says what to give instead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.reference.load import load_reference


@pytest.fixture(scope="module")
def robot() -> rpctl.Robot:
    return rpctl.load("paper")


def track(robot: rpctl.Robot, **given: Any) -> rpctl.Run:
    return rpctl.track(robot, **{"reference": "line", "duration": 0.02, **given})


def refusal(robot: rpctl.Robot, **given: Any) -> str:
    with pytest.raises(rpctl.RpctlError) as refused:
        track(robot, **given)
    return str(refused.value)


@pytest.mark.parametrize("value", [None, (0.0, 0.0, 0.0), np.zeros(3)])
def test_a_reference_that_returns_no_state(robot: rpctl.Robot, value: Any) -> None:
    text = refusal(robot, reference=lambda t: value)
    assert f"({type(value).__name__}) at t = 0 s; return a rpctl.ReferenceState" in text
    assert "rpctl.as_reference(function)" in text


def test_a_reference_that_returns_no_state_later(robot: rpctl.Robot) -> None:
    good = load_reference(robot, "line")
    text = refusal(robot, reference=lambda t: good(t) if t < 0.009 else None)
    assert "the reference returns None (NoneType) at t = 0.01 s" in text


@pytest.mark.parametrize("name", rpctl.ReferenceState._fields[:6])
@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([0.0, 0.0], "give an array of"),
        (np.zeros(7), r"is an array (7,) of float64; give"),
        (None, "give an array of"),
    ],
)
def test_a_field_of_the_reference(robot: rpctl.Robot, name: str, value: Any, message: str) -> None:
    good = load_reference(robot, "line")
    text = refusal(robot, reference=lambda t: good(t)._replace(**{name: value}))
    if name == "joints":
        message = message if value is None else "joints"
    assert message in text
    assert name.split("_")[0] in text


def test_a_reference_with_a_number_that_is_none(robot: rpctl.Robot) -> None:
    good = load_reference(robot, "line")
    bad = good(0.0)._replace(twist=np.array([0.1, np.nan, 0.0]))
    assert "twist of the reference" in (text := refusal(robot, reference=lambda t: bad))
    assert "give finite numbers" in text


def test_a_class_in_place_of_its_object(robot: rpctl.Robot) -> None:
    text = refusal(robot, kinematic=rpctl.UnifiedKinematic)
    assert text == (
        "kinematic is the class UnifiedKinematic; give one of its objects: UnifiedKinematic(...)"
    )


@pytest.mark.parametrize("what", ["reference", "kinematic", "dynamic"])
def test_what_cannot_be_called(robot: rpctl.Robot, what: str) -> None:
    assert f"{what} is 7 (int); give a function" in refusal(robot, **{what: 7})


def test_a_kinematic_law_that_returns_a_tuple(robot: rpctl.Robot) -> None:
    zeros = np.zeros(robot.dof)
    text = refusal(robot, kinematic=lambda *state: (zeros, zeros))
    assert "(tuple); return a rpctl.Command(nu_d, nu_d_dot)" in text


@pytest.mark.parametrize("field", ["nu_d", "nu_d_dot"])
def test_a_command_of_another_size(robot: rpctl.Robot, field: str) -> None:
    good = rpctl.Command(np.zeros(robot.dof), np.zeros(robot.dof))
    bad = good._replace(**{field: np.zeros(3)})
    text = refusal(robot, kinematic=lambda *state: bad)
    assert text == (
        f"{field} of the kinematic law is an array (3,) of float64; give {robot.dof} real numbers"
    )


@pytest.mark.parametrize("value", [None, 0.0, np.zeros(2), np.full(4, np.nan), np.array(["a"] * 4)])
def test_efforts_that_are_none(robot: rpctl.Robot, value: Any) -> None:
    assert refusal(robot, dynamic=lambda *state: value).startswith("tau of the dynamic law is ")


def test_the_efforts_of_a_plain_function_are_used(robot: rpctl.Robot) -> None:
    tau = np.array([0.1, -0.2, 0.0, 0.0])
    run = track(robot, dynamic=lambda *state: tau)
    np.testing.assert_array_equal(run.tau[0], tau)
