"""What keeps a controller going: checks of answers, a law's substitute, a watchdog, and a stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.law import (
    Command,
    Efforts,
    Speeds,
    Timed,
    as_controller,
    as_efforts,
)
from rpctl.control.sampling import MeasuredSample
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import NotFiniteError, WrongAnswerError, require_numbers, shown
from rpctl.robot.model import Robot


@dataclass(frozen=True, kw_only=True)
class Guards(Record):
    """Settings for missing samples, jumps of the pose, and robots that do not follow."""

    stale_after: Annotated[
        float,
        POSITIVE,
        Setting("s", "", "Time without a good sample after which the controller brakes the robot."),
    ] = 0.1
    lost_after: Annotated[
        float,
        POSITIVE,
        Setting("s", "", "How long a robot may stay at its limits while its error does not fall."),
    ] = 2.0
    fading: Annotated[
        float,
        POSITIVE,
        Setting(
            "m/s or rad/s",
            "",
            "Rate at which the controller feeds in a sudden error, such as that of a pose that "
            "jumps or of a resumed reference.",
        ),
    ] = 0.6
    effort_rate: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "1/s",
            "",
            "Largest rate of each effort, relative to its limit; default: 100, after the first "
            "sample.",
        ),
    ] = None


EFFORT_RATE = 100.0  # 1/s: of efforts over their limits; quick enough for any motion, and no blow

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
            self.was_answered()
            return answer
        if type(error) in MISFITS and not self._answered:
            raise error
        self.failures, self.reason = self.failures + 1, str(error) or type(error).__name__
        self.first = self.first or Failure(t, self.reason)
        return self._ask(self._substitute, arguments)[0]

    def was_answered(self) -> None:
        """Take note that the law has answered a sample elsewhere, as part of a kernel."""
        self._answered, self.reason = True, ""

    def sampled_after(self, elapsed: float | None) -> None:
        """Tell the law the time since the last call; see :class:`rpctl.control.law.Timed`.

        Args:
            elapsed: s; None if what was sent since then was not what the law answered.
        """
        if self._is_timed:
            self._controller.sampled_after(None if self.reason else elapsed)

    def report(self) -> dict[str, float]:
        """Return the report of the law."""
        return dict(self._controller.report())

    def notes(self) -> tuple[str, ...]:
        """Return sentences on what became of the law, if it has any."""
        return tuple(self._controller.notes()) if hasattr(self._controller, "notes") else ()

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


BRAKING_TIME = 0.3  # s: time constant with which the speeds decay
LONGEST_STEP = 0.01  # s, of the model's motion
LONGEST_PREDICTION = 1.0  # s: after a longer silence nothing is known of the motion


class Braking:
    """Brakes a robot from its last measured state: ν̇ = −ν/T along the motion of its model.

    The efforts stay inside their limits; where these are too narrow, it brakes more slowly. Once
    the model stands, they are those that hold it.

    Args:
        sent: Efforts (n_act,) that were sent until now.
        alone: Whether base and arm are each braked as if the other did not accelerate: it may not
            do what it is sent.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        sample: MeasuredSample,
        sent: Array,
        alone: bool = False,
    ) -> None:
        self._dynamics, self._sent, self._alone = dynamics, sent, alone
        self._t, self._q, self._nu = sample

    def efforts(self, t: float) -> Array | None:
        """Return the efforts (n_act,) to send now, at a time (s); None where the model has none."""
        dynamics, sent, box = self._dynamics, self._sent, self._dynamics.robot.effort_limits
        try:
            self._advance(t - self._t, sent)
            push = self._push(-self._nu / BRAKING_TIME)
            tau = np.clip(dynamics.efforts(self._q, push), -box, box)
        except FAILURES:
            return None
        if not np.isfinite(tau).all():
            return None
        self._t, self._sent = t, tau
        return tau

    def _push(self, nu_dot: Array) -> Array:
        """Return the quasi-force (dof,) of an acceleration (dof,)."""
        if not self._alone:
            return self._dynamics.inverse(self._q, self._nu, nu_dot)
        robot = self._dynamics.robot
        arm = np.arange(robot.dof) >= robot.dof - len(robot.joints)
        pushes = [
            self._dynamics.inverse(self._q, self._nu, np.where(part, nu_dot, 0.0))
            for part in (arm, ~arm)
        ]
        return np.where(arm, *pushes)

    def _advance(self, elapsed: float, tau: Array) -> None:
        """Let the model move under efforts (n_act,) for a time (s)."""
        steps = math.ceil(min(elapsed, LONGEST_PREDICTION) / LONGEST_STEP)
        for _ in range(steps):
            self._q, self._nu, *_ = step(
                self._dynamics, self._q, self._nu, tau, min(elapsed / steps, LONGEST_STEP)
            )


IDLE = 0.02  # m/s or rad/s: a robot whose speeds miss those it was sent by less follows them
PROGRESS = 0.05  # of an error: one that falls by less does not fall
LOST_ERROR = 0.15  # m or rad: no robot is lost that is nearer to its reference
FREE = 0.25  # s: a robot that is at no limit for as long is free again


class Watchdog:
    """Tells a robot that does not do what it is sent: at its limits, and its error does not fall.

    Args:
        patience: For how long that may last, s.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._since, self._least = math.inf, math.inf  # s; m or rad
        self._bound_at, self._bound_since = -math.inf, math.inf  # s; at limits, but for moments

    @property
    def bound(self) -> bool:
        """Whether the robot is at its limits, but for moments; only then its error matters."""
        return math.isfinite(self._bound_since)

    def lost(self, t: float, at_limit: bool, error: float) -> bool:
        """Return whether the robot is lost at a sample.

        Args:
            t: Time, s.
            at_limit: Whether limits keep the robot from what its law wants.
            error: Of what is tracked, m or rad.
        """
        self._bound_at = t if at_limit else self._bound_at
        free = t - self._bound_at > FREE
        self._bound_since = math.inf if free else min(self._bound_since, t)
        if free or error < LOST_ERROR:
            self._since, self._least = math.inf, math.inf
        elif error < (1.0 - PROGRESS) * self._least or math.isinf(self._since):
            self._since, self._least = t, error
        return t - self._since > self._patience

    def first_lost(self, t: Array, at_limit: NDArray[np.bool_], errors: Array) -> int | None:
        """Return the number of the first sample at which the robot is lost; None: at none.

        Args:
            t: Time (K,), s.
            at_limit: Whether limits keep it from what its law wants (K,).
            errors: Of what is tracked (K, n), m or rad.
        """
        if not (at_limit.any() or self.bound):
            return None
        largest = np.abs(errors).max(axis=1, initial=0.0)
        rows = zip(t.tolist(), at_limit.tolist(), largest.tolist(), strict=True)
        return next((k for k, row in enumerate(rows) if self.lost(*row)), None)


def falls_short(nu: Array, sent: Array) -> Any:
    """Return whether speeds (..., dof) miss those that were sent by more than a robot that follows.

    A robot that stands, as good as, follows.
    """
    miss = np.linalg.norm(nu - sent, axis=-1)
    return miss > IDLE + 0.5 * np.linalg.norm(sent, axis=-1)
