"""The horizon law: predictive control of the whole robot over N steps, within its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Annotated

from rpctl.arrays import Array
from rpctl.control.approach import Approach, ApproachStage
from rpctl.control.horizon.leaning import LeaningHorizonLaw
from rpctl.control.horizon.leaning_plan import REACH, LeaningHorizon, LeaningPlanner
from rpctl.control.horizon.planner import (
    Asked,
    Follower,
    HorizonPlan,
    Planned,
    Planner,
    Planning,
    start_planning,
)
from rpctl.control.horizon.process import PlanningProcess
from rpctl.control.horizon.settings import PlannerSettings
from rpctl.control.horizon.simulated import (
    Delays,
    SimulatedPlanning,
    SimulatedTime,
    simulated_time,
)
from rpctl.control.law import Command, KinematicController, KinematicLaw, Rest, as_law
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError, UnfitLawError
from rpctl.files.records import Setting
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot


@dataclass(frozen=True, kw_only=True)
class Horizon(PlannerSettings):
    """Model predictive control over N steps of length dt, with one quadratic program per solve.

    Every ``period`` the law simulates the last plan from the measured q and linearises the robot
    about that motion; a quadratic program then finds the accelerations ν̇ of the N steps that bring
    pose, arm, end effector and ν nearest to the reference (one step of sequential quadratic
    programming, the real-time iteration of [DBS05]). Until the next solve the command is the first
    step of the plan, ν_d = ν₀ + ν̇₀ (t − t₀) and ν̇_d = ν̇₀. ν₀ is the last plan's value, which
    approaches the measured ν with a time constant of 0.08 s. The states of the prediction include
    the steering angles and the arm's joints.

    Bounds of accelerations, joint speeds and joint positions are hard; those of wheel speeds,
    efforts, zero-moment point, grip and clearances are soft, with a higher cost than tracking
    errors. If the bounds do not let the robot follow, the reference's time slows down
    (:class:`~rpctl.control.horizon.target.TimeScaler`). If the error is large, a base with a
    smallest turning radius uses :class:`~rpctl.control.approach.Approach`, in scaled time. If a
    solve fails, it is counted, and ``fallback`` takes over for its period.
    """

    fallback: Annotated[KinematicLaw, Setting("", "", "Law used at samples without a plan.")] = (
        field(default_factory=UnifiedKinematic)
    )
    asynchronous: Annotated[
        bool,
        Setting(
            "",
            "",
            "Whether a separate process solves while the robot runs. A plan then starts from the "
            "state predicted for the time when it is ready; the law never waits. Give false if "
            "you simulate faster than real time.",
        ),
    ] = True
    leaning: Annotated[LeaningHorizon, Setting("", "", "On robots that lean.")] = field(
        default_factory=LeaningHorizon
    )
    approach: Annotated[
        Approach | None,
        Setting(
            "",
            "Approach from",
            "Approach path for large errors of a base that cannot turn on the spot; false: none. "
            "It ignores obstacles, so it is off if base_obstacles are given.",
        ),
    ] = field(default_factory=Approach)

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> HorizonLaw | LeaningHorizonLaw:
        """Return the controller of one run, without a plan and with all counts at zero.

        If a separate process solves (``asynchronous``), this starts it and waits until it is ready.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s; solves are :attr:`period` apart.
            rest: State before the run, for the fallback.

        Raises:
            RpctlError: The separate process cannot be started, or the robot leans and the settings
                contain obstacles or ``body_clearance``.
        """
        leans, simulated, process = dynamics.robot.drive.leans, simulated_time.get(), None
        if leans and (self.base_obstacles or self.end_effector_obstacles or self.body_clearance):
            raise UnfitLawError(
                f"{dynamics.robot.name} leans: the horizon law does not keep it clear of "
                "obstacles; leave out obstacles and body_clearance"
            )
        if self.asynchronous and simulated is None:
            process = self._process(dynamics.robot, period)  # it starts while this one goes on
        fallback = as_law(self.fallback).start(dynamics, period, rest)
        if process is not None:
            process.await_ready()
        if not leans:
            return HorizonLaw(self, dynamics, fallback, process)
        beside = process or SimulatedPlanning(
            LeaningPlanner(self.leaning, period, dynamics),
            (self.asynchronous and simulated) or SimulatedTime(),
        )
        return LeaningHorizonLaw(
            self.leaning, dynamics, period, fallback, beside, self.asynchronous
        )

    def _process(self, robot: Robot, period: float) -> PlanningProcess:
        """Return what plans beside the samples of a robot."""
        if robot.drive.leans:
            law, make = self.leaning, partial(LeaningPlanner, self.leaning, period)
            return PlanningProcess(make, robot, law.dt, law.steps + REACH)
        known = {each.name: getattr(self, each.name) for each in fields(PlannerSettings)}
        plain = partial(start_planning, PlannerSettings(**known))
        return PlanningProcess(plain, robot, self.dt, self.steps + 2)


class HorizonLaw:
    """:class:`Horizon` on one robot, with its plan and its counts.

    Args:
        law: Its settings.
        dynamics: The dynamics of the controller's model.
        fallback: What answers without a plan.
        process: What plans; None to plan here.
    """

    planner: Planner  # where it plans here

    def __init__(
        self,
        law: Horizon,
        dynamics: ReducedDynamics,
        fallback: KinematicController,
        process: PlanningProcess | None = None,
    ) -> None:
        self._law, self._fallback, self._dynamics = law, fallback, dynamics
        self._beside: PlanningProcess | SimulatedPlanning | None = process
        self.process, simulated = process, simulated_time.get()
        if process is None:
            self.planner = Planner(law, dynamics)
            if law.asynchronous and simulated is not None:
                self._beside = SimulatedPlanning(Planning(self.planner), simulated)
        self._plan: HorizonPlan | None = None
        self._asked: tuple[Asked, Reference] | None = None
        self._next: Planned | None = None  # the answer, until it begins
        self._made_for: Reference | None = None  # what the plan leads to
        self._stage: ApproachStage | None = None
        if law.approach is not None and not law.base_obstacles:
            self._stage = law.approach.stage(dynamics)
        self._follower, self._delays = Follower(dynamics.robot), Delays()
        self.solved_at = self._measured_at = -math.inf  # when it planned last, and its plan's state
        self._lag, self._fault = 0.0, ""
        self.solves = self.fallbacks = self.softened = self.unplanned = 0
        self.largest_lag = self.largest_age = 0.0

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command, from a new plan if it is time for one."""
        if self._beside is not None:
            self._plan_beside(self._beside, reference, t, q, nu)
        elif self._due(t):
            self.solved_at = self._measured_at = t
            read = self._approach(reference, t, q, nu)
            self._take(self.planner.plan(read, t, q, nu, self._plan))
        plan = self._plan
        if plan is None or t > plan.ends:
            self.unplanned += 1
            read = reference if self._stage is None else self._stage.reading(reference)
            return self._fallback(dynamics, read, t, q, nu)
        self.largest_age = max(self.largest_age, t - self._measured_at)
        # What is followed may have jumped along with a measured pose: then the plan is none of it.
        return self._follower(plan, t, q if self._made_for is reference else None)

    def report(self) -> dict[str, float]:
        """Return the numbers of solves, of failed ones, and of those that softened a bound.

        ``unplanned`` samples had no plan, and the fallback answered. ``largest_lag`` (s) is how far
        the scaled reference time fell behind, ``largest_age`` (s) how long ago the state was
        measured that a plan in use was made from. Where plans are made beside the samples,
        ``largest_delay`` (s) is the longest that one took, and ``restarts`` how often their process
        ended or did not answer. ``approaches`` is how many ways up to the reference there were, of
        a base that has that stage.
        """
        names = "solves", "fallbacks", "softened", "unplanned", "largest_lag", "largest_age"
        report: dict[str, float] = {name: getattr(self, name) for name in names}
        if self._stage is not None:
            report["approaches"] = self._stage.approaches
        if self._beside is not None:
            report["largest_delay"] = self._delays.largest
        if self.process is not None:
            report["restarts"] = self.process.restarts
        return report

    def notes(self) -> tuple[str, ...]:
        """Return sentences on plans that came late, and on what became of who makes them."""
        found, delay = [], self._delays.largest
        if delay > 0.0:
            found.append(
                f"plans of the horizon law took up to {1e3 * delay:.3g} ms; the plans in use "
                f"started from states up to {1e3 * self.largest_age:.3g} ms old"
            )
        if self.process is not None and self.process.restarts:
            fault = self.process.fault
            found.append(
                f"the planning process ended, or did not answer, {self.process.restarts} times; "
                + (
                    f"at last it could not be started: {fault}"
                    if fault
                    else "rpctl started it again"
                )
            )
        if self._fault:
            found.append(f"a plan of the horizon law failed: {self._fault}")
        return tuple(found)

    def _approach(self, reference: Reference, t: float, q: Array, nu: Array) -> Reference:
        """Return what a plan is to track: from far off, a new way up to the reference."""
        if self._stage is None:
            return reference
        try:
            return self._stage(self._dynamics, reference, t, q, nu, self._lag)
        except SingularBasisError:  # the base's curvature is not known there
            return self._stage.reading(reference)

    def _due(self, t: float) -> bool:
        return t - self.solved_at >= self._law.period - TIME_ROUNDING

    def _take(self, found: Planned) -> None:
        """Take over a plan, or the failure to find one."""
        self.solves += 1
        self.softened += found.softened
        self.fallbacks += found.plan is None
        self.largest_lag = max(self.largest_lag, found.largest_lag)
        self._plan = found.plan
        self._lag = found.lag if found.plan else self._lag
        self._fault = self._fault or found.fault

    def _plan_beside(
        self,
        beside: PlanningProcess | SimulatedPlanning,
        reference: Reference,
        t: float,
        q: Array,
        nu: Array,
    ) -> None:
        """Take over the plan that is there by now; ask for the next if it is time for one."""
        self._collect(beside, t)
        if self._asked is not None or not self._due(t):
            return
        read = self._approach(reference, t, q, nu)
        delay = min(self._delays.expected, 0.5 * self._law.steps * self._law.dt)
        if not beside.can_begin(read, t, self._lag, delay):
            return
        self.solved_at, asked = t, Asked(
            t, q, nu, delay, self._follower.beside, self._made_for is reference
        )  # fmt: skip
        self._asked = asked, reference
        beside.begin(read, asked)
        self._collect(beside, t)

    def _collect(self, beside: PlanningProcess | SimulatedPlanning, t: float) -> None:
        """Take over the plan that was asked for once it is there and its time has come."""
        found = beside.result(t)
        if self._asked is None:
            return
        asked, reference = self._asked
        if found is not None:
            self._next = found
            self._delays.add(t - asked.t)
        if self._next is None:
            if not beside.busy:  # who was asked is gone
                self._asked = None
            return
        plan = self._next.plan
        if plan is None or t >= plan.t - TIME_ROUNDING:
            feedback = None if plan is None else plan.feedback
            foreseen = self._follower.beside if feedback is None else feedback.beside
            self._follower.begin(t, foreseen)
            self._made_for, self._measured_at = reference, asked.t
            self._take(self._next)
            self._asked = self._next = None
