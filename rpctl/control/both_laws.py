"""The laws of one run: in one kernel where both are in closed form, each with its substitute."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.dynamic import (
    PaperDynamic,
    PaperDynamicController,
    no_machine_code,
    unsupported,
)
from rpctl.control.law import (
    Command,
    DynamicLaw,
    EffortCommand,
    Efforts,
    KinematicLaw,
    Limit,
    Rest,
    Speeds,
)
from rpctl.control.law_kernel import RunningLaws, running_laws
from rpctl.control.safeguards import (
    FAILURES,
    LawWithFallback,
    require_command,
    require_efforts,
    require_speeds,
)
from rpctl.control.sampling import MeasuredSample
from rpctl.control.unified import UnifiedKinematic
from rpctl.control.velocity_output import VelocityController, VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DiffersError
from rpctl.reference.motion import Reference, WrongAnswerError


class Answer(NamedTuple):
    """What both laws make of a sample."""

    command: Command
    sent: Efforts | Speeds


class BothLaws:
    """A kinematic law, and what makes efforts or speeds of its command, on one robot in one run.

    Where the kinematic law fails, the unified law stands in; where the dynamic one does, the
    paper's within the effort limits, or the speeds that were sent last.

    Args:
        kinematic: The kinematic law.
        sent: The dynamic law, or the velocity output.
        dynamics: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.
        rest: State before the first sample, if it is known.
        compiled: Whether laws in closed form run as machine code.

    Attributes:
        kernel: Both laws as one; None where one of them is a function of Python's.
        compiled: Whether they run as machine code.
        speeds: The velocity output; None where efforts are sent.
        ahead: The state that the last answer is of, as predicted; None before.
        reference: What that answer follows.
    """

    def __init__(
        self,
        kinematic: KinematicLaw,
        sent: DynamicLaw | VelocityOutput,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None,
        compiled: bool,
    ) -> None:
        self._dynamics, started = dynamics, (dynamics, period, rest)
        self.kernel, self.compiled = laws_kernel((kinematic, sent), started, compiled)
        own: Any = {} if self.kernel is None else {"running": self.kernel}
        started_law: Any = kinematic.start(*started, **own)
        self._row: Any = getattr(started_law, "row", None)
        robot = dynamics.robot
        unified = UnifiedKinematic(approach=None).start(*started)
        self._kinematic = LawWithFallback(started_law, unified, partial(require_command, robot))
        self._sending: LawWithFallback[Efforts] | LawWithFallback[Speeds]
        self.speeds: VelocityController | None = None
        self.ahead: MeasuredSample | None = None
        if isinstance(sent, VelocityOutput):
            self.speeds = sent.start(*started, **own)
            self._sending = LawWithFallback(
                self.speeds, self.speeds.last, partial(require_speeds, robot)
            )
        else:
            self._sending = effort_law(sent, started, self.kernel)

    @property
    def reason(self) -> str:
        """Why a law was replaced at the last sample; "" where none was."""
        return self._kinematic.reason or self._sending.reason

    def answer(self, sample: MeasuredSample, reference: Reference) -> Answer | str:
        """Return what the laws make of a sample, or why they have no answer.

        Raises:
            RpctlError: A law does not fit, or answers with something that is no answer of its kind.
        """
        ahead = sample
        if self.speeds is not None:
            ahead, reference = self.speeds.predict(*sample), self.speeds.followed(reference)
        self.ahead, self.reference = ahead, reference
        answer = self._by_kernel(ahead, reference)
        if answer is not None:
            return answer
        command = self._kinematic(sample.t, self._dynamics, reference, *ahead)
        if command is None:
            return self._kinematic.reason
        if isinstance(command, EffortCommand):
            self._sending.was_answered()
            return Answer(command, command.efforts)
        sent = self._sending(sample.t, self._dynamics, ahead.q, ahead.nu, command)
        return self._sending.reason if sent is None else Answer(command, sent)

    def _by_kernel(self, sample: MeasuredSample, reference: Reference) -> Answer | None:
        """Return what the laws in closed form make of a sample; nothing where one has no answer.

        Then each is asked for itself, and its failure told.
        """
        kernel, (t, q, nu) = self.kernel, sample
        if kernel is None:
            return None
        try:
            row = self._row(self._dynamics, reference, t, q, nu)
        except WrongAnswerError:
            raise
        except FAILURES:
            return None
        if not kernel.ask(q, nu, row):
            return None
        self._kinematic.was_answered()
        self._sending.was_answered()
        kind = Efforts if self.speeds is None else Speeds
        return Answer(kernel.command(), kind(kernel.answer.copy(), kernel.limits()))

    def sampled_after(self, elapsed: float | None) -> None:
        """Tell both laws the time since the last sample; see :class:`rpctl.control.law.Timed`."""
        self._kinematic.sampled_after(elapsed)
        self._sending.sampled_after(elapsed)

    def kinematic_report(self) -> dict[str, float]:
        """Return what the kinematic law counts, by name."""
        return self._kinematic.report()

    def report(self) -> dict[str, float]:
        """Return 1 of ``machine_code`` where the laws run as such, and what they count."""
        found = {"machine_code": float(self.kernel is not None and self.compiled)}
        for name, law in (("kinematic", self._kinematic), ("dynamic", self._sending)):
            found |= {f"{name}.{key}": n for key, n in law.report().items()}
        return found

    def notes(self, samples: float) -> list[str]:
        """Return a sentence for each law that failed, and the kinematic law's own.

        Args:
            samples: How many there were so far.
        """
        own: list[str] = [*self._kinematic.notes()]
        second = "dynamic law" if self.speeds is None else "velocity output"
        return own + [
            f"the {name} failed at {law.failures} of {samples} samples, where a fallback law "
            f"replaced it; first at t = {law.first.t:.4g} s: {law.first.reason}"
            for name, law in (("kinematic law", self._kinematic), (second, self._sending))
            if law.first is not None
        ]


Started = tuple[ReducedDynamics, float, Rest | None]  # dynamics, period (s) and state before a run


def effort_law(law: Any, started: Started, kernel: RunningLaws | None) -> LawWithFallback[Efforts]:
    """Return a dynamic law of one run, in whose place the paper's stands where it fails.

    Args:
        law: The law.
        started: What the run starts with.
        kernel: The law's, if it has one.
    """
    paper: Any = _nothing
    if not started[0].robot.drive.leans:  # no other law holds up one that does
        paper = partial(_within_limits, PaperDynamic().start(*started))
    efforts: Any = law.start(*started, **({} if kernel is None else {"running": kernel}))
    return LawWithFallback(efforts, paper, partial(require_efforts, started[0].robot))


def laws_kernel(
    laws: tuple[Any, Any], started: Started, compiled: bool
) -> tuple[RunningLaws | None, bool]:
    """Return both laws as one kernel, if they can be, and whether it is machine code.

    Args:
        laws: The kinematic law, or None for commands from elsewhere, and what is sent.
    """
    (kinematic, sent), (dynamics, period, rest) = laws, started
    asked, leans = kinematic or UnifiedKinematic(), dynamics.robot.drive.leans
    if leans or unsupported(asked, PaperDynamic() if isinstance(sent, VelocityOutput) else sent):
        return None, compiled
    compiled = compiled and no_machine_code(asked, dynamics.robot) is None
    try:
        return running_laws(kinematic, sent, dynamics, period, rest, compiled), compiled
    except DiffersError:
        return running_laws(kinematic, sent, dynamics, period, rest), False


def _nothing(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
    """Return no efforts."""
    return Efforts(np.zeros(len(dynamics.robot.actuators)))


def _within_limits(
    law: PaperDynamicController, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command
) -> Efforts:
    """Return the efforts of the paper's law, cut off at their limits: what always can be had."""
    robot, tau = dynamics.robot, law(dynamics, q, nu, command).tau
    cut = np.clip(tau, -robot.effort_limits, robot.effort_limits)
    names = (robot.actuators[i] for i in np.flatnonzero(cut != tau))
    return Efforts(cut, tuple(Limit(name, "effort") for name in names))
