"""The dynamic law within limits with integral action that does not wind up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic, BoundedLaw
from rpctl.control.dynamic import by_velocity, joint_gains, midpoint
from rpctl.control.law import Command, Efforts, ReportsNothing, Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.files.records import POSITIVE, Record, Setting


@dataclass(frozen=True)
class IntegralDynamic(Record):
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
        float,
        POSITIVE,
        Setting(
            "1/s",
            "Gain k",
            "k of the base. With the default TIAGo keeps within 2.2 mm of the eight in "
            "MuJoCo, where its wheels scrub (10: 3.2 mm; 20: 1.7 mm); of a delay of 50 ms it "
            "leaves 15° of phase (10: 28°; 20: 2°).",
        ),
    ] = 15.0
    inner: Annotated[
        BoundedDynamic, Setting("", "Law within", "The law that finds the efforts.")
    ] = field(default_factory=BoundedDynamic)
    joint_gain: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "1/s",
            "Joints' gain k",
            "k of the arm's joints; of each what its bandwidth allows if not given.",
        ),
    ] = None

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> IntegralLaw:
        """Return the controller of one run, its integral that of the robot at rest.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: State before the run; None starts the integral at zero.

        Raises:
            RpctlError: The gain is too large for the control period.
        """
        return IntegralLaw(self, dynamics, period, rest)


class IntegralLaw(ReportsNothing):
    """:class:`IntegralDynamic` on one robot at one control period, with the integral so far.

    Args:
        period: Control period, s.
        rest: State before the run; None starts the integral at zero.
    """

    def __init__(
        self,
        law: IntegralDynamic,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None,
    ) -> None:
        fastest = max(law.gain, law.joint_gain or 0.0)
        if fastest * period > 1.0:
            raise RpctlError(
                f"gain {fastest:g} 1/s is too large for a control period of {period:g} s; "
                f"give at most {1.0 / period:g}"
            )
        joints = (
            joint_gains(dynamics, period).gain
            if law.joint_gain is None
            else np.full(len(dynamics.robot.joints), law.joint_gain)
        )
        self.gain = by_velocity(dynamics, law.gain, joints)
        self.inner = BoundedLaw(law.inner, dynamics, period)
        still = np.zeros(dynamics.robot.dof)
        self._disturbance = still if rest is None else -dynamics.forward(rest.q, still, rest.tau)
        self._before: tuple[Array, Array] | None = None  # ν and, if d was right, ν̇ since then
        self._elapsed: float | None = period

    def sampled_after(self, elapsed: float | None) -> None:
        """Take note of the time since the last call; see :class:`rpctl.control.law.Timed`.

        Args:
            elapsed: s; None if other efforts were sent since then: the integral waits.
        """
        self._elapsed = elapsed

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,) and the limits that bind; the integral advances by the time since the
        last call, one period unless :meth:`sampled_after` told another.
        """
        if self._before is not None and self._elapsed is not None:
            started_at, nu_dot = self._before
            # A longer pause teaches no more than ν̇.
            gain = np.minimum(self.gain, 1.0 / self._elapsed)
            unexpected = nu - started_at - self._elapsed * nu_dot
            self._disturbance = self._disturbance + gain * unexpected
        efforts = self.inner(dynamics, q, nu, command, self._disturbance)
        nu_dot = self.inner.desired_acceleration(nu, command)
        if efforts.limits:
            middle = midpoint(dynamics, q, nu, command, self.inner.held_for)
            nu_dot = dynamics.forward(middle.q, middle.nu, efforts.tau) + self._disturbance
        self._before = nu, nu_dot
        return efforts
