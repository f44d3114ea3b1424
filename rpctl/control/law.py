"""What a dynamic law is, what it returns, and how a law that remembers starts a run."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar, cast

from rpctl.arrays import Array
from rpctl.control.command import Command
from rpctl.dynamics.reduced import ReducedDynamics


class Limit(NamedTuple):
    """A limit of the URDF."""

    joint: str
    kind: str  # "effort", "velocity", "lower" or "upper"


class Efforts(NamedTuple):
    """Actuator efforts, and the limits that kept them from being others."""

    tau: Array  # (n_act,) N·m or N
    limits: tuple[Limit, ...] = ()


def as_efforts(answer: Efforts | Array) -> Efforts:
    """Return what a law answered as a record."""
    return answer if isinstance(answer, Efforts) else Efforts(answer)


class DynamicLaw(Protocol):
    """Anything that turns a command into efforts; a plain function will do."""

    def __call__(
        self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command
    ) -> Efforts | Array:
        """Return τ (n_act,), alone or with the limits that bound it.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: What to follow.
        """


class Rest(NamedTuple):
    """How a robot stands before a run: what holds it there, measured or known."""

    q: Array  # (nq,)
    tau: Array  # (n_act,) N·m or N


Law = TypeVar("Law")
LawOfRun = TypeVar("LawOfRun", covariant=True)


class Startable(Protocol[LawOfRun]):
    """Settings of a law that remembers, or that has to know the control period."""

    def start(
        self, dynamics: ReducedDynamics, control_period: float, rest: Rest | None = None
    ) -> LawOfRun:
        """Return the law of one run, without a memory of others.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            control_period: Time between two calls, s.
            rest: How the robot stands before; None where that is not known.
        """


def started(
    law: Law | Startable[Law],
    dynamics: ReducedDynamics,
    control_period: float,
    rest: Rest | None = None,
) -> Law:
    """Return the law of one run: what ``law.start`` returns, or a law without ``start`` itself."""
    if hasattr(law, "start"):
        return cast("Startable[Law]", law).start(dynamics, control_period, rest)
    return law
