"""The horizon law: predictive control of the whole robot over N steps, within its limits."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Annotated, Generic, TypeVar

from rpctl.arrays import Array
from rpctl.control.approach import Approach, ApproachStage
from rpctl.control.horizon.planner import HorizonPlan, Planned, Planner, Prepared
from rpctl.control.horizon.settings import PlannerSettings
from rpctl.control.law import Command, KinematicController, KinematicLaw, Rest, as_law
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, SingularBasisError
from rpctl.files.records import Setting
from rpctl.reference.motion import Reference

ComputingTime = float | str  # s, or "measured"
REMEMBERED_DELAYS = 20  # results: the longest of them is expected next
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time

Result = TypeVar("Result")


@dataclass
class SimulatedTime:
    """What computing takes in a simulation, in the place of what it takes on this machine.

    Attributes:
        computing_time: Of a computation, s, or "measured": its processor time.
        spent_in_background: Processor time of what was computed beside the samples, s.
    """

    computing_time: ComputingTime = 0.0
    spent_in_background: float = 0.0


_simulated: ContextVar[SimulatedTime | None] = ContextVar("simulated", default=None)


@contextmanager
def in_simulated_time(simulated: SimulatedTime) -> Iterator[None]:
    """Let the laws that are started meanwhile compute in simulated time."""
    token = _simulated.set(simulated)
    try:
        yield
    finally:
        _simulated.reset(token)


class Background(Generic[Result]):
    """Runs one computation at a time, whose result comes later; times are those of the samples.

    In simulated time it computes at once, and holds the result back for the time that it takes.

    Attributes:
        largest_delay: Of a result so far, s.
    """

    def __init__(self) -> None:
        self._simulated = _simulated.get()
        self._thread = None if self._simulated else ThreadPoolExecutor(1, "horizon")
        self._running: Future[Result] | None = None
        self._began = self._held_back = self.largest_delay = 0.0
        self._delays = deque[float](maxlen=REMEMBERED_DELAYS)

    @property
    def busy(self) -> bool:
        """Whether a computation runs, or its result waits."""
        return self._running is not None

    @property
    def expected_delay(self) -> float:
        """The longest of the last delays, s; 0 before the first."""
        return max(self._delays, default=0.0)

    def begin(self, t: float, compute: Callable[[], Result]) -> None:
        """Begin a computation at a time (s)."""
        self._began = t
        if self._thread is not None:
            self._running = self._thread.submit(compute)
        elif self._simulated is not None:
            self._running, began = Future(), time.thread_time()
            self._running.set_result(compute())
            spent, stated = time.thread_time() - began, self._simulated.computing_time
            self._held_back = spent if isinstance(stated, str) else stated
            self._simulated.spent_in_background += spent

    def result(self, t: float) -> Result | None:
        """Return the result that is there at a time (s), once."""
        running, due = self._running, self._began + self._held_back - TIME_ROUNDING
        if running is None or not running.done() or t < due:
            return None
        self._running, delay = None, self._held_back if self._simulated else t - self._began
        self._delays.append(delay)
        self.largest_delay = max(self.largest_delay, delay)
        return running.result()


@dataclass(frozen=True)
class Horizon(PlannerSettings):
    """Predictive control over N steps of length dt, by one QP a solve.

    Every ``period`` the last plan is simulated again from the measured q, the robot is linearised
    about that motion, and a QP finds the accelerations ν̇ of the N steps that bring pose, arm, end
    effector and ν nearest to the reference (one step of sequential quadratic programming, the
    real-time iteration of [DBS05]). Until the next solve the command is the first step of the plan,
    ν_d = ν₀ + ν̇₀ (t − t₀) and ν̇_d = ν̇₀. ν₀ is the last plan's value, drawn towards the measured
    ν with a time constant of 0.08 s. Steering angles are states of the prediction as the arm's are.

    Accelerations, joint speeds and joint positions are hard bounds; wheel speeds, efforts,
    zero-moment point, grip and clearances are soft, at a price above that of tracking errors. Where
    the bounds do not let the robot follow, the reference's time is scaled
    (:class:`~rpctl.control.horizon.target.TimeScaler`). From far off, a base that has a tightest
    bend is led up to its reference (:class:`~rpctl.control.approach.Approach`), in scaled time. A
    failed solve is counted and its period is left to ``fallback``.
    """

    fallback: Annotated[KinematicLaw, Setting("", "", "Law of the samples without a plan.")] = (
        field(default_factory=UnifiedKinematic)
    )
    prepare: Annotated[
        bool,
        Setting(
            "",
            "",
            "Whether a QP is linearised ahead, about the state expected at the next "
            "solve, so that only the QP itself is left to do once that is measured. It "
            "needs someone who calls HorizonLaw.prepare between the samples; "
            "rpctl.Controller does.",
        ),
    ] = False
    asynchronous: Annotated[
        bool,
        Setting(
            "",
            "",
            "Whether solves run beside the samples. A plan then starts from the state "
            "that is expected when it will be there, and applies from then on; the law "
            "never waits.",
        ),
    ] = False
    approach: Annotated[
        Approach | None,
        Setting(
            "",
            "Approach from",
            "Stage for large errors of a base that cannot turn on the spot; false: none. "
            "It knows of no obstacles: there is none where base_obstacles are given.",
        ),
    ] = field(default_factory=Approach, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse settings that predict nothing."""
        super().__post_init__()
        if self.prepare and self.asynchronous:
            raise RpctlError("prepare and asynchronous exclude each other; choose one")

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> HorizonLaw:
        """Return the controller of one run, without a plan and with all counts at zero.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s, for the fallback: solves are :attr:`period` apart.
            rest: State before the run, for the fallback.
        """
        return HorizonLaw(self, dynamics, as_law(self.fallback).start(dynamics, period, rest))


class HorizonLaw:
    """:class:`Horizon` on one robot, with its plan and its counts."""

    def __init__(
        self, law: Horizon, dynamics: ReducedDynamics, fallback: KinematicController
    ) -> None:
        self._law, self._fallback = law, fallback
        self.planner = Planner(law, dynamics)
        self._plan: HorizonPlan | None = None
        self._prepared: Prepared | None = None
        self._reference: Reference | None = None
        self._stage: ApproachStage | None = None
        if law.approach is not None and not law.base_obstacles:
            self._stage = law.approach.stage(dynamics)
        self.solved_at = -math.inf
        self.solves = self.fallbacks = self.softened = self.prepared = 0
        self.largest_lag = 0.0
        self._background: Background[Planned] | None = Background() if law.asynchronous else None

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command, from a new plan if it is time for one."""
        self._reference = reference
        if self._background is not None:
            self._plan_in_background(self._background, reference, t, q, nu)
        elif self._due(t):
            self.solved_at = t
            self._take(self._new_plan(reference, t, q, nu))
        if self._plan is None:
            return self._fallback(dynamics, self._reading(reference), t, q, nu)
        return self._plan.command(t)

    def _new_plan(self, reference: Reference, t: float, q: Array, nu: Array) -> Planned:
        """Return a plan from a measured state on, by the QP that was prepared if there is one."""
        prepared, self._prepared = self._prepared, None
        before, read = self._reading(reference), self._approach(reference, t, q, nu)
        if (
            prepared is None
            or self._plan is None
            or abs(prepared.t - t) > self._law.period
            or read is not before  # what was prepared leads elsewhere
        ):
            return self.planner.plan(read, t, q, nu, self._plan)
        self.prepared += 1
        q, nu = self.planner.advanced(q, nu, self._plan.command(t).nu_d_dot, prepared.t - t)
        return self.planner.feed_back(prepared, q, nu, self._plan)

    def prepare(self, t: float, q: Array, nu: Array, after: float) -> None:
        """Linearise ahead if the next sample is one to solve at; call it after a command is sent.

        Args:
            after: Time until the next sample, s.
        """
        plan = self._plan
        if not self._law.prepare or plan is None or self._reference is None:
            return
        if self._due(t + after):
            nu_dot = plan.command(t).nu_d_dot
            q, nu = self.planner.advanced(q, nu, nu_dot, after)
            start = plan.start_of_next(t + after, nu)
            read = self._reading(self._reference)
            self._prepared = self.planner.prepare(read, t + after, q, start, plan)

    def report(self) -> dict[str, float]:
        """Return the numbers of solves, of failed ones, and of those that softened a bound.

        ``largest_lag`` (s) is how far the scaled reference time fell behind. With ``prepare``,
        ``prepared`` is the number of solves that were; with ``asynchronous``, ``largest_delay`` (s)
        is the longest that a plan took. ``approaches`` is how many ways up to the reference there
        were, of a base that has that stage.
        """
        report: dict[str, float] = {
            "solves": self.solves,
            "fallbacks": self.fallbacks,
            "softened": self.softened,
            "largest_lag": self.largest_lag,
        }
        if self._stage is not None:
            report["approaches"] = self._stage.approaches
        if self._law.prepare:
            report["prepared"] = self.prepared
        if self._background is not None:
            report["largest_delay"] = self._background.largest_delay
        return report

    def _reading(self, reference: Reference) -> Reference:
        """Return what the plans track by now: the reference, or the way up to it."""
        return reference if self._stage is None else self._stage.reading(reference)

    def _approach(self, reference: Reference, t: float, q: Array, nu: Array) -> Reference:
        """Return what a plan is to track: from far off, a new way up to the reference."""
        if self._stage is None:
            return reference
        planner = self.planner
        try:
            return self._stage(planner.model.dynamics, reference, t, q, nu, planner.lag(t))
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

    def _plan_in_background(
        self, background: Background[Planned], reference: Reference, t: float, q: Array, nu: Array
    ) -> None:
        """Take over the plan that is there by now; begin the next if it is time for one.

        It is planned from the state that is expected at its end.
        """
        found = background.result(t)
        if found is not None:
            self._take(found)
        if background.busy or not self._due(t):
            return
        last, delay = self._plan, min(background.expected_delay, self._law.dt)
        if last is not None:
            q, nu = self.planner.advanced(q, nu, last.command(t).nu_d_dot, delay)
        self.solved_at = t

        def plan() -> Planned:
            read = self._approach(reference, t + delay, q, nu)
            return self.planner.plan(read, t + delay, q, nu, last)

        background.begin(t, plan)
        found = background.result(t)
        if found is not None:
            self._take(found)
