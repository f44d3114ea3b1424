"""The horizon law on robots that lean: it follows the last plan until the next is there.

τ = τ_plan − K (x − x_plan), with the plan's own K of each step. So a plan that comes late is
followed from where it is by then, and what the robot is off it by is fed back.
"""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.leaning_plan import LeaningHorizon, LeaningPlan
from rpctl.control.horizon.planner import Asked
from rpctl.control.horizon.process import PlanningProcess
from rpctl.control.horizon.simulated import SimulatedPlanning
from rpctl.control.law import Command, EffortCommand, Efforts, KinematicController, Limit
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.control.steady_motion import ERRORS, Posture
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference

READ_BACK = 0.1  # s of the past that the first plan reads of its reference


class LeaningHorizonLaw:
    """:class:`LeaningHorizon` on one robot in one run: its plan, and its counts.

    Args:
        law: Its settings.
        dynamics: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.
        fallback: What answers without a plan.
        beside: What plans.
        asynchronous: Whether samples do not wait for plans.
    """

    def __init__(
        self,
        law: LeaningHorizon,
        dynamics: ReducedDynamics,
        period: float,
        fallback: KinematicController,
        beside: PlanningProcess | SimulatedPlanning,
        asynchronous: bool,
    ) -> None:
        self._law, self._robot, self._posture = law, dynamics.robot, Posture(dynamics)
        self._fallback, self._beside, self._asynchronous = fallback, beside, asynchronous
        self._idle = np.zeros((round(law.lateness / period), len(self._robot.actuators)))
        self._sent = self._idle  # efforts that do not act yet, less the steady motion's
        self._asked: Reference | None = None  # for which a plan is on its way
        self._made_for: Reference | None = None
        self._asked_at = -math.inf  # s
        self._plan: LeaningPlan | None = None
        self._fault = ""
        self.solves = self.fallbacks = self.unplanned = 0
        self.largest_delay = 0.0

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the efforts, from a new plan if there is one."""
        self._collect(t)
        other = reference is not self._made_for
        if self._asked is None and (other or t - self._asked_at > self._law.dt - TIME_ROUNDING):
            back = min(max(t, 0.0), READ_BACK)
            if self._beside.can_begin(reference, t, back, 0.0):
                self._asked, self._asked_at = reference, t
                self._beside.begin(reference, Asked(t, q, nu, 0.0, self._sent))
                self._collect(t)
        plan, acts, limits = self._plan, t + self._law.lateness, self._robot.effort_limits
        if plan is None or reference is not self._made_for or acts >= plan.ends:
            self.unplanned, self._sent = self.unplanned + 1, self._idle
            return self._fallback(dynamics, reference, t, q, nu)
        asked = Asked(t, q, nu, 0.0, self._sent)
        x = plan.deviation(self._law, self._posture, reference(t), asked)
        k, since = divmod((acts - plan.t) / plan.dt, 1.0)
        k, first, row = int(k), plan.nearest(plan.t) + int(k), plan.nearest(acts)
        planned, u, gains, _ = plan.motion
        change, bend = planned[k + 1] - planned[k], plan.tau[first + 1] - plan.tau[first]
        aim, held = planned[k] + since * change, plan.tau[first] + since * bend
        wished = held + u[k] - gains[k] @ (x - aim)
        tau = np.clip(wished, -limits, limits)
        self._sent = np.vstack([self._sent, tau - held])[1:]
        change = change[ERRORS:] + plan.wanted[row + 1] - plan.wanted[row]
        nu_d = plan.at(acts) + aim[ERRORS:]  # finite as τ is, and looked at
        binding = np.array(self._robot.actuators)[np.abs(wished) >= limits].tolist()
        efforts = Efforts(tau, tuple(Limit(name, "effort") for name in binding))
        return EffortCommand(nu_d[-len(nu) :], change[-len(nu) :] / plan.dt, efforts)

    def report(self) -> dict[str, float]:
        """Return how many solves there were, and of how many failed.

        ``unplanned`` samples had no plan, and the fallback answered. Where plans are made beside
        the samples, ``largest_delay`` (s) is the longest that one took, and ``restarts`` how often
        their process ended or did not answer.
        """
        names = ["solves", "fallbacks"] + ["unplanned", "largest_delay"] * self._asynchronous
        report: dict[str, float] = {name: getattr(self, name) for name in names}
        if isinstance(self._beside, PlanningProcess):
            report["restarts"] = self._beside.restarts
        return report

    def notes(self) -> tuple[str, ...]:
        """Return a sentence on plans that failed."""
        return (f"a plan of the horizon law failed: {self._fault}",) if self._fault else ()

    def _collect(self, t: float) -> None:
        """Take over the plan that was asked for once it is there."""
        found = self._beside.result(t)
        if self._asked is None or (found is None and self._beside.busy):
            return
        if found is not None:  # else who was asked is gone
            self.solves, self.largest_delay = (
                self.solves + 1, max(self.largest_delay, t - self._asked_at)
            )  # fmt: skip
            self.fallbacks += found.plan is None or not found.plan.motion.solved
            self._fault = self._fault or found.fault
            if found.plan is not None:
                self._plan, self._made_for = found.plan, self._asked
        self._asked = None
