"""``LawFragment``: the laws of the controller as statements of a program, and its buffers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.law import Limit
from rpctl.control.twist_law import BaseLaw, reference_sizes
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.basis import SINGULAR
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Place, Statement, symbolic
from rpctl.simulation.compiled.laws.dynamic import LawSample
from rpctl.simulation.compiled.laws.tracking import (
    ClosedFormDynamic,
    settings_of,
    symbolic_command,
    symbols_of,
)

TOO_LARGE = 1e300  # a square from which on numbers are not finite, or soon will not be
LIMIT_KINDS = ("", "velocity", "lower", "upper")  # of joints, as the buffer of limits counts them


class LimitNames:
    """The limits that an entry of the buffer of limits stands for.

    Args:
        actuators: Names of the actuators.
        joints: Names of the joints with limits of rates or positions.
    """

    def __init__(self, actuators: Sequence[str], joints: Sequence[str]) -> None:
        self._efforts = [Limit(name, "effort") for name in actuators]
        self._joints = [[Limit(name, kind) for kind in LIMIT_KINDS] for name in joints]

    def __call__(self, row: Array) -> tuple[Limit, ...]:
        """Return the limits that bind by a row of ``limits``, in the order of the law."""
        if not row.any():
            return ()
        count = len(self._efforts)
        found = [limit for limit, flag in zip(self._efforts, row[:count], strict=True) if flag]
        kinds = zip(self._joints, row[count:], strict=True)
        return tuple(found + [labels[int(kind)] for labels, kind in kinds if kind])


@dataclass(frozen=True, eq=False)
class LawFragment:
    """A kinematic and a dynamic law as statements.

    Attributes:
        q: Gets the measured configuration (nq,).
        nu: Gets the measured quasi-velocities (dof,).
        reference: Gets a row of a reference table.
        settings: Gets the settings' values, see :func:`settings_of`; they may differ by lane.
        elapsed: Gets the time since the last sample (1,), s, where it is not the period.
        e: Tracking error (3 + n_joints,).
        nu_d: Desired quasi-velocities (dof,).
        nu_d_dot: Their derivatives (dof,).
        tau: Efforts (n_act,). Before ``start`` it gets those that hold the robot at rest.
        limits: Which limits bind: 1 for each actuator at its effort limit, then for each joint an
            index of ``LIMIT_KINDS``, 0 for none.
        failed: Whether (1,) the laws have no answer, so that Python's have to be asked.
        start: What is done before the first sample: the memory of a robot at rest in ``q``.
        body: What is done at a sample. It changes no memory.
        remember: What is done after a sample that did not fail.
        memory: What the laws remember from sample to sample.
        setting_names: Names of the settings.
        limit_names: Makes limits of a row of ``limits``.
    """

    q: Buffer
    nu: Buffer
    reference: Buffer
    settings: Buffer
    elapsed: Buffer
    e: Buffer
    nu_d: Buffer
    nu_d_dot: Buffer
    tau: Buffer
    limits: Buffer
    failed: Buffer
    start: tuple[Statement, ...]
    body: tuple[Statement, ...]
    remember: tuple[Statement, ...]
    memory: tuple[Buffer, ...]
    setting_names: tuple[str, ...]
    limit_names: LimitNames


class LawFrame:
    """What the fragments of all laws have in common: inputs, and the kinematic law's command.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Attributes:
        reduced: The same dynamics, Pinocchio's.
        sample: The command and the state, in symbols of the inputs.
        inputs: Buffers and symbols of q, ν, the reference and the settings.
        later: The command and the state once the command is known, in symbols of the buffers.
        later_inputs: These buffers and symbols.
        tau: Buffer of the efforts.
        elapsed: Buffer of the time since the last sample.
    """

    def __init__(
        self,
        kinematic: BaseLaw,
        dynamic: ClosedFormDynamic,
        known: SymbolicDynamics,
        period: float,
    ) -> None:
        robot = known.robot
        self.known, self.period, self.reduced = known, period, ReducedDynamics(robot)
        self.names, _ = settings_of(kinematic, dynamic, self.reduced, period)
        width = sum(reference_sizes(robot))
        sizes = {"q": robot.nq, "nu": robot.dof, "reference": width, "settings": len(self.names)}
        self.inputs = [new(name, size) for name, size in sizes.items()]
        q, nu, row, column = (symbols for _, symbols in self.inputs)
        s = symbols_of(self.names, column)
        self._command = symbolic_command(kinematic, known, row, q, nu, s)
        self.sample = LawSample(q, nu, self._command.nu_d, self._command.nu_d_dot, s)
        self.tau, self.elapsed = Buffer("law tau", len(robot.actuators)), Buffer("elapsed", 1)
        sizes = {"e": self._command.e.numel(), "nu_d": robot.dof, "nu_d_dot": robot.dof}
        known_later = [new(name, size) for name, size in sizes.items()]
        self._outputs = [*(buffer for buffer, _ in known_later), Buffer("law failed", 1)]
        (_, nu_d), (_, nu_d_dot) = known_later[1:]
        self.later = LawSample(q, nu, nu_d, nu_d_dot, s)
        self.later_inputs = [self.inputs[0], self.inputs[1], self.inputs[3], *known_later[1:]]

    @property
    def failed(self) -> Buffer:
        """Whether the laws have no answer."""
        return self._outputs[-1]

    def commanded(self, tau: Any) -> list[Place]:
        """Return the outputs of the kinematic law, and whether one of the laws has failed.

        Args:
            tau: Efforts (n_act, 1).
        """
        found, q = self._command, self.sample.q
        fine = self.known.rank_margin(q) > SINGULAR
        for part in (found.nu_d, found.nu_d_dot, tau):
            fine = casadi.logic_and(fine, casadi.dot(part, part) < TOO_LARGE)
        failed = casadi.logic_or(found.failed, casadi.logic_not(fine))
        return list(zip(self._outputs, (found.e, found.nu_d, found.nu_d_dot, failed), strict=True))

    def fragment(
        self,
        limits: Buffer,
        names: LimitNames,
        body: tuple[Statement, ...],
        start: tuple[Statement, ...] = (),
        remember: tuple[Statement, ...] = (),
        memory: tuple[Buffer, ...] = (),
    ) -> LawFragment:
        """Return the fragment.

        Args:
            limits: Buffer of the limits that bind.
            names: Of these.
            body: What is done at a sample.
            start: What is done before the first sample.
            remember: What is done after a sample.
            memory: What is remembered.
        """
        e, nu_d, nu_d_dot, failed = self._outputs
        q, nu, reference, settings = (buffer for buffer, _ in self.inputs)
        return LawFragment(
            q=q,
            nu=nu,
            reference=reference,
            settings=settings,
            elapsed=self.elapsed,
            e=e,
            nu_d=nu_d,
            nu_d_dot=nu_d_dot,
            tau=self.tau,
            limits=limits,
            failed=failed,
            start=start,
            body=body,
            remember=remember,
            memory=memory,
            setting_names=self.names,
            limit_names=names,
        )


def new(name: str, size: int) -> Place:
    """Return a buffer of the laws, and symbols for what is in it.

    Args:
        name: The buffer's.
        size: Of both.
    """
    return symbolic(Buffer(f"law {name}", size))
