"""Wrong objects of a user's end in a message that says what to give instead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.reference.load import load_reference

ZEROS = np.zeros(4)
NAN = np.array([0.1, np.nan, 0.0])


def track(**given: Any) -> rpctl.Run:
    return rpctl.track(rpctl.load("paper"), **{"reference": "line", "duration": 0.02, **given})


def returned(**fields: Any) -> Any:
    """Return a reference that is a line's but for some fields of its states."""
    good = load_reference(rpctl.load("paper"), "line")
    return lambda t: good(t)._replace(**fields)


def commanded(**fields: Any) -> Any:
    return lambda *state: rpctl.Command(ZEROS, ZEROS)._replace(**fields)


CASES: list[tuple[dict[str, Any], str]] = [
    ({"reference": lambda t: None}, "(NoneType) at t = 0 s; return a rpctl.ReferenceState"),
    ({"reference": lambda t: NAN}, "(ndarray) at t = 0 s; return a rpctl.ReferenceState"),
    ({"reference": lambda t: returned()(t) if t < 0.009 else None}, "(NoneType) at t = 0.01 s"),
    ({"reference": returned(pose=[0.0, 0.0])}, "pose of the reference is [0.0, 0.0] (list); give"),
    ({"reference": returned(twist=np.zeros(7))}, "twist of the reference is an array (7,)"),
    ({"reference": returned(twist_dot=None)}, "twist_dot of the reference is None"),
    ({"reference": returned(joints=np.zeros(7))}, "the reference has 7 joints, paper has 2"),
    ({"reference": returned(joint_rates=None)}, "joint_rates of the reference is None"),
    ({"reference": returned(twist=NAN)}, "give finite numbers"),
    (
        {"kinematic": rpctl.UnifiedKinematic},
        "kinematic is the class UnifiedKinematic; give one of its objects: UnifiedKinematic(...)",
    ),
    *(({what: 7}, f"{what} is 7 (int); give a function") for what in ("reference", "dynamic")),
    ({"kinematic": lambda *state: (ZEROS, ZEROS)}, "(tuple); return a rpctl.Command("),
    ({"kinematic": commanded(nu_d=np.zeros(3))}, "nu_d of the kinematic law is an array (3,) of"),
    ({"kinematic": commanded(nu_d_dot=np.zeros(3))}, "nu_d_dot of the kinematic law is an array"),
    *(
        ({"dynamic": lambda *state, value=value: value}, "tau of the dynamic law is ")
        for value in (None, 0.0, np.zeros(2), np.full(4, np.nan), np.array(["a"] * 4))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("given", "told"), CASES)
def test_what_to_give_instead_is_told(given: dict[str, Any], told: str) -> None:
    with pytest.raises(rpctl.RpctlError) as refused:
        track(**given)
    assert told in str(refused.value)


def test_the_efforts_of_a_plain_function_are_used() -> None:
    tau = np.array([0.1, -0.2, 0.0, 0.0])
    np.testing.assert_array_equal(track(dynamic=lambda *state: tau).tau[0], tau)
