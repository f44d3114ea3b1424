"""The protocol of the laws: a law is settings; its ``start`` makes the controller of one run.

A kinematic controller turns the reference and the robot's state into a :class:`Command`, a dynamic
controller turns that into :class:`Efforts`.
"""

from __future__ import annotations

from functools import update_wrapper
from typing import Any, NamedTuple, Protocol, TypeVar, overload, runtime_checkable

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference, ReferenceState


class Goal(NamedTuple):
    """What a robot that leans is wished to do: how it leans for that is the dynamic law's."""

    reference: Reference  # what is tracked, whose future counts
    t: float  # now, s
    state: ReferenceState  # of the reference now
    error: Array  # (3,) of P, in its frame, as far as it is to be mended at once; m, rad


class Command(NamedTuple):
    """The output of a kinematic law.

    Attributes:
        nu_d: Desired quasi-velocities ν_d (dof,), m/s or rad/s.
        nu_d_dot: Their derivative ν̇_d along the actual motion (dof,), m/s² or rad/s².
    """

    nu_d: Array  # (dof,)
    nu_d_dot: Array  # (dof,)


class LeaningCommand(Command):
    """A command to a robot that leans, with its goal."""

    goal: Goal

    def __new__(cls, nu_d: Array, nu_d_dot: Array, goal: Goal) -> LeaningCommand:
        """Make a command that has a goal besides."""
        made = super().__new__(cls, nu_d, nu_d_dot)
        made.goal = goal
        return made


class Limit(NamedTuple):
    """A limit of the URDF that binds.

    Attributes:
        joint: Name of the joint.
        kind: ``"effort"``, ``"velocity"``, ``"lower"`` or ``"upper"``.
    """

    joint: str
    kind: str


class Efforts(NamedTuple):
    """The output of a dynamic law.

    Attributes:
        tau: Actuator efforts τ (n_act,), N·m or N, in the order of ``robot.actuators``.
        limits: The limits that bind the efforts.
    """

    tau: Array  # (n_act,) N·m or N
    limits: tuple[Limit, ...] = ()


class Speeds(NamedTuple):
    """Quasi-velocities to send to a velocity interface, and the limits that bind them."""

    nu: Array  # (dof,)
    limits: tuple[Limit, ...] = ()


class LawSample(NamedTuple):
    """A sample that a dynamic law answers: arrays, or columns of ``casadi.SX``."""

    q: Any  # (nq,)
    nu: Any  # (dof,)
    nu_d: Any  # (dof,) wanted
    nu_d_dot: Any  # (dof,) their derivatives


class Rest(NamedTuple):
    """State of a robot before a run, and the efforts that hold it there.

    Attributes:
        q: Configuration (nq,).
        tau: Actuator efforts (n_act,), N·m or N.
        nu: Quasi-velocities (dof,) of a bicycle, which cannot stand; None: zero.
    """

    q: Array
    tau: Array
    nu: Array | None = None


class EffortCommand(Command):
    """A command of a law that finds its efforts itself: no dynamic law is asked for any."""

    efforts: Efforts

    def __new__(cls, nu_d: Array, nu_d_dot: Array, efforts: Efforts) -> EffortCommand:
        """Make a command that has its efforts besides."""
        made = super().__new__(cls, nu_d, nu_d_dot)
        made.efforts = efforts
        return made


class KinematicFunction(Protocol):
    """A function from the robot's state and its reference to a command."""

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array, /
    ) -> Command:
        """Return the command."""


class DynamicFunction(Protocol):
    """A function from the robot's state and a command to actuator efforts."""

    def __call__(
        self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command, /
    ) -> Efforts | Array:
        """Return τ (n_act,), alone or with the limits that bound it."""


@runtime_checkable
class Reporting(Protocol):
    """A controller that can say what happened to it during a run."""

    def report(self) -> dict[str, float]:
        """Return counts and figures of the run so far by name; empty if it keeps none."""


@runtime_checkable
class Timed(Protocol):
    """A controller to which it matters when samples come."""

    def sampled_after(self, elapsed: float | None) -> None:
        """Take note of the time since the last call; called before each call but the first.

        Args:
            elapsed: s; None if other efforts than the controller's own were sent since then.
        """


class KinematicController(KinematicFunction, Reporting, Protocol):
    """A kinematic law on one robot in one run."""


class DynamicController(DynamicFunction, Reporting, Protocol):
    """A dynamic law on one robot in one run."""


class TrackingController(KinematicController, Protocol):
    """A kinematic law in closed form on one robot in one run."""

    def row(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Array:
        """Return the row of what is tracked at a time (s), of its table."""


Controller_co = TypeVar("Controller_co", covariant=True)


@runtime_checkable
class Law(Protocol[Controller_co]):
    """Settings of a law."""

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None, /
    ) -> Controller_co:
        """Return the controller of one run, which remembers nothing of other runs.

        Args:
            period: Control period, s.
            rest: State before the run; None if it is not known.
        """


KinematicLaw = Law[KinematicController]
DynamicLaw = Law[DynamicController]

Stateless = TypeVar("Stateless", bound="StatelessLaw")


class ReportsNothing:
    """A controller that counts nothing."""

    def report(self) -> dict[str, float]:
        """Return an empty report."""
        return {}


class StatelessLaw(ReportsNothing):
    """Base class of laws without memory: such a law is its own controller and reports nothing.

    A kinematic law defines ``__call__(dynamics, reference, t, q, nu)`` and returns a
    :class:`Command`; a dynamic law defines ``__call__(dynamics, q, nu, command)`` and returns
    :class:`Efforts` or τ (n_act,), N·m or N.
    """

    def start(
        self: Stateless, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> Stateless:
        """Return the law itself; it uses no argument.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
            rest: State before the run.
        """
        return self


class FunctionLaw(StatelessLaw):
    """A plain function, or a controller that was started by hand, as a law."""

    def __init__(self, function: KinematicFunction | DynamicFunction) -> None:
        self._function: Any = function
        update_wrapper(self, function, updated=())  # its name is what a log calls the law

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Return what the function returns."""
        return self._function(*arguments, **named)

    def report(self) -> dict[str, float]:
        """Return the report of a controller; empty for a plain function."""
        return self._function.report() if isinstance(self._function, Reporting) else {}


@overload
def as_law(law: KinematicLaw | KinematicFunction) -> KinematicLaw: ...
@overload
def as_law(law: DynamicLaw | DynamicFunction) -> DynamicLaw: ...
def as_law(law: Any) -> Any:
    """Return a law, or a plain function as one."""
    return law if isinstance(law, Law) else FunctionLaw(law)


def as_controller(controller: Any) -> Any:
    """Return a controller, or a plain function that a law started as one."""
    return controller if isinstance(controller, Reporting) else FunctionLaw(controller)


def as_efforts(efforts: Efforts | Array) -> Efforts:
    """Return the efforts of a dynamic controller, with no binding limits if it names none."""
    return efforts if isinstance(efforts, Efforts) else Efforts(efforts)
