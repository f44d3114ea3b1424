"""Plans of the horizon law: what they are, and how the samples between two of them follow one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.robot.model import Robot

PLAN_BLEND_TIME = 0.08  # s: time constant with which plans follow the measured ν
SOFTENED_SLACK = 1e-3  # of a limit, or m: slack from which a bound counts as softened


class Feedback(NamedTuple):
    """Where a plan leads, and how its first ν̇ would differ had it begun beside its start.

    The state x is pose, joints and ν (3 + n_joints + dof,): x = c₀ + c₁ s + c₂ s² at s (s) after
    the start of a step.
    """

    motion: Array  # (3, N, 3 + n_joints + dof): c₀, c₁ and c₂ of each step
    gain: Array  # (dof, 3 + n_joints + dof)
    largest: Array  # (dof,) |ν̇|
    beside: Array  # (dof,) ν_d less that of the plan before, as foreseen at the start


class HorizonPlan(NamedTuple):
    """Accelerations, constant in each step, from time ``t`` and ``nu`` on."""

    t: float  # s
    dt: float  # length of a step, s
    nu: Array  # (dof,)
    nu_dot: Array  # (N, dof)
    feedback: Feedback | None = None

    @property
    def ends(self) -> float:
        """When nothing is planned any more, s."""
        return self.t + len(self.nu_dot) * self.dt

    def step(self, t: float) -> tuple[int, float]:
        """Return the step at a time (s), and for how long it has lasted; the first before that."""
        step = min(max(int((t - self.t) / self.dt), 0), len(self.nu_dot) - 1)
        return step, t - self.t - step * self.dt

    def command(self, t: float) -> Command:
        """Return ν and ν̇ of the plan at a time (s); before it begins, those of its first step."""
        step, since = self.step(t)
        before = self.dt * self.nu_dot[:step].sum(axis=0)
        nu_dot = self.nu_dot[step]
        return Command(self.nu + before + since * nu_dot, nu_dot)

    def start_of_next(self, t: float, nu: Array) -> Array:
        """Return the initial ν (dof,) of a plan from ``t`` on: this one's, drawn to the measured.

        Planning from the measured ν alone would accept every deviation, and only the far end of the
        horizon would correct it: light joints drift off once efforts arrive 20 ms late.
        """
        planned = self.command(t).nu_d
        return np.asarray(planned + min((t - self.t) / PLAN_BLEND_TIME, 1.0) * (nu - planned))

    def shifted(self, t: float) -> Array:
        """Return the accelerations (N, dof), shifted to steps from ``t`` on; then zeros."""
        shifted = np.zeros_like(self.nu_dot)
        whole, part = divmod(max(t - self.t, 0.0) / self.dt, 1.0)
        ahead = self.nu_dot[int(whole) :]
        shifted[: len(ahead)] += (1.0 - part) * ahead
        shifted[: len(ahead[1:])] += part * ahead[1:]
        return shifted


class Planned(NamedTuple):
    """What became of a solve."""

    plan: HorizonPlan | None  # None if a QP was not solved
    slack: float = 0.0  # the largest, of a limit or m
    largest_lag: float = 0.0  # of the scaled reference time so far, s
    lag: float = 0.0  # of it at the plan's start, s
    fault: str = ""  # what stopped it

    @property
    def softened(self) -> bool:
        """Whether a bound gave way."""
        return self.slack > SOFTENED_SLACK


class Follower:
    """Keeps a robot on its plan: ν̇ = ν̇_plan + K δ, with ν_d its integral.

    δ is what pose, joints and ν_d are off the plan by, and K the derivative of the QP's solution by
    the state that it starts from, with the bounds held that hold it: what a solve at each sample
    would make of δ, to first order.

    Attributes:
        beside: By how much ν_d is off the plan's (dof,).
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        steered = [swivel.joint for swivel in robot.drive.steered]
        self._joints = [*steered, *robot.joint_names]
        self.beside = np.zeros(robot.dof)
        self._t = 0.0  # s, of the last sample

    def begin(self, t: float, beside: Array) -> None:
        """Follow another plan from a time (s) on.

        Args:
            beside: By how much it is foreseen that ν_d is off the plan before (dof,).
        """
        self.beside, self._t = self.beside - beside, t

    def __call__(self, plan: HorizonPlan, t: float, q: Array | None) -> Command:
        """Return the command at a time (s).

        Args:
            q: Configuration (nq,); None where it tells nothing of the plan.
        """
        at, elapsed, self._t = plan.feedback, min(t - self._t, plan.dt), t
        if at is None or q is None:
            nu, nu_dot = plan.command(t)
            return Command(nu + self.beside, nu_dot)
        k, since = plan.step(t)
        first, rate, bend = at.motion[:, k]
        planned, own, robot = first + since * (rate + since * bend), -len(plan.nu), self._robot
        joints = [robot.joint_position(q, name) for name in self._joints]
        off = np.array([*robot.base_pose(q), *joints]) - planned[:own]
        off[2:] -= math.tau * np.rint(off[2:] / math.tau)  # a joint that moves in m is never so far
        nu_dot = rate[own:] + at.gain @ np.concatenate([off, self.beside])
        nu_dot = np.maximum(np.minimum(nu_dot, at.largest), -at.largest)
        command = Command(planned[own:] + self.beside, nu_dot)
        self.beside = self.beside + elapsed * (nu_dot - rate[own:])
        return command
