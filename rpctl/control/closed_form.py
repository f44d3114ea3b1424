"""Laws in closed form: what makes them kernels, and which laws are none."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from rpctl.arrays import Array
from rpctl.control.approach import Approach
from rpctl.control.error import Leash
from rpctl.control.fragment import LawFragment, LawFrame
from rpctl.control.law import EffortController, LawSample, Rest
from rpctl.control.twist_law import BaseLaw, formula
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import Record
from rpctl.kernels.structure import structure
from rpctl.robot.model import Robot

if TYPE_CHECKING:
    from rpctl.control.law_kernel import RunningLaws


class ClosedFormDynamic(Record, ABC):
    """A dynamic law whose efforts are statements of a kernel."""

    gives_efforts: ClassVar[bool] = True

    def start(
        self,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None = None,
        running: RunningLaws | None = None,
    ) -> EffortController:
        """Return the controller of one run, for whatever commands.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: State before the run; None starts an integral at zero.
            running: Its kernel, if it is part of one that has a kinematic law as well.

        Raises:
            RpctlError: A setting does not fit the robot or the period.
        """
        from rpctl.control.law_kernel import LimitedLaw, running_laws

        return LimitedLaw(running or running_laws(None, self, dynamics, period, rest))

    def structure(self, robot: Robot) -> object:
        """Return what of the law is compiled in on a robot; its numbers are not.

        What a class of a user's own says is told by the class itself, in this process only.
        """
        known = type(self).__module__.startswith("rpctl.")
        return structure(self), None if known else id(type(self))

    @abstractmethod
    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numbers among the settings on one robot, by name: floats, or arrays (dof,).

        Args:
            known: Its dynamics, as far as the controller knows them.
            period: Control period, s.
        """

    @abstractmethod
    def free_efforts(
        self, known: ReducedDynamics, period: float, sample: LawSample, rest: Rest | None
    ) -> Array:
        """Return τ (n_act,) of a first sample that no limit binds, with Pinocchio's dynamics.

        It is what a kernel is checked against.

        Args:
            known: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: State before the run.
        """

    @abstractmethod
    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the statements that make efforts of the frame's command."""


def unsupported(kinematic: Any, dynamic: Any) -> str | None:
    """Return why laws are no statements, a clause; None if they are.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
    """
    if not isinstance(kinematic, BaseLaw) or _starts_itself(kinematic):
        return f"the kinematic law {_name(kinematic)} is not one that is compiled"
    if type(kinematic.leash) not in (type(None), Leash):
        return f"the leash {_name(kinematic.leash)} is not one that is compiled"
    if type(kinematic.approach) not in (type(None), Approach):
        return f"the approach {_name(kinematic.approach)} is not one that is compiled"
    for law in (dynamic, getattr(dynamic, "inner", dynamic)):
        if not isinstance(law, ClosedFormDynamic) or _starts_itself(law):
            return f"the dynamic law {_name(law)} is not one that is compiled"
    return None


def no_machine_code(law: Any, robot: Robot) -> str | None:
    """Return what of a user's own law has no machine code, a clause; None if all of it has."""
    if type(law).__module__.startswith("rpctl."):
        return None
    from rpctl.kernels.functions import missing_operation

    missing = missing_operation(
        formula(law.with_numbers(law.numbers()), robot, [1.0] * len(robot.joints))
    )
    return missing and f"the kinematic law {_name(law)} has the operation {missing}"


def _starts_itself(law: Any) -> bool:
    """Return whether a class of a user's own starts the law."""
    owner = next(kind for kind in type(law).__mro__ if "start" in vars(kind))
    return not owner.__module__.startswith("rpctl.")


def _name(law: Any) -> str:
    return str(getattr(law, "__name__", type(law).__name__))
