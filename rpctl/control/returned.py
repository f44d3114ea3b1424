"""What a user's reference and laws hand over, checked before anything computes with it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.control.law import Command, Efforts, as_efforts
from rpctl.control.speed_limits import Speeds
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

STATE_FIELDS = ReferenceState._fields[:6]
MAX_SHOWN_CHARACTERS = 80  # of a value in a message


class WrongAnswerError(RpctlError):
    """What a reference or a law returned has not the form that it should have."""


class NotFiniteError(RpctlError):
    """What a reference or a law returned has the right form, and numbers that are not finite."""


def require_callable(what: str, given: object) -> None:
    """Refuse a reference or a law that is no function, nor anything that can be called so.

    Args:
        what: What it is given as.
        given: What was given.

    Raises:
        RpctlError: It cannot be used; what to give is said.
    """
    if isinstance(given, type):
        raise RpctlError(
            f"{what} is the class {given.__name__}; give one of its objects: {given.__name__}(...)"
        )
    if not (callable(given) or hasattr(given, "start")):
        raise RpctlError(f"{what} is {_shown(given)}; give a function, or an object of rpctl's")


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
            f"the reference returns {_shown(state)} at t = {t:g} s; return a rpctl.ReferenceState, "
            "or let rpctl.as_reference(function) make one of x, y, heading and joints"
        )
    if np.ndim(state.joints) == 1 and len(state.joints) != len(robot.joints):
        raise WrongAnswerError(
            f"the reference has {len(state.joints)} joints, {robot.name} has {len(robot.joints)}"
        )
    for index, name in enumerate(STATE_FIELDS):
        length = 3 if index < 3 else len(robot.joints)
        _require_numbers(name, " of the reference", state[index], length)
    return state


def require_command(robot: Robot, command: object) -> Command:
    """Return what a kinematic law returned, if it is a ``Command`` of the robot's size.

    Args:
        robot: The robot.
        command: What the law returned.

    Raises:
        NotFiniteError: A number of it is not finite.
        WrongAnswerError: It is something else; what to return is said.
    """
    if not isinstance(command, Command):
        raise WrongAnswerError(
            f"the kinematic law returns {_shown(command)}; return a rpctl.Command(nu_d, nu_d_dot)"
        )
    _require_numbers("nu_d", " of the kinematic law", command.nu_d, robot.dof)
    _require_numbers("nu_d_dot", " of the kinematic law", command.nu_d_dot, robot.dof)
    return command


def require_efforts(robot: Robot, efforts: Any) -> Efforts:
    """Return what a dynamic law returned as efforts, if there is one for each actuator.

    Args:
        robot: The robot.
        efforts: What the law returned: an array (n_act,), or ``Efforts``.

    Raises:
        NotFiniteError: A number of it is not finite.
        WrongAnswerError: It is something else; what to return is said.
    """
    known = as_efforts(efforts)
    _require_numbers("tau", " of the dynamic law", known.tau, len(robot.actuators))
    return known


def require_speeds(robot: Robot, speeds: Speeds) -> Speeds:
    """Return what a velocity output returned, if its numbers are finite.

    Args:
        robot: The robot.
        speeds: What was returned.

    Raises:
        NotFiniteError: A number of it is not finite.
    """
    _require_numbers("nu", " of the velocity output", speeds.nu, robot.dof)
    return speeds


def _require_numbers(name: str, whose: str, values: Any, length: int) -> None:
    """Refuse what is no array of this many finite numbers."""
    if not isinstance(values, np.ndarray):
        raise WrongAnswerError(
            f"{name}{whose} is {_shown(values)}; give an array of {length} numbers"
        )
    if values.shape != (length,) or values.dtype.kind not in "fiu":
        raise WrongAnswerError(
            f"{name}{whose} is an array {values.shape} of {values.dtype}; "
            f"give {length} real numbers"
        )
    if not math.isfinite(values @ values):  # of so few numbers the fastest
        raise NotFiniteError(f"{name}{whose} is {_shown(values)}; give finite numbers")


def _shown(value: object) -> str:
    """Return a value and its type, in a few characters."""
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = f"{text[:MAX_SHOWN_CHARACTERS]}..."
    return f"{text} ({type(value).__name__})"
