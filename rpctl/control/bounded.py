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

    While no limit binds, the law is the paper's. Where one does, each quasi-velocity gives way to
    its own limits and to no other's:

    1. The wish ν̇* of each joint of the arm is brought within its own bounds, see
       :class:`~rpctl.control.joint_limits.JointLimits`.
    2. The base minimises the paper's own cost over the box of its efforts and the bounds of its
       wheels, with an arm that follows,

           J = ½ pᵀ W′ p,    p = ε + h1 ε̇,    |τ| ≤ τ_max.

    3. The arm on that base obeys Gauss's principle of least constraint, ½ δν̇ᵀ M δν̇ → min over the
       box of its efforts. M δν̇ is what the efforts miss, so δν̇ is their multiplier: a joint is off
       its wish only where its own effort is at a limit, and by what that effort cannot give.

    Both are one quadratic program, in which the wheels' rows do not see the arm's δν̇ and the arm
    weighs next to nothing: neither do saturated wheels throw the arm, nor does a joint that its
    actuator cannot hold drive the base off under it. Where wheels and arm are at their limits at
    once, the wheels' efforts are cut off at theirs.

    Efforts never leave their box; bounds of wheels that the efforts cannot keep are broken by the
    least possible. In W′, p is divided by full speed, the speed at which the first actuator reaches
    its velocity limit,

        W′ = √w′ (I − c d dᵀ)² √w′,    c = 1 − √along,

    with d the direction of ν_d + h1 ν̇_d, divided by full speed as well: an error along the desired
    motion is cheaper than one across it. So a robot whose wheels have reached a limit slows down, v
    and ω in proportion, and keeps the curvature. The arm has √w′ M √w′: with weights that differ
    among its joints, the others move for the one that weighs more.

    Efforts are held for a period, so M and h are those of its middle, see
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
        """Return the numbers among the settings on one robot, see :class:`BoundedLaw`.

        Args:
            known: Its dynamics, as far as the controller knows them.
            period: Control period, s.

        Raises:
            UnknownNameError: A weight is of no quasi-velocity of the robot.
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
        """Return τ (n_act,) of a sample that no limit binds, with Pinocchio's dynamics.

        Args:
            known: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: Not used.
            disturbance: Acceleration ν̇ (dof,) in addition to that of ``known``.
        """
        law = BoundedLaw(self, known, period)
        return np.asarray(paper_efforts(known, sample, law.times, law.held_for, disturbance))

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the statements that make efforts of the frame's command."""
        return BoundedStatements(frame, BoundedLaw(self, frame.reduced, frame.period)).fragment()


@dataclass(frozen=True)
class IntegralDynamic(ClosedFormDynamic):
    """The law within limits, plus integral action against what the model does not know.

    Without limits the desired acceleration is

        ν̇* = ν̇_d − ε/h1 − k (ε + ∫ε/h1),    ε = ν − ν_d,

    whose poles are −1/h1 and −k. The integral is kept as d, the acceleration that the efforts do
    not explain: with ν̇_m the model's acceleration under the efforts that were applied,

        ḋ = k (ν̇ − ν̇_m − d),    ν̇_m = ν̇_d − ε/h1 − d,

    which is the same law with d = k (ε + ∫ε/h1): ν̇ = ν̇_d + ε̇, so ḋ = k (ε̇ + ε/h1). As efforts at
    their limits enter ν̇_m as they are, a limit that binds does not wind the integral up; and jumps
    of ν_d, which no disturbance caused, do not enter it.

    A run starts without a bump: d is what the model does not know of the robot at rest, ν̇ = 0, from
    the efforts that hold it there. Where these are not known, d starts at 0 and has to be learnt.
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
        """Return the numbers among the settings on one robot, by name.

        Args:
            known: Its dynamics, as far as the controller knows them.
            period: Control period, s.

        Raises:
            RpctlError: The gain is too large for the control period.
        """
        return {**self.inner.numbers_on(known, period), "gain": self.gains(known, period)}

    def free_efforts(
        self, known: ReducedDynamics, period: float, sample: LawSample, rest: Rest | None
    ) -> Array:
        """Return τ (n_act,) of a first sample that no limit binds, with Pinocchio's dynamics.

        Args:
            known: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: State before the run.
        """
        d = np.zeros_like(sample.nu)
        if rest is not None:
            d = -known.forward(rest.q, d, rest.tau)
        return self.inner.free_efforts(known, period, sample, rest, disturbance=d)

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the statements that make efforts of the frame's command."""
        inner = BoundedLaw(self.inner, frame.reduced, frame.period)
        return BoundedStatements(frame, inner, integral=True).fragment()

    def gains(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return k of each quasi-velocity (dof,), 1/s.

        Args:
            dynamics: The robot's dynamics.
            period: Control period, s.

        Raises:
            RpctlError: One is too large for the control period.
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
