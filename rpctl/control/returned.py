"""What a user's laws hand over, checked before anything computes with it."""

from __future__ import annotations

from typing import Any

from rpctl.control.law import Command, Efforts, as_efforts
from rpctl.control.speed_limits import Speeds
from rpctl.errors import RpctlError
from rpctl.reference.required import WrongAnswerError, require_numbers, shown
from rpctl.robot.model import Robot


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
        raise RpctlError(f"{what} is {shown(given)}; give a function, or an object of rpctl's")


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
            f"the kinematic law returns {shown(command)}; return a rpctl.Command(nu_d, nu_d_dot)"
        )
    require_numbers("nu_d", " of the kinematic law", command.nu_d, robot.dof)
    require_numbers("nu_d_dot", " of the kinematic law", command.nu_d_dot, robot.dof)
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
    require_numbers("tau", " of the dynamic law", known.tau, len(robot.actuators))
    return known


def require_speeds(robot: Robot, speeds: Speeds) -> Speeds:
    """Return what a velocity output returned, if its numbers are finite.

    Args:
        robot: The robot.
        speeds: What was returned.

    Raises:
        NotFiniteError: A number of it is not finite.
    """
    require_numbers("nu", " of the velocity output", speeds.nu, robot.dof)
    return speeds
