"""What a user's reference hands over, checked before anything computes with it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

STATE_FIELDS = ReferenceState._fields[:6]
MAX_SHOWN_CHARACTERS = 80  # of a value in a message


class WrongAnswerError(RpctlError):
    """What a reference or a law returned has not the form that it should have."""


class NotFiniteError(RpctlError):
    """What a reference or a law returned has the right form, and numbers that are not finite."""


def require_state(robot: Robot, state: object, t: float) -> ReferenceState:
    """Return what a reference returned, if it is a ``ReferenceState`` that fits the robot.

    Args:
        robot: The robot that follows.
        state: What the reference returned.
        t: At which time, s.

    Raises:
        WrongAnswerError: It is something else; what to return is said.
    """
    if not isinstance(state, ReferenceState):
        raise WrongAnswerError(
            f"the reference returns {shown(state)} at t = {t:g} s; return a rpctl.ReferenceState, "
            "or let rpctl.as_reference(function) make one of x, y, heading and joints"
        )
    if np.ndim(state.joints) == 1 and len(state.joints) != len(robot.joints):
        raise WrongAnswerError(
            f"the reference has {len(state.joints)} joints, {robot.name} has {len(robot.joints)}"
        )
    for index, name in enumerate(STATE_FIELDS):
        length = 3 if index < 3 else len(robot.joints)
        require_numbers(name, " of the reference", state[index], length)
    return state


def require_numbers(name: str, whose: str, values: Any, length: int) -> None:
    """Refuse what is no array of this many finite numbers.

    Args:
        name: Of the array.
        whose: Whose it is, in words that follow the name.
        values: What was handed over.
        length: How many numbers it has to hold.

    Raises:
        NotFiniteError: A number is not finite.
        WrongAnswerError: It is something else; what to give is said.
    """
    if not isinstance(values, np.ndarray):
        raise WrongAnswerError(
            f"{name}{whose} is {shown(values)}; give an array of {length} numbers"
        )
    if values.shape != (length,) or values.dtype.kind not in "fiu":
        raise WrongAnswerError(
            f"{name}{whose} is an array {values.shape} of {values.dtype}; "
            f"give {length} real numbers"
        )
    if not math.isfinite(values @ values):  # of so few numbers the fastest
        raise NotFiniteError(f"{name}{whose} is {shown(values)}; give finite numbers")


def shown(value: object) -> str:
    """Return a value and its type, in a few characters."""
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = f"{text[:MAX_SHOWN_CHARACTERS]}..."
    return f"{text} ({type(value).__name__})"
