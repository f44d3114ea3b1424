"""The dynamic law within limits with integral action that does not wind up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.bandwidth import by_velocity, usual_gains
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.bounded_statements import BoundedStatements
from rpctl.control.closed_form import ClosedFormDynamic
from rpctl.control.fragment import LawFragment, LawFrame
from rpctl.control.law import LawSample, Rest
from rpctl.control.within_limits import BoundedLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.files.records import POSITIVE, Setting


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
            "k of the base; what period and lateness allow if not given: 8.6 at 2 ms. In MuJoCo, "
            "where its wheels scrub, TIAGo is then 4.1 mm rms off the eight (15: 2.4 mm); of a "
            "delay of 50 ms that leaves 28° of phase (10: 24°; 15: 11°).",
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
            "k of the arm's joints; what period and lateness allow if not given.",
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
        return self.inner.free_efforts(known, period, sample, rest, d)

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
