"""The benchmark: a grid of laws, references and scenarios, and who won which of its cells."""

from __future__ import annotations

import glob
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby, product
from typing import Any, Generic, NamedTuple, TypeVar, cast

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Law, Rest, Timed
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, dynamic_by_name, kinematic_by_name
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference.motion import Reference
from rpctl.reference.quasi_velocities import configuration_along
from rpctl.reference.sizing import SizingRequest
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses, set_limits
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.periods import CONTROL_PERIOD, whole_periods
from rpctl.simulation.loop.track import default_duration, simulate
from rpctl.simulation.merits.outcome import SUCCESSES
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.run.run import Run
from rpctl.study.cells import References

ARM_MASS_RATIO = 0.7  # of the arm's mass: what the controller takes it for
BIAS_RATIO = 0.05  # of the first wheel's effort limit
DEFAULT_BIAS_NM = 1.0  # N·m, where it has none
DELAY_S = 0.02  # s
EFFORT_LIMIT_RATIO = 0.5  # of what holding still leaves of each effort limit
HOLDING_SAMPLE_S = 0.1  # s: at a reference, for what holding still takes
REFERENCES = ("line", "reverse", "spin", "circle", "eight", "waypoints", "ee-square")
INITIAL_ERROR = (0.1, -0.1, 0.1)  # m, m, rad

Controller = TypeVar("Controller")
MEASURES = {"rms_base": "base", "rms_end_effector": "end effector"}
TIE_RATIO = 1.01  # times the least error: as good, for all that a table shows


class Case(NamedTuple):
    """The robot that is simulated and controlled, and what its controller does not know of."""

    robot: Robot
    plant: Plant


@dataclass(frozen=True)
class Scenario:
    """A disturbance or model error that a run is made with.

    Attributes:
        summary: What it is, in a line.
        make: The case of a robot on a reference.
    """

    summary: str
    make: Callable[[Robot, Reference], Case]


def _light_arm(robot: Robot) -> Case:
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm")
    controller_model = robot
    for joint in robot.joints:
        controller_model = scale_masses(controller_model, glob.escape(joint.name), ARM_MASS_RATIO)
    return Case(robot, Plant(controller_model=controller_model))


def _wheel_bias(robot: Robot) -> Case:
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    for name, limit in zip(robot.actuators, robot.effort_limits, strict=True):
        if name in wheels:
            bias = BIAS_RATIO * float(limit) if np.isfinite(limit) else DEFAULT_BIAS_NM
            return Case(robot, Plant(tau_bias={name: bias}))
    raise RpctlError(f"{robot.name} has no driven wheel")


def _half_limits(robot: Robot, reference: Reference) -> Case:
    """Halve what each effort limit exceeds the largest static effort of the reference by."""
    limits, holding_efforts = robot.effort_limits, _holding_efforts(robot, reference)
    left = limits - EFFORT_LIMIT_RATIO * np.maximum(limits - holding_efforts, 0.0)
    efforts = {
        glob.escape(name): float(limit)
        for name, limit in zip(robot.actuators, left, strict=True)
        if np.isfinite(limit)
    }
    return Case(set_limits(robot, effort=efforts), Plant())


def _holding_efforts(robot: Robot, reference: Reference) -> Array:
    """Return the largest efforts (n_act,) that hold the robot still anywhere on a reference."""
    dynamics, still = ReducedDynamics(robot), np.zeros(robot.dof)
    found = []
    for t in np.arange(0.0, default_duration(reference), HOLDING_SAMPLE_S).tolist():
        q = configuration_along(robot, reference(t))
        found.append(np.abs(dynamics.efforts(q, dynamics.bias(q, still))))
    return np.asarray(np.max(found, axis=0))


SCENARIOS = {
    "nominal": Scenario("the model is right", lambda robot, _: Case(robot, Plant())),
    "arm-mass": Scenario(
        "the controller takes every moving link of the arm to weigh 30 % less than it does",
        lambda robot, _: _light_arm(robot),
    ),
    "wheel-bias": Scenario(
        "the first driven wheel is pushed by 5 % of its effort limit (1 N·m without one)",
        lambda robot, _: _wheel_bias(robot),
    ),
    "delay": Scenario(
        "20 ms from a measurement to the efforts it leads to",
        lambda robot, _: Case(robot, Plant(delay=DELAY_S)),
    ),
    "computing": Scenario(
        "computing takes the time that it takes here: efforts come later, samples are missed",
        lambda robot, _: Case(robot, Plant(computing_time="measured")),
    ),
    "half-limits": Scenario(
        "half of each effort limit, beyond what holding still takes; references stay",
        _half_limits,
    ),
}


@dataclass(frozen=True)
class LawPair:
    """A kinematic and a dynamic law, by name."""

    kinematic: str
    dynamic: str

    def __str__(self) -> str:
        """Return ``KINEMATIC+DYNAMIC``."""
        return f"{self.kinematic}+{self.dynamic}"


PAPER = LawPair("paper", "paper")
PROPOSED = LawPair("end-effector", "integral")  # what rpctl proposes for a robot with an arm
PROPOSED_ARMLESS = LawPair("horizon", "integral")  # the same without an end effector to keep
# Dynamic laws differ only if limits bind or the model is wrong: one kinematic law shows that.
LAW_PAIRS = (
    PAPER,
    LawPair("unified", "paper"),
    LawPair("unified", "bounded"),
    LawPair("unified", "integral"),
    PROPOSED,
    PROPOSED_ARMLESS,
    LawPair("kanayama", "paper"),
    LawPair("feedback-linearization", "paper"),
)


def proposed(robot: Robot) -> LawPair:
    """Return the controller that rpctl proposes for a robot."""
    return PROPOSED if robot.joints else PROPOSED_ARMLESS


def controllers(laws: Sequence[str] = (), dynamic: str | None = None) -> list[LawPair]:
    """Return the controllers that are asked for.

    Args:
        laws: ``KINEMATIC+DYNAMIC``, or ``KINEMATIC`` alone: with ``dynamic``, else every pair of
            :data:`PAIRS` that has it. Nothing: all kinematic laws.
        dynamic: The dynamic law of kinematic laws that stand alone.

    Raises:
        UnknownNameError: There is no such law.
    """
    chosen: list[LawPair] = []
    for name in laws or KINEMATIC_LAWS:
        kinematic, _, own = name.partition("+")
        if kinematic not in KINEMATIC_LAWS:
            raise UnknownNameError("kinematic law", kinematic, KINEMATIC_LAWS)
        wanted = own or dynamic
        if wanted is not None and wanted not in DYNAMIC_LAWS:
            raise UnknownNameError("dynamic law", wanted, DYNAMIC_LAWS)
        pairs = [pair for pair in LAW_PAIRS if pair.kinematic == kinematic]
        if wanted is not None:
            pairs = [LawPair(kinematic, wanted)]
        chosen += pairs or [LawPair(kinematic, "bounded")]
    order = {pair: place for place, pair in enumerate(LAW_PAIRS)}
    return sorted(dict.fromkeys(chosen), key=lambda pair: order.get(pair, len(LAW_PAIRS)))


class Cell(NamedTuple):
    """One run of the grid."""

    scenario: str
    reference: str
    controller: LawPair


@dataclass(frozen=True)
class Figures:
    """The error, effort and time figures of one run.

    Attributes:
        rms_base: Root mean square of P's distance from its reference, m.
        final_base: That distance at the end, m.
        final_lateral: Its lateral part at the end, m.
        rms_end_effector: Root mean square of the end effector's distance, m; None without an arm.
        final_end_effector: That distance at the end, m; None without an arm.
        peak_effort: Largest share of an effort limit; None without limits.
        rms_effort: Root mean square of these shares over time and actuators; None without limits.
        violations: The limits of the URDF that were broken, each as ``JOINT KIND``.
        sample_time: Median of the processor's time that a sample of both laws takes, s.
        sample_time_99: Its 99th percentile, s.
        outcome: What became of the run, in a word of :mod:`rpctl.simulation.merits.outcome`.
    """

    rms_base: float
    final_base: float
    final_lateral: float
    rms_end_effector: float | None
    final_end_effector: float | None
    peak_effort: float | None
    rms_effort: float | None
    violations: tuple[str, ...]
    sample_time: float
    sample_time_99: float
    outcome: str

    @property
    def succeeded(self) -> bool:
        """Whether the robot tracked its reference, late or not, within the limits."""
        return self.outcome in SUCCESSES and not self.violations


class Row(NamedTuple):
    """A cell and its figures, or why it has none."""

    cell: Cell
    figures: Figures | None
    failure: str | None

    def to_dict(self) -> dict[str, Any]:
        """Return the row as JSON says it."""
        scenario, reference, controller = self.cell
        return {
            "scenario": scenario,
            "reference": reference,
            "controller": str(controller),
            "kinematic": controller.kinematic,
            "dynamic": controller.dynamic,
            "failure": self.failure,
            **(asdict(self.figures) if self.figures else dict.fromkeys(Figures.__annotations__)),
        }


class Stopwatch:
    """Measures the processor time (thread time) of each call of a law, s."""

    def __init__(self) -> None:
        self.seconds: list[float] = []  # of each call, the laws in turn

    def time_law(self, law: Law[Controller]) -> Law[Controller]:
        """Return a law that is timed."""
        return _TimedLaw(law, self.seconds)


class _TimedLaw(Generic[Controller]):
    def __init__(self, law: Law[Controller], call_seconds: list[float]) -> None:
        self._law, self._seconds = law, call_seconds

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> Controller:
        """Return the controller of one run; see :meth:`rpctl.control.law.Law.start`."""
        controller = self._law.start(dynamics, period, rest)
        return cast("Controller", _TimedController(controller, self._seconds))


class _TimedController:
    def __init__(self, controller: Any, call_seconds: list[float]) -> None:
        self.report, self._controller, self._seconds = controller.report, controller, call_seconds
        self._is_timed = isinstance(controller, Timed)

    def __call__(self, *arguments: Any) -> Any:
        began = time.thread_time()
        try:
            return self._controller(*arguments)
        finally:
            self._seconds.append(time.thread_time() - began)

    def sampled_after(self, elapsed: float | None) -> None:
        """Hand on the time since the last call; see :class:`rpctl.control.law.Timed`."""
        if self._is_timed:
            self._controller.sampled_after(elapsed)


class Benchmark:
    """Runs cells on one robot.

    Args:
        robot: The robot.
        duration: Of each run, s; None: as long as its reference moves. It ends with the last whole
            control period.
        initial_error: Tracking error (x1, x2, x3) at the start, m, m, rad.
        wish: Size, speed and laps of its named references; None: as fits the robot.
        smooth: Tolerance of smoothing its tables (CSV), m, or ``auto``; None passes every row.
        retime: Whether its tables are slowed down where limits bind.

    Raises:
        RpctlError: The duration is not positive.
    """

    def __init__(
        self,
        robot: Robot,
        duration: float | None = None,
        initial_error: Sequence[float] = INITIAL_ERROR,
        wish: SizingRequest | None = None,
        smooth: float | str | None = None,
        retime: bool = False,
    ) -> None:
        if duration is not None:
            duration = whole_periods(duration, CONTROL_PERIOD) * CONTROL_PERIOD
        self.robot, self.duration, self._references = robot, duration, References(robot)
        self.initial_error = cast("tuple[float, float, float]", tuple(initial_error))
        self.wish = wish or SizingRequest()
        self._of_tables: dict[str, Any] = {"smooth": smooth, "retime": retime}

    def __call__(self, cell: Cell) -> Row:
        """Return the row of a cell; what keeps it from running is its failure."""
        try:
            return Row(cell, self._run(cell), None)
        except RpctlError as error:
            return Row(cell, None, str(error))

    def _run(self, cell: Cell) -> Figures:
        reference = self._references(self._settings(cell.reference))
        case = SCENARIOS[cell.scenario].make(self.robot, reference)
        watch = Stopwatch()
        error = self.initial_error if self.robot.drive.base_speeds else (0.0, 0.0, 0.0)
        config = Config(
            kinematic=watch.time_law(kinematic_by_name(cell.controller.kinematic)),
            dynamic=watch.time_law(dynamic_by_name(cell.controller.dynamic)),
            run=self._settings(cell.reference, error),
            plant=case.plant,
        )
        run = simulate(case.robot, config, reference)
        return figures(run, watch.seconds)

    def _settings(
        self, reference: str, error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> RunSettings:
        found = RunSettings(reference, self.duration, error, **asdict(self.wish))
        return replace(found, **self._of_tables) if reference.endswith(".csv") else found


def figures(run: Run, call_seconds: Sequence[float]) -> Figures:
    """Return the figures of a run.

    Args:
        run: The run.
        call_seconds: What each call of its two laws took, in turn, s.
    """
    summary = summarize(run)
    limits = np.array(run.robot.effort_limits)
    effort_ratios = (run.tau / limits)[:, np.isfinite(limits)]
    samples = np.reshape(call_seconds, (-1, 2)).sum(axis=1)
    return Figures(
        rms_base=summary.rms_base_error,
        final_base=summary.final_base_error,
        final_lateral=summary.final_lateral_error,
        rms_end_effector=summary.rms_end_effector_error,
        final_end_effector=summary.final_end_effector_error,
        peak_effort=float(np.abs(effort_ratios).max()) if effort_ratios.size else None,
        rms_effort=float(np.sqrt(np.mean(np.square(effort_ratios))))
        if effort_ratios.size
        else None,
        violations=tuple(f"{each.joint} {each.limit}" for each in summary.limits_violated),
        sample_time=float(np.median(samples)),
        sample_time_99=float(np.percentile(samples, 99.0)),
        outcome=summary.outcome,
    )


def grid(
    scenarios: Sequence[str], references: Sequence[str], controllers: Sequence[LawPair]
) -> list[Cell]:
    """Return all cells, scenario by scenario.

    Args:
        scenarios: Names of scenarios.
        references: Names or files of references.
        controllers: Pairs of a kinematic and a dynamic law.
    """
    return [Cell(*each) for each in product(scenarios, references, controllers)]


class Verdict(NamedTuple):
    """The proposed pair of laws against the others in one cell, by one rms error (m).

    A controller that did not track, broke a limit, or did not run has no error here.
    """

    scenario: str
    reference: str
    measure: str
    ours: float | None
    paper: float | None
    best: float
    by: LawPair

    @property
    def won(self) -> bool:
        """Whether no controller was better."""
        return self.ours is not None and self.ours <= TIE_RATIO * self.best

    @property
    def worse_than_paper(self) -> bool:
        """Whether the paper's laws work here, and better."""
        return self.paper is not None and (self.ours is None or self.ours > TIE_RATIO * self.paper)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON says it."""
        return {
            **self._asdict(),
            "by": str(self.by),
            "won": self.won,
            "worse_than_paper": self.worse_than_paper,
        }


def group_rows(rows: Iterable[Row]) -> list[tuple[tuple[str, str], list[Row]]]:
    """Return the rows by scenario and reference, in order."""
    return [(key, list(group)) for key, group in groupby(rows, key=lambda row: row.cell[:2])]


def best(rows: Sequence[Row], measure: str) -> tuple[float, LawPair] | None:
    """Return the least error of the controllers that work, and whose it is."""
    errors = _errors(rows, measure)
    if not errors:
        return None
    by = min(errors, key=lambda controller: errors[controller])
    return errors[by], by


def verdicts(rows: Sequence[Row], proposed: LawPair) -> list[Verdict]:
    """Return the verdict on each scenario, reference and measure in which a controller works.

    Args:
        rows: Of a grid.
        proposed: The controller that rpctl proposes; none of the rows is its: no verdict.
    """
    found = []
    for (scenario, reference), group in group_rows(rows):
        for measure in MEASURES:
            least, errors = best(group, measure), _errors(group, measure)
            if least is not None and any(row.cell.controller == proposed for row in group):
                ours, paper = errors.get(proposed), errors.get(PAPER)
                found.append(Verdict(scenario, reference, measure, ours, paper, *least))
    return found


def _errors(rows: Sequence[Row], measure: str) -> dict[LawPair, float]:
    return {
        row.cell.controller: error
        for row in rows
        if row.figures is not None
        and row.figures.succeeded
        and (error := getattr(row.figures, measure)) is not None
    }
