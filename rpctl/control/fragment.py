"""What the statements of all laws have in common: structure, places, settings, names of limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.law import LawSample, Limit
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Place, Statement, statement, symbolic
from rpctl.reference.motion import row_sizes
from rpctl.robot.model import BASE_NV, Robot

# What has no answer at a sample: nothing, the kinematic or the dynamic law, or the kinematic one
# for such a reference ever.
ANSWERED, NO_COMMAND, NO_EFFORTS, REFUSED = 0.0, 1.0, 2.0, 3.0
DISTURBANCE, EXPECTED = "law disturbance", "law nu_dot before"  # buffers of an integral
TOO_LARGE = 1e300  # a square from which on numbers are not finite, or soon will not be
LIMIT_KINDS = ("", "velocity", "lower", "upper")  # of joints, as the buffer of limits counts them


def settings_of(kinematic: Any, sent: Any, known: ReducedDynamics, period: float) -> Array:
    """Return all numbers among the settings of laws (n,), as their statements take them.

    Laws of the same structure have as many, in the same order.

    Args:
        kinematic: The kinematic law, or None.
        sent: The dynamic law or the velocity output, or None.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    found = [x for law in (kinematic, sent) for x in _numbers(law, known, period).values()]
    return np.concatenate([np.empty(0), *map(np.ravel, found)])


def _numbers(law: Any, known: ReducedDynamics, period: float) -> dict[str, Any]:
    return {} if law is None else law.numbers_on(known, period)


@dataclass(frozen=True)
class LimitNames:
    """The limits that an entry of the buffer of limits stands for.

    Attributes:
        labels: Those that are told by an entry that is not 0.
        joints: Names of joints whose limits an index of ``LIMIT_KINDS`` tells; they come last.
    """

    labels: tuple[Limit, ...]
    joints: tuple[str, ...] = ()

    def __call__(self, row: Array) -> tuple[Limit, ...]:
        """Return the limits that bind by a row of ``limits``, in the order of the law."""
        if not row.dot(row):
            return ()
        count = len(self.labels)
        found = [limit for limit, flag in zip(self.labels, row[:count], strict=True) if flag]
        kinds = zip(self.joints, row[count:], strict=True)
        return tuple(found + [Limit(name, LIMIT_KINDS[int(kind)]) for name, kind in kinds if kind])


@dataclass(frozen=True, eq=False)
class LawFragment:
    """A kinematic law, and what makes efforts or speeds of its command, as statements.

    Attributes:
        q: Gets the measured configuration (nq,).
        nu: Gets the measured quasi-velocities (dof,).
        reference: Gets a row of a reference table.
        settings: Gets the settings' values, see :func:`settings_of`; they may differ by lane.
        elapsed: Gets the time since the last sample (1,), s; 0 if other efforts were sent since.
        model_nu: Gets, where speeds are sent, what they have led to so far (dof,).
        model_nu_dot: Gets, where speeds are sent, its mean rate since the last sample (dof,).
        e: Tracking error (3 + n_joints,).
        nu_d: Desired quasi-velocities (dof,).
        nu_d_dot: Their derivatives (dof,).
        tau: What is sent: efforts (n_act,), or speeds (dof,). Before ``start`` it gets the efforts
            that hold the robot at rest.
        limits: Which limits bind, as ``limit_names`` reads them.
        failed: ``ANSWERED``, or which law (1,) has no answer.
        start: What is done before the first sample: the memory of a robot at rest in ``q``.
        command: What makes the command of a sample.
        answer: What makes efforts or speeds of it. It changes no memory.
        remember: What is done after a sample that did not fail.
        memory: What the laws remember from sample to sample.
        limit_names: Makes limits of a row of ``limits``.
    """

    q: Buffer
    nu: Buffer
    reference: Buffer
    settings: Buffer
    elapsed: Buffer
    model_nu: Buffer
    model_nu_dot: Buffer
    e: Buffer
    nu_d: Buffer
    nu_d_dot: Buffer
    tau: Buffer
    limits: Buffer
    failed: Buffer
    start: tuple[Statement, ...]
    command: tuple[Statement, ...]
    answer: tuple[Statement, ...]
    remember: tuple[Statement, ...]
    memory: tuple[Buffer, ...]
    limit_names: LimitNames


class LawFrame:
    """The places that all laws' statements work on, and the kinematic law's statement.

    Args:
        kinematic: The kinematic law; None leaves the command to whoever has one.
        sent: The dynamic law, or the velocity output; None: nothing is sent.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Attributes:
        reduced: The same dynamics, Pinocchio's.
        asked: The kinematic law's numbers by name, symbols.
        s: Those of what is sent, likewise.
    """

    def __init__(self, kinematic: Any, sent: Any, known: SymbolicDynamics, period: float) -> None:
        robot, self.kinematic, self.known, self.period = known.robot, kinematic, known, period
        self.reduced = ReducedDynamics(robot)
        numbers = [_numbers(law, self.reduced, period) for law in (kinematic, sent)]
        sizes = [sum(map(np.size, each.values())) for each in numbers]
        self.settings, self.elapsed = new("settings", sum(sizes)), new("elapsed", 1)
        columns = math.vertsplit(self.settings[1], np.cumsum([0, *sizes]).tolist())
        self.asked, self.s = map(_split, numbers, columns)
        width = len(robot.actuators) if getattr(sent, "gives_efforts", False) else robot.dof
        self.q, self.nu = new("q", robot.nq), new("nu", robot.dof)
        self.reference = new("reference", sum(row_sizes(robot)))
        self.nu_d, self.nu_d_dot = new("nu_d", robot.dof), new("nu_d_dot", robot.dof)
        self.model_nu, self.tau = new("model nu", robot.dof), new("tau", width)
        self.model_nu_dot = new("model nu_dot", robot.dof)
        self.e, self.failed = new("e", BASE_NV + len(robot.joints)), new("failed", 1)

    @property
    def sample(self) -> LawSample:
        """The sample, in symbols of the buffers."""
        return LawSample(self.q[1], self.nu[1], self.nu_d[1], self.nu_d_dot[1])

    @property
    def sampled(self) -> list[Place]:
        """Where these are, and the settings."""
        return [self.q, self.nu, self.nu_d, self.nu_d_dot, self.settings]

    def fragment(self, limits: Buffer, names: LimitNames) -> LawFragment:
        """Return the fragment of the kinematic law, which sends nothing yet."""
        first = ("q", "nu", "reference", "settings", "elapsed", "model_nu", "model_nu_dot")
        places = (*first, "e", "nu_d", "nu_d_dot", "tau", "failed")
        found = {name: getattr(self, name)[0] for name in places}
        command = () if self.kinematic is None else (self.kinematic.command(self),)
        return LawFragment(
            **found, limits=limits, limit_names=names, command=command,
            start=(), answer=(), remember=(), memory=(),
        )  # fmt: skip

    def answered(
        self,
        name: str,
        sent: Any,
        labels: Sequence[Limit],
        binding: Any,
        more: Sequence[Place] = (),
    ) -> LawFragment:
        """Return the fragment of laws whose efforts or speeds are one call.

        Args:
            name: The call's.
            sent: Efforts (n_act, 1) or speeds (dof, 1).
            labels: Limits.
            binding: Which of them bind (n, 1).
            more: What the call reads besides the sample.
        """
        limits = Buffer("law limits", len(labels))
        outputs = [(self.tau[0], sent), (limits, binding)]
        outputs.append(self.still_failed(is_fine(self.known, self.q[1], sent)))
        call = statement(name, [*self.sampled, *more, self.failed], outputs)
        return replace(self.fragment(limits, LimitNames(tuple(labels))), answer=(call,))

    def still_failed(self, fine: Any) -> Place:
        """Return what becomes of ``failed`` where efforts or speeds are fine, or are not."""
        buffer, failed = self.failed
        here = math.if_else(fine, ANSWERED, NO_EFFORTS)
        return buffer, math.if_else(failed, failed, here)


def _split(numbers: Mapping[str, Any], column: Any) -> dict[str, Any]:
    """Return the parts of a column of settings by name."""
    ends = np.cumsum([0, *map(np.size, numbers.values())]).tolist()
    return dict(zip(numbers, math.vertsplit(column, ends), strict=True)) if numbers else {}


def is_fine(known: SymbolicDynamics, q: Any, *parts: Any) -> Any:
    """Return whether the steering is regular and numbers (n, 1) are finite."""
    fine = known.regular(q)
    for part in parts:
        fine = math.logic_and(fine, math.dot(part, part) < TOO_LARGE)
    return fine


def new(name: str, size: int) -> Place:
    """Return a buffer of the laws, and symbols for what is in it."""
    return symbolic(Buffer(f"law {name}", size))


def effort_labels(robot: Robot) -> list[Limit]:
    """Return the limits of the efforts."""
    return [Limit(name, "effort") for name in robot.actuators]


def law_fragment(kinematic: Any, sent: Any, known: SymbolicDynamics, period: float) -> LawFragment:
    """Return the statements of a kinematic law and of what makes efforts or speeds of it.

    The numbers among the laws' settings are inputs; what is compiled depends on the others only.
    A stage for far starts is left out: it only gives the law another reference.

    Args:
        kinematic: The kinematic law, one in closed form; None for commands from elsewhere.
        sent: The dynamic law, likewise, or the velocity output; None for the command alone.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    frame = LawFrame(kinematic, sent, known, period)
    if sent is None:
        return frame.fragment(Buffer("law limits", 0), LimitNames(()))
    found: LawFragment = sent.statements(frame)
    return found


def structure(setting: Any) -> object:
    """Return what is compiled in of a law: its numbers are inputs, all but whether one is 0.

    None in the place of a number stands for one that is found elsewhere.
    """
    if isinstance(setting, tuple):
        return [structure(each) for each in setting]
    if dataclasses.is_dataclass(setting):
        return type(setting).__name__, {k: structure(x) for k, x in vars(setting).items()}
    if setting is None or isinstance(setting, float | int):
        return setting is None or bool(setting)
    return () if isinstance(setting, Mapping) else setting
