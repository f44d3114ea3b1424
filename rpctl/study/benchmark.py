"""The benchmark: a grid of runs, a row of figures each."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from typing import Any, Generic, NamedTuple, TypeVar, cast

import numpy as np

from rpctl.control.law import Law, Rest, Timed
from rpctl.control.registry import dynamic_by_name, kinematic_by_name
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import Reference
from rpctl.reference.sizing import SizingRequest
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import simulate
from rpctl.simulation.outcome import SUCCESSES
from rpctl.simulation.periods import CONTROL_PERIOD, whole_periods
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize
from rpctl.study.executor import ProcessExecutor, SerialExecutor
from rpctl.study.scenarios import SCENARIOS, LawPair

REFERENCES = ("line", "reverse", "spin", "circle", "eight", "waypoints", "ee-square")
INITIAL_ERROR = (0.1, -0.1, 0.1)  # m, m, rad

Controller = TypeVar("Controller")
Asked = TypeVar("Asked")
Result = TypeVar("Result")
Progress = Callable[[int, int], object]


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
        outcome: What became of the run, in a word of :mod:`rpctl.simulation.outcome`.
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
        self.robot, self.duration = robot, duration
        self.initial_error = cast("tuple[float, float, float]", tuple(initial_error))
        self.wish = wish or SizingRequest()
        self._of_tables: dict[str, Any] = {"smooth": smooth, "retime": retime}
        self._references: dict[str, Reference] = {}

    def __call__(self, cell: Cell) -> Row:
        """Return the row of a cell; what keeps it from running is its failure."""
        try:
            return Row(cell, self._run(cell), None)
        except RpctlError as error:
            return Row(cell, None, str(error))

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs; it makes its own references."""
        return {**vars(self), "_references": {}}

    def _run(self, cell: Cell) -> Figures:
        reference = self._reference(cell.reference)
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

    def _reference(self, name: str) -> Reference:
        if name not in self._references:
            self._references[name] = self._settings(name).load_reference(self.robot)
        return self._references[name]

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


def run_grid(
    bench: Callable[[Asked], Result],
    cells: Sequence[Asked],
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[Result]:
    """Run cells, in several processes if asked; return their rows in order.

    Args:
        bench: What runs them; it can be sent to another process.
        cells: Which.
        jobs: Number of processes; 1 runs them in this one.
        progress: Called with the cells done and their total.

    Raises:
        LostChunksError: A cell ended each process that ran it.
    """
    notify = progress or (lambda done, total: None)
    rows: dict[int, Result] = {}
    with ProcessExecutor(jobs) if jobs > 1 else SerialExecutor() as executor:
        ended = executor.map_chunks(partial(_numbered, bench), enumerate(cells))
        for (number, _), row in ended:
            rows[number] = row
            notify(len(rows), len(cells))
    return [rows[number] for number in range(len(cells))]


def _numbered(bench: Callable[[Asked], Result], cell: tuple[int, Asked]) -> Result:
    return bench(cell[1])
