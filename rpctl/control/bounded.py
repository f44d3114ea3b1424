"""The dynamic predictive law within limits, and the same with integral action."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.bandwidth import by_velocity, usual_gains
from rpctl.control.bounded_statements import BoundedStatements
from rpctl.control.dynamic import ClosedFormDynamic, paper_efforts
from rpctl.control.fragment import LawFragment, LawFrame
from rpctl.control.law import LawSample, Rest
from rpctl.control.within_limits import BoundedLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.files.records import POSITIVE, Setting


@dataclass(frozen=True, kw_only=True)
class BoundedDynamic(ClosedFormDynamic):
    """The predictive law of [MS21, Eq. 21-26] within the limits of the URDF.

    As long as no limit binds, the law is the paper's. If limits bind, each quasi-velocity deviates
    because of its own limits only:

    1. The desired ν̇* of each joint of the arm is clipped to its own bounds, see
       :class:`~rpctl.control.joint_limits.JointLimits`.
    2. The base minimises the paper's cost over the box of its efforts and the bounds of its wheels,
       for an arm that follows,

           J = ½ pᵀ W′ p,    p = ε + h1 ε̇,    |τ| ≤ τ_max.

    3. The arm on that base obeys Gauss's principle of least constraint, ½ δν̇ᵀ M δν̇ → min over the
       box of its efforts. M δν̇ is the missing effort, so δν̇ is its multiplier: a joint deviates
       from ν̇* only if its own effort is at a limit, and by what that effort cannot provide.

    Both are one quadratic program, in which the wheels' rows do not contain the arm's δν̇ and the
    arm has a tiny weight: saturated wheels do not accelerate the arm, and a joint that its actuator
    cannot hold does not move the base. If wheels and arm are at their limits at the same time, the
    wheels' efforts are clipped.

    Efforts never leave their box; bounds of wheels that the efforts cannot keep are violated by the
    least possible amount. In W′, p is divided by the full speed, at which the first actuator
    reaches its velocity limit,

        W′ = √w′ (I − c d dᵀ)² √w′,    c = 1 − √along,

    where d is the direction of ν_d + h1 ν̇_d, also divided by the full speed: an error along the
    desired motion costs less than one across it. A robot whose wheels have reached a limit
    therefore slows down with v and ω in proportion, and keeps the curvature. The arm's weight is
    √w′ M √w′: if its joints have different weights, the others move in favour of the heavier one.

    Efforts are held for a period, so M and h are evaluated in its middle, see
    :func:`~rpctl.control.dynamic.midpoint`.
    """

    horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Horizon h₁",
            "Prediction time h1 of the base; default: what period and delay allow.",
        ),
    ] = field(default=None, kw_only=False)
    along: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "Weight along the motion",
            "Weight of the base's error along its motion, relative to the lateral error.",
        ),
    ] = 1e-2
    weights: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "",
            "w′ by name of the quasi-velocity; default: 1 for the base and 1e-6 for joints.",
        ),
    ] = field(default_factory=dict)
    joint_horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h₁",
            "Prediction time of the arm's joints; default: what period and delay allow.",
        ),
    ] = None
    midpoint: Annotated[
        bool,
        Setting(
            "",
            "Model of the period's middle",
            "Whether to use M and h of the middle of the period, or of the sample.",
        ),
    ] = True

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numeric settings on one robot, see :class:`BoundedLaw`.

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.

        Raises:
            UnknownNameError: A weight names no quasi-velocity of the robot.
        """
        return BoundedLaw(self, known, period).numbers()

    def free_efforts(
        self,
        known: ReducedDynamics,
        period: float,
        sample: LawSample,
        rest: Rest | None,
        *,
        disturbance: Array | float = 0.0,
    ) -> Array:
        """Return τ (n_act,), N·m or N, of a sample at which no limit binds, by Pinocchio.

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: Not used.
            disturbance: Acceleration (dof,), m/s² or rad/s², that acts besides the model's.
        """
        law = BoundedLaw(self, known, period)
        return np.asarray(paper_efforts(known, sample, law.times, law.held_for, disturbance))

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the kernel statements that compute efforts from the frame's command."""
        return BoundedStatements(frame, BoundedLaw(self, frame.reduced, frame.period)).fragment()


@dataclass(frozen=True)
class IntegralDynamic(ClosedFormDynamic):
    """The bounded law with integral action against disturbances and model errors.

    Without limits the desired acceleration is

        ν̇* = ν̇_d − ε/h1 − k (ε + ∫ε/h1),    ε = ν − ν_d,

    with poles at −1/h1 and −k. The state of the integral is d, the acceleration that the efforts do
    not explain: with the model's acceleration ν̇_m under the applied efforts,

        ḋ = k (ν̇ − ν̇_m − d),    ν̇_m = ν̇_d − ε/h1 − d,

    which is the same law with d = k (ε + ∫ε/h1): ν̇ = ν̇_d + ε̇, so ḋ = k (ε̇ + ε/h1). Since ν̇_m
    follows from the limited efforts, a limit that binds does not wind up the integral; and jumps of
    ν_d, which no disturbance caused, do not enter it.

    At the start of a run d and the model's acceleration under the efforts that hold the robot at
    rest add up to 0. If these efforts are not known, d starts at 0.
    """

    gain: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "1/s",
            "Gain k",
            "k of the base; default: what period and delay allow, 8.6 at 2 ms. With it TIAGo is "
            "4.1 mm rms off the eight in MuJoCo, where wheels scrub (2.4 mm with 15), and has "
            "28° of phase margin with 50 ms of delay (24° with 10, 11° with 15).",
        ),
    ] = None
    inner: Annotated[
        BoundedDynamic, Setting("", "Law within", "The law that finds the efforts.")
    ] = field(default_factory=BoundedDynamic)
    joint_gain: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "1/s",
            "Joints' gain k",
            "k of the arm's joints; default: what period and delay allow.",
        ),
    ] = None

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numeric settings on one robot by name: floats, or arrays (dof,).

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.

        Raises:
            RpctlError: The gain is too large for the control period.
        """
        return {**self.inner.numbers_on(known, period), "gain": self.gains(known, period)}

    def free_efforts(
        self, known: ReducedDynamics, period: float, sample: LawSample, rest: Rest | None
    ) -> Array:
        """Return τ (n_act,), N·m or N, of a first sample without binding limits, by Pinocchio.

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: State before the run.
        """
        d = np.zeros_like(sample.nu)
        if rest is not None:
            d = -known.forward(rest.q, d, rest.tau)
        return self.inner.free_efforts(known, period, sample, rest, disturbance=d)

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the kernel statements that compute efforts from the frame's command."""
        inner = BoundedLaw(self.inner, frame.reduced, frame.period)
        return BoundedStatements(frame, inner, integral=True).fragment()

    def gains(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return k of each quasi-velocity (dof,), 1/s.

        Args:
            dynamics: The robot's dynamics.
            period: Control period, s.

        Raises:
            RpctlError: A gain is too large for the control period.
        """
        usual = usual_gains(period).gain
        base, joints = self.gain or usual, self.joint_gain or usual
        fastest = max(base, joints)
        if fastest * period > 1.0:
            raise RpctlError(
                f"gain {fastest:g} 1/s is too large for a control period of {period:g} s; "
                f"give at most {1.0 / period:g}"
            )
        return by_velocity(dynamics, base, joints)
