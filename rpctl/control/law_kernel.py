"""Laws on one robot as a kernel: a sample is one call, of machine code or of a virtual machine."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.fragment import (
    ANSWERED,
    DISTURBANCE,
    EXPECTED,
    REFUSED,
    LawFragment,
    law_fragment,
    settings_of,
)
from rpctl.control.law import Command, Efforts, LawSample, ReportsNothing, Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import DiffersError, SolverError, UnfitLawError
from rpctl.kernels.machine_code import MachineCode, code_key
from rpctl.kernels.program import Buffer, Leave, Program, When
from rpctl.kernels.stored import stored
from rpctl.kernels.virtual_machine import VirtualMachine
from rpctl.reference.motion import Reference, row_reader
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot

EQUAL = 1e-10  # of a quantity's largest entry, or of 1; rounding leaves 1e-13
STATES, SEED = 8, 20210601
SPREAD = 0.02  # of positions about home and of speeds, m, rad and their rates
FAR = 1e3  # times that: the accelerations at which limits bind
MOST_KEPT = 32  # kernels of a process, some 300 kB each


@dataclass(frozen=True, eq=False)
class LawKernel:
    """Laws on one robot, to be run by any number of controllers.

    Attributes:
        fragment: The laws as statements.
        asks: Whether (1,) the kinematic law is asked; or else the command is there already.
        start: What makes the memory of a robot at rest.
        sample: What answers a sample.
    """

    fragment: LawFragment
    asks: Buffer
    start: MachineCode | VirtualMachine
    sample: MachineCode | VirtualMachine


_kept: deque[tuple[Robot, str, LawKernel]] = deque(maxlen=MOST_KEPT)


def law_kernel(
    kinematic: Any, sent: Any, dynamics: ReducedDynamics, period: float, compiled: bool
) -> LawKernel:
    """Return the kernel of laws; it may have been built before, machine code also on disk.

    Args:
        kinematic: The kinematic law; None for commands from elsewhere.
        sent: The dynamic law, or the velocity output.
        period: Control period, s.
        compiled: Whether it is machine code.

    Raises:
        DiffersError: Machine code gives other efforts than Pinocchio.
        RpctlError: A setting does not fit the robot or the period.
    """
    robot = dynamics.robot
    parts = laws_key(kinematic, sent, robot), period
    told = repr((parts, compiled))
    for known, key, kernel in _kept:
        if known is robot and key == told:
            return kernel

    def make() -> tuple[tuple[LawFragment, Buffer], Sequence[Program]]:
        law = law_fragment(kinematic, sent, SymbolicDynamics(robot), period)
        asks, leaves = Buffer("law asks", 1), Leave(law.failed)
        asked = (When(asks, (*law.command, leaves)),) if law.command else ()
        return (law, asks), (
            Program(law.start), Program((*asked, *law.answer, leaves, *law.remember)),
        )  # fmt: skip

    runs: Sequence[MachineCode | VirtualMachine]
    if compiled:
        (law, asks), runs = stored(code_key(robot_identity(robot), parts), make)
    else:
        (law, asks), programs = make()
        runs = [VirtualMachine(program) for program in programs]
    found = LawKernel(law, asks, *runs)
    if compiled and hasattr(sent, "free_efforts"):
        _require_equal(found, (kinematic, sent), dynamics, period)
    _kept.append((robot, told, found))
    return found


def _require_equal(
    kernel: LawKernel, laws: tuple[Any, Any], dynamics: ReducedDynamics, period: float
) -> None:
    """Refuse machine code whose efforts are not Pinocchio's, or, where limits bind, beyond them.

    Args:
        laws: The kinematic law or None, and the dynamic one.
        period: Control period, s.
    """
    robot, rng = dynamics.robot, np.random.default_rng(SEED)
    n, steered = len(robot.joints), len(robot.drive.steered)
    settings = settings_of(*laws, dynamics, period)
    draws = SPREAD * rng.normal(size=(2 * STATES, n + steered + 3 * robot.dof))
    draws[STATES:, -robot.dof :] *= FAR
    answered = 0
    for draw in draws:
        places, turned, rest = np.split(draw, [n, n + steered])
        q = robot.configuration_at(np.zeros(3), robot.home + places, turned)
        nu, *command = rest.reshape(3, robot.dof)
        running = RunningLaws(kernel, settings, period, None)
        if not running.follow(q, nu, Command(*command)):
            continue
        answered += 1
        if running.limits():
            require_within_limits(robot, running.answer)
            continue
        expected = laws[1].free_efforts(dynamics, period, LawSample(q, nu, *command), None)
        require_same(robot, "efforts", running.answer, expected)
    require_answers(robot, answered)


def require_answers(robot: Robot, count: int) -> None:
    """Refuse machine code that answered none of the states at which it was tried.

    Raises:
        DiffersError: There is no answer to compare.
    """
    if not count:
        raise DiffersError(f"machine code of {robot.name} answers no state near home")


def require_within_limits(robot: Robot, efforts: Array) -> None:
    """Refuse efforts of machine code beyond the robot's limits.

    Raises:
        DiffersError: One is.
    """
    beyond = np.abs(efforts) > (1.0 + EQUAL) * robot.effort_limits
    if beyond.any():
        name = robot.actuators[int(beyond.argmax())]
        raise DiffersError(f"machine code of {robot.name} asks {name} for more than its limit")


def require_same(robot: Robot, what: str, computed: Array, expected: Array) -> None:
    """Refuse numbers of machine code that are not Pinocchio's.

    Args:
        what: What they are, a plural.

    Raises:
        DiffersError: They differ.
    """
    residual = np.abs(computed - expected).max(initial=0.0)
    if not residual <= EQUAL * np.abs(expected).max(initial=1.0):
        raise DiffersError(
            f"machine code of {robot.name} gives other {what} than Pinocchio, by {residual:.2g}"
        )


def laws_key(kinematic: Any, sent: Any, robot: Robot) -> object:
    """Return all that the statements of laws depend on, besides the robot."""
    return [None if law is None else law.structure(robot) for law in (kinematic, sent)]


class RunningLaws:
    """A kernel of laws in one run, with what it remembers.

    Args:
        kernel: The kernel.
        settings: Of the laws (n,), see :func:`settings_of`.
        period: Control period, s.
        rest: State before the run; None starts every integral at zero.

    Attributes:
        compiled: Whether it is machine code.
        settings: Of the laws (n,), as the kernel reads them at each sample.
        model_nu: Gets what sent speeds have led to so far (dof,).
        model_nu_dot: Gets its mean rate since the last sample (dof,).
        learns: Whether there is an integral.
        answer: Efforts (n_act,) or speeds (dof,) of the last sample that was answered.
    """

    def __init__(
        self, kernel: LawKernel, settings: Array, period: float, rest: Rest | None
    ) -> None:
        law, self._kernel = kernel.fragment, kernel
        self.compiled = isinstance(kernel.sample, MachineCode)
        space = self._space = kernel.sample.workspace()
        if rest is not None and law.start:
            begins = kernel.start.workspace()
            begins[law.q][:, 0], begins[law.tau][:, 0] = rest.q, rest.tau
            kernel.start.stepper(begins)()
            for buffer in law.memory:
                space[buffer][:] = begins[buffer]
        buffers = (law.q, law.nu, law.reference, law.nu_d, law.nu_d_dot, law.tau, law.limits)
        views = [self._view(buffer) for buffer in buffers]
        self._q, self._nu, self._row, self._nu_d, self._nu_d_dot, self.answer, self._limits = views
        self._failed, self._asks = self._view(law.failed), self._view(kernel.asks)
        self._elapsed, self.model_nu = self._view(law.elapsed), self._view(law.model_nu)
        self.model_nu_dot = self._view(law.model_nu_dot)
        self.settings = self._view(law.settings)
        self.settings[:], self._elapsed[0] = settings, period
        kept = {buffer.name: self._view(buffer) for buffer in law.memory}
        self.learns = DISTURBANCE in kept
        self._d, self._expected = kept.get(DISTURBANCE), kept.get(EXPECTED)
        self._step = kernel.sample.stepper(space)

    def _view(self, buffer: Buffer) -> Array:
        """Return a buffer (size,); one that the kernel does not use is nowhere."""
        found = self._space.get(buffer)
        return np.zeros(buffer.size) if found is None else found[:, 0]

    def sampled_after(self, elapsed: float | None) -> None:
        """Take note of the time since the last call; see :class:`rpctl.control.law.Timed`."""
        self._elapsed[0] = elapsed or 0.0

    def moved(self, nu_dot: Array, missed: Array) -> None:
        """Take note of efforts other than the answer that arrived since the last sample.

        Where they were missed, the integral learns from what the others do not explain. The rest
        of the robot has to learn what it does to them that those are missing.

        Args:
            nu_dot: The model's ν̇ (dof,) under the efforts that arrived.
            missed: Which quasi-velocities (dof,) they drive.
        """
        if self._d is not None and self._expected is not None:
            self._expected[missed] = (nu_dot + self._d)[missed]

    def ask(self, q: Array, nu: Array, row: Array) -> bool:
        """Return whether both laws have an answer to a sample; they are ready, then.

        Where one has none, nothing is remembered: it may be asked again.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            row: Of a table of the reference.
        """
        self._q[:], self._nu[:], self._row[:], self._asks[0] = q, nu, row, 1.0
        return self._step()

    def follow(self, q: Array, nu: Array, command: Command) -> bool:
        """Return whether there is an answer to a command at a sample; it is ready, then.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
        """
        self._q[:], self._nu[:], self._asks[0], self._failed[0] = q, nu, 0.0, ANSWERED
        self._nu_d[:], self._nu_d_dot[:] = command
        return self._step()

    @property
    def failed(self) -> float:
        """What had no answer at the last sample, see :mod:`rpctl.control.fragment`."""
        return float(self._failed[0])

    def command(self) -> Command:
        """Return the command of the last sample."""
        return Command(self._nu_d.copy(), self._nu_d_dot.copy())

    def limits(self) -> tuple[Any, ...]:
        """Return the limits that bind the last answer."""
        return self._kernel.fragment.limit_names(self._limits)


class CommandLaw(ReportsNothing):
    """A kinematic law on one robot in one run.

    Args:
        running: Its kernel, or one that has a dynamic law as well.
        refusal: What is said where it cannot follow a reference.
    """

    def __init__(self, running: RunningLaws, refusal: str, robot: Robot) -> None:
        self._running, self._refusal, self._robot = running, refusal, robot
        self._read: tuple[Reference, Callable[[float], Array]] | None = None

    def row(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Array:
        """Return the row of what is tracked at a time (s), of its table: the reference's own."""
        if self._read is None or self._read[0] is not reference:
            self._read = reference, row_reader(self._robot, reference)
        return self._read[1](t)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its derivative along the actual motion.

        Raises:
            SingularBasisError: At q the steered wheels fix no one motion.
            UnfitLawError: The law cannot follow the reference.
        """
        if not self._running.ask(q, nu, self.row(dynamics, reference, t, q, nu)):
            if self._running.failed == REFUSED:
                raise UnfitLawError(self._refusal)
            dynamics.at(q)
        return self._running.command()


class LimitedLaw(ReportsNothing):
    """A dynamic law within limits on one robot in one run.

    Args:
        running: Its kernel, or one that has a kinematic law as well.
    """

    def __init__(self, running: RunningLaws) -> None:
        self._running, self.sampled_after = running, running.sampled_after

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,) and the limits that bind.

        An integral advances by the time since the last call, one period unless ``sampled_after``
        told another.

        Raises:
            SingularBasisError: At q the steered wheels fix no one motion.
            SolverError: The search for the limits that bind does not end.
        """
        if not self._running.follow(q, nu, command):
            dynamics.inverse(q, nu, command.nu_d_dot)
            raise SolverError("the search for efforts within limits found no finite efforts")
        return Efforts(self._running.answer.copy(), self._running.limits())


def running_laws(
    kinematic: Any,
    sent: Any,
    dynamics: ReducedDynamics,
    period: float,
    rest: Rest | None,
    compiled: bool = False,
) -> RunningLaws:
    """Return laws on one robot in one run; :func:`law_kernel` has the arguments."""
    settings = settings_of(kinematic, sent, dynamics, period)
    kernel = law_kernel(kinematic, sent, dynamics, period, compiled)
    return RunningLaws(kernel, settings, period, rest)
