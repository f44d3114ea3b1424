"""``Reference``: where base and arm should be at a time, with first and second derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

MAX_SHOWN_CHARACTERS = 80  # of a value in a message


class ReferenceState(NamedTuple):
    """A reference at one time: base and arm, each with first and second derivatives.

    The twist is P's speed forward and to the left and the turning rate, in the axes of the
    reference itself; ``twist_dot`` holds the derivatives of these three numbers.

    ``direction`` (3, 3) is a vector along the twist that does not vanish where the reference
    stands still, and its first two derivatives by time: steered wheels point along it. None where
    the twist itself is all there is to know.
    """

    pose: Array  # (3,) of P: x, y in m, heading in rad
    twist: Array  # (3,) m/s, m/s, rad/s
    twist_dot: Array  # (3,) m/s², m/s², rad/s²
    joints: Array  # (n_joints,) rad or m
    joint_rates: Array  # (n_joints,)
    joint_accelerations: Array  # (n_joints,)
    direction: Array | None = None


Reference = Callable[[float], ReferenceState]


def end_effector_reference(robot: Robot, data: pin.Data, state: ReferenceState) -> pin.SE3:
    """Return the end effector's pose in the world where base and arm are on their reference.

    Raises:
        RpctlError: The robot has no end effector.
    """
    return robot.end_effector_pose(data, robot.configuration_at(state.pose, state.joints))


class WrongAnswerError(RpctlError):
    """What a reference or a law returned has not the form that it should have."""


class NotFiniteError(RpctlError):
    """What a reference or a law returned has the right form, and numbers that are not finite."""


def require_state(robot: Robot, state: object, t: float) -> ReferenceState:
    """Return what a reference returned, if it is a ``ReferenceState`` that fits the robot.

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
    for index, name in enumerate(ReferenceState._fields[:6]):
        length = 3 if index < 3 else len(robot.joints)
        require_numbers(name, " of the reference", state[index], length)
    return state


def require_numbers(name: str, whose: str, values: Any, length: int) -> None:
    """Refuse what is no array of this many finite numbers.

    Args:
        whose: Whose it is, in words that follow the name.
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
