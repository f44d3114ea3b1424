"""Laws in closed form: what makes them kernels, which are none, and the paper's dynamic law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.approach import Approach
from rpctl.control.bandwidth import USUAL_PERIOD, by_velocity
from rpctl.control.error import Leash
from rpctl.control.fragment import LawFragment, LawFrame, effort_labels, structure
from rpctl.control.law import Command, Efforts, LawSample, ReportsNothing, Rest
from rpctl.control.law_kernel import LimitedLaw, RunningLaws, running_laws
from rpctl.control.twist_law import BaseLaw, formula
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.robot.model import Robot

Dynamics = ReducedDynamics | SymbolicDynamics


class ClosedFormDynamic(Record, ABC):
    """Base class of dynamic laws whose efforts are statements of a kernel."""

    gives_efforts: ClassVar[bool] = True

    def start(
        self,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None = None,
        *,
        running: RunningLaws | None = None,
    ) -> LimitedLaw | PaperDynamicController:
        """Return the controller of one run, for the commands of any kinematic law.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
            rest: State before the run; None starts an integral at zero.
            running: The kernel of both laws, if it exists already.

        Raises:
            RpctlError: A setting does not fit the robot or the period.
        """
        if dynamics.robot.drive.leans:
            raise UnfitLawError(
                f"{dynamics.robot.name} leans, and {_name(self)} does not balance it; take the "
                "dynamic law balance"
            )
        return LimitedLaw(running or running_laws(None, self, dynamics, period, rest))

    def structure(self, robot: Robot) -> object:
        """Return a value that identifies the law's machine code on a robot, numbers left out.

        For a user's class the class itself is that value, which is valid in this process only.
        """
        known = type(self).__module__.startswith("rpctl.")
        return structure(self), None if known else id(type(self))

    @abstractmethod
    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numeric settings on one robot by name: floats, or arrays (dof,).

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
        """

    @abstractmethod
    def free_efforts(
        self, known: ReducedDynamics, period: float, sample: LawSample, rest: Rest | None
    ) -> Array:
        """Return τ (n_act,), N·m or N, of a first sample without binding limits, by Pinocchio.

        A kernel is compared with it when it is built.

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: State before the run.
        """

    @abstractmethod
    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the kernel statements that compute efforts from the frame's command."""


def unsupported(kinematic: Any, dynamic: Any) -> str | None:
    """Return why laws are no statements, a clause; None if they are.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
    """
    if not isinstance(kinematic, BaseLaw) or _starts_itself(kinematic):
        return f"the kinematic law {_name(kinematic)} cannot be compiled"
    if type(kinematic.leash) not in (type(None), Leash):
        return f"the leash {_name(kinematic.leash)} cannot be compiled"
    if type(kinematic.approach) not in (type(None), Approach):
        return f"the approach {_name(kinematic.approach)} cannot be compiled"
    for law in (dynamic, getattr(dynamic, "inner", dynamic)):
        if not isinstance(law, ClosedFormDynamic) or _starts_itself(law):
            return f"the dynamic law {_name(law)} cannot be compiled"
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


@dataclass(frozen=True)
class PaperDynamic(ClosedFormDynamic):
    """The predictive law of [MS21, Eq. 21-26].

    The velocity errors ε = ν − ν_d, predicted to first order over the horizon h1, minimise
    J = ½ Σ w′ᵢ (εᵢ + h1 ε̇ᵢ)² over τ (Eq. 25). Without limits the minimum is zero and the weights
    cancel:

        ν̇* = ν̇_d − (ν − ν_d)/h1,    B τ = M ν̇* + h − ℓ(ν_d)

    so that ε̇ = −ε/h1. The paper's robot has no losses, ℓ = 0. The losses of joints are compensated
    at the desired speed: the remaining ℓ(ν) − ℓ(ν_d) reduces the error, and the compensation of
    friction does not change sign with the noise of the measured speed.
    """

    horizon_dyn: Annotated[float, POSITIVE, Setting("s", "Horizon h₁", "Prediction time h1.")] = (
        0.15
    )
    joint_horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h₁",
            "Prediction time of the arm's joints; default: h1, as published.",
        ),
    ] = None
    midpoint: Annotated[
        bool,
        Setting(
            "",
            "Model of the period's middle",
            "Whether to use M and h of the middle of the period, or of the sample, as published.",
        ),
    ] = False

    def start(
        self,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None = None,
        *,
        running: object = None,
    ) -> PaperDynamicController:
        """Return the controller of one run, which computes with Pinocchio.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
            rest: Not used.
            running: Not used.
        """
        times = self.numbers_on(dynamics, period)["time"]
        return PaperDynamicController(times, period if self.midpoint else 0.0)

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the prediction times h1 (dof,) on one robot, s.

        Args:
            known: The dynamics of the controller's model.
            period: Not used.
        """
        own = self.joint_horizon_dyn or self.horizon_dyn
        return {"time": by_velocity(known, self.horizon_dyn, own)}

    def free_efforts(
        self, known: ReducedDynamics, period: float, sample: LawSample, rest: Rest | None
    ) -> Array:
        """Return τ (n_act,), N·m or N, of a sample, by Pinocchio.

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: Not used.
        """
        q, nu, *command = sample
        return self.start(known, period)(known, q, nu, Command(*command)).tau

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the kernel statements that compute efforts from the frame's command."""
        held_for = frame.period if self.midpoint else 0.0
        tau = paper_efforts(frame.known, frame.sample, frame.s["time"], held_for)
        labels = effort_labels(frame.known.robot)
        return frame.answered("law_efforts", tau, labels, math.SX.zeros(len(labels), 1))

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        """Return τ (n_act,) of a controller with the usual control period, 2 ms.

        Args:
            dynamics: The dynamics of the controller's model.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: Command to follow.
        """
        return self.start(dynamics, USUAL_PERIOD)(dynamics, q, nu, command).tau


class PaperDynamicController(ReportsNothing):
    """:class:`PaperDynamic` on one robot, with Pinocchio's dynamics.

    Args:
        times: Prediction times h1 (dof,), s.
        period: For how long efforts are held, as far as the law takes account of it, s.
    """

    def __init__(self, times: Array, period: float) -> None:
        self.times, self.held_for = times, period

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,); no limit binds it."""
        sample = LawSample(q, nu, *command)
        return Efforts(paper_efforts(dynamics, sample, self.times, self.held_for))


def desired_acceleration(sample: LawSample, times: Any) -> Any:
    """Return ν̇* (dof,).

    Args:
        times: Prediction times h1 (dof,), s.
    """
    return sample.nu_d_dot - (sample.nu - sample.nu_d) / times


def paper_efforts(
    dynamics: Dynamics, sample: LawSample, times: Any, period: float, disturbance: Any = 0.0
) -> Any:
    """Return τ (n_act,) of the law without limits, [MS21, Eq. 26].

    Args:
        dynamics: Pinocchio's for arrays, or those over scalars for columns of them.
        times: Prediction times h1 (dof,), s.
        period: For how long efforts are held, as far as the law takes account of it, s.
        disturbance: Acceleration ν̇ (dof,) in addition to that of ``dynamics``.
    """
    nu_dot, at = desired_acceleration(sample, times), midpoint(dynamics, sample, period)
    force = dynamics.inverse(at.q, at.nu, nu_dot - disturbance, lossy_nu=at.nu_d)
    return dynamics.efforts(at.q, force)


def midpoint(dynamics: Dynamics, sample: LawSample, period: float) -> LawSample:
    """Return the state in the middle of a period, of a robot that accelerates as commanded.

    Efforts are held for a period T. With M and h of this state the mean acceleration is the one
    asked for but for terms of T²; with those of the sample h is late by ½T on the average, and
    M⁻¹ ½T ḣ remains. Along a direction of little inertia that is much: to hold a base's motion off
    wrist axes that are in line takes efforts a hundred times those that turn them.

    The acceleration is ν̇_d, without the feedback: where the robot follows, this is none, and where
    limits bind, it is what the robot does not do. Losses are compensated at the ν_d of then.

    Args:
        dynamics: Pinocchio's for arrays, or those over scalars for columns of them.
        period: T, s; 0 returns the sample.
    """
    if period == 0.0:
        return sample
    q, nu, nu_d, nu_d_dot = sample
    step = 0.5 * period
    ahead = dynamics.integrate(q, step * (dynamics.basis(q) @ nu))
    return LawSample(ahead, nu + step * nu_d_dot, nu_d + step * nu_d_dot, nu_d_dot)
