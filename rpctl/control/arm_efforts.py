"""Efforts of joints beside a base, or other joints, that controllers of their own move."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.both_laws import Started, effort_law, laws_kernel
from rpctl.control.law import Command, Efforts
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput


class ArmEfforts:
    """A dynamic law on the joints that are sent efforts, where all others follow speeds.

    The law has the whole robot. What follows speeds has no error for it, and is wanted to have the
    acceleration ν̇_b that its lag makes of the commands. So of the law's efforts those of the joints
    are what these take on a base that moves so,

        B_a τ_a = M_aa ν̇_a* + M_ab ν̇_b + h_a − ℓ_a.

    The law's integral learns what these do not explain of the joints alone.

    Args:
        law: The dynamic law.
        output: What is sent, with what its groups say on the robot.
        started: What the run starts with.
        compiled: Whether a law in closed form runs as machine code.

    Attributes:
        law: The law of this run.
        sent: Which efforts (n_act,) the robot is sent.
    """

    def __init__(self, law: Any, output: VelocityOutput, started: Started, compiled: bool) -> None:
        self._dynamics, robot = started[0], started[0].robot
        self._joints = output.sent_efforts(robot)
        self._own: Any = np.isin(robot.quasi_velocities, self._joints)
        self.sent = np.isin(robot.actuators, self._joints)
        self._kernel, _ = laws_kernel((None, law), started, compiled)
        self.law = effort_law(law, started, self._kernel)
        self._before: MeasuredSample | None = None

    def __call__(self, sample: MeasuredSample, command: Command, nu_dot: Array) -> Efforts | None:
        """Return the efforts (n_act,), 0 of what is sent none, and the joints' limits that bind.

        None where neither the law has an answer nor its substitute.

        Args:
            sample: What was measured.
            command: Of the kinematic law.
            nu_dot: Acceleration (dof,) to come of what follows speeds.
        """
        before, self._before, own = self._before, sample, self._own
        if before is not None and self._kernel is not None:
            self._kernel.moved((sample.nu - before.nu) / (sample.t - before.t), ~own)
        nu_d, nu_d_dot = np.where(own, command, (sample.nu, nu_dot))
        found = self.law(sample.t, self._dynamics, sample.q, sample.nu, Command(nu_d, nu_d_dot))
        if found is None:
            return None
        limits = tuple(limit for limit in found.limits if limit.joint in self._joints)
        return Efforts(np.where(self.sent, found.tau, 0.0), limits)
