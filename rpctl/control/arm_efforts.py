"""Efforts of joints beside a base, or other joints, that controllers of their own move."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.both_laws import effort_law, laws_kernel
from rpctl.control.law import Command, Efforts, Rest
from rpctl.control.sampling import MeasuredSample
from rpctl.dynamics.reduced import ReducedDynamics


class ArmEfforts:
    """A dynamic law on the joints that are sent efforts, where all others follow speeds.

    The law has the whole robot. What follows speeds has no error for it, and is wanted to have the
    acceleration ν̇_b that its lag makes of the commands. So of the law's efforts those of the joints
    are what these take on a base that moves so,

        B_a τ_a = M_aa ν̇_a* + M_ab ν̇_b + h_a − ℓ_a.

    The law's integral learns what these do not explain of the joints alone.

    Args:
        law: The dynamic law.
        names: Of the joints.
        dynamics: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.
        rest: State before the first sample, if it is known.
        compiled: Whether a law in closed form runs as machine code.

    Attributes:
        joints: The names of the joints.
        sent: Which efforts (n_act,) the robot is sent.
        whole: All efforts (n_act,) of the motion that is expected now; the others come about.
        sampled_after: Tells the law the time between samples, see :class:`rpctl.control.law.Timed`.
    """

    def __init__(
        self,
        law: Any,
        names: Collection[str],
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None,
        compiled: bool,
    ) -> None:
        robot, started = dynamics.robot, (dynamics, period, rest)
        self._dynamics, self.joints = dynamics, names
        self._own = np.array([name in names for name in robot.quasi_velocities])
        self.sent = np.array([name in names for name in robot.actuators])
        self._kernel, _ = laws_kernel((None, law), started, compiled)
        self._law = effort_law(law, started, () if self._kernel is None else (self._kernel,))
        self.sampled_after = self._law.sampled_after
        self.whole = np.zeros(len(robot.actuators)) if rest is None else rest.tau
        self._before: MeasuredSample | None = None

    @property
    def reason(self) -> str:
        """Why the law was replaced at the last sample; "" where it was not."""
        return self._law.reason

    def __call__(self, sample: MeasuredSample, command: Command, nu_dot: Array) -> Efforts | None:
        """Return the efforts (n_act,), 0 of what is sent none, and the joints' limits that bind.

        None where neither the law has an answer nor its substitute.

        Args:
            sample: What was measured.
            command: Of the kinematic law.
            nu_dot: Acceleration (dof,) to come of what follows speeds.
        """
        before, self._before, own = self._before, sample, self._own
        if before is not None and self._kernel is not None and self._kernel.learns:
            happened = (sample.nu - before.nu) / (sample.t - before.t)
            self._kernel.moved(happened, ~own)
        pairs = zip(command, (sample.nu, nu_dot), strict=True)
        wanted = Command(*(np.where(own, *pair) for pair in pairs))
        found = self._law(sample.t, self._dynamics, sample.q, sample.nu, wanted)
        if found is None:
            return None
        self.whole = found.tau
        limits = tuple(limit for limit in found.limits if limit.joint in self.joints)
        return Efforts(np.where(self.sent, found.tau, 0.0), limits)
