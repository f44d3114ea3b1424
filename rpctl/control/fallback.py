"""A law that may fail at a sample, its substitute, and the checks of what both return."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from rpctl.arrays import Array
from rpctl.control.joint_limits import Speeds
from rpctl.control.law import Command, Efforts, Preparing, Timed, as_controller, as_efforts
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.reference.motion import NotFiniteError, WrongAnswerError, require_numbers, shown
from rpctl.robot.model import Robot

FAILURES = (RpctlError, np.linalg.LinAlgError, ArithmeticError)  # of a computation at one sample
MISFITS = (RpctlError, NotFiniteError)  # which show at the first sample that a law does not fit

Answer = TypeVar("Answer")


def require_callable(what: str, given: object) -> None:
    """Refuse a reference or a law that is no function, nor anything that can be called so.

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

    Raises:
        NotFiniteError: A number of it is not finite.
    """
    require_numbers("nu", " of the velocity output", speeds.nu, robot.dof)
    return speeds


class Failure(NamedTuple):
    """A sample at which a law failed."""

    t: float  # s
    reason: str


class LawWithFallback(Generic[Answer]):
    """The controller of a law; where it fails or answers without finite numbers, a substitute.

    What is no failure at a sample but a mistake is raised: an answer of a wrong type or length, a
    law that cannot follow such a reference, and one that refuses or has no finite answer before it
    ever had one. A solver may give up, and a posture be singular, at the first sample as well.

    Args:
        controller: What a law started, or a plain function.
        substitute: The controller that takes its place, or a plain function.
        check: Returns the answer of a controller, checked.

    Attributes:
        failures: Number of samples at which the law failed.
        first: The first of them; None without one.
        reason: Why the last call was answered by the substitute, or by nobody; "" if it was not.
    """

    def __init__(
        self, controller: object, substitute: object, check: Callable[[Any], Answer]
    ) -> None:
        self._controller: Any = as_controller(controller)
        # A protocol takes long to look for, and a controller keeps its methods: once is enough.
        self._is_timed = isinstance(self._controller, Timed)
        self._prepares = isinstance(self._controller, Preparing)
        self._check = check
        self._substitute = substitute
        self.failures, self.reason, self._answered = 0, "", False
        self.first: Failure | None = None

    def __call__(self, t: float, *arguments: Any) -> Answer | None:
        """Return the law's answer, or else the substitute's; None if that fails, too.

        Raises:
            RpctlError: The law does not fit.
        """
        answer, error = self._ask(self._controller, arguments)
        if error is None:
            self._answered, self.reason = True, ""
            return answer
        if type(error) in MISFITS and not self._answered:
            raise error
        self.failures, self.reason = self.failures + 1, str(error) or type(error).__name__
        self.first = self.first or Failure(t, self.reason)
        return self._ask(self._substitute, arguments)[0]

    def sampled_after(self, elapsed: float | None) -> None:
        """Tell the law the time since the last call; see :class:`rpctl.control.law.Timed`.

        Args:
            elapsed: s; None if what was sent since then was not what the law answered.
        """
        if self._is_timed:
            self._controller.sampled_after(None if self.reason else elapsed)

    def prepare(self, t: float, q: Array, nu: Array, after: float) -> None:
        """Let the law compute ahead, if it can; see :class:`rpctl.control.law.Preparing`.

        What fails here shows at the next sample.

        Args:
            after: Time until the next sample, s.
        """
        if self._prepares:
            with suppress(*FAILURES):
                self._controller.prepare(t, q, nu, after)

    def report(self) -> dict[str, float]:
        """Return the report of the law."""
        report: dict[str, float] = self._controller.report()
        return report

    def _ask(
        self, controller: Any, arguments: tuple[Any, ...]
    ) -> tuple[Answer | None, Exception | None]:
        """Return a controller's answer, or why there is none."""
        try:
            return self._check(controller(*arguments)), None
        except (WrongAnswerError, UnfitLawError):
            raise
        except FAILURES as error:
            return None, error
