"""Runs that differ in more than numbers, a cell each: in processes if asked, told by figures.

A preset says which cells there are (``compare``, ``stress``, ``attraction``, ``tuning``), and what
it makes of their figures.
"""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Law, Rest, Timed
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.measures import fold, measures
from rpctl.simulation.merits.outcome import SUCCESSES
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.run.run import Run
from rpctl.simulation.run.table import FORMULA
from rpctl.study.executor import Executor
from rpctl.study.experiment import Progress

REFUSED, ENDED = "refused", "ended"  # outcomes of a run that never began, or came to no end
ROLLING, CONTACT = "rolling", "contact"  # kinds of plants


class References:
    """The references of a robot, each made once in a process: it takes as long as a run."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._known: dict[object, Reference] = {}

    def __getstate__(self) -> Mapping[str, Any]:
        """Return what another process needs; it makes its own references."""
        return {"robot": self.robot, "_known": {}}

    def __call__(self, settings: RunSettings) -> Reference:
        """Return the reference of a run."""
        key = (settings.reference, settings.size, settings.speed, settings.laps)
        if key not in self._known:
            self._known[key] = settings.load_reference(self.robot)
        return self._known[key]


class Cell(Protocol):
    """One run: a value that rows are told by."""

    def config(self, references: References) -> Config:
        """Return the run's configuration.

        Raises:
            RpctlError: The robot has no such run.
        """


AnyCell = TypeVar("AnyCell", bound=Cell)


@dataclass(frozen=True)
class Figures:
    """What became of a run; None where it has no such figure.

    Attributes:
        outcome: A word of ``simulation/merits/outcome.py``; ``"ended"`` if it came to no end,
            ``"refused"`` if it never began.
        sentence: Why, in words.
        time: Simulated, s.
        rms_base: Root mean square of P's distance from its reference, m.
        late_base: That of the second half, m.
        final_base: That distance at the end, m.
        final_lateral: Its lateral part at the end, m.
        settled_at: Since when that distance is below 5 cm, s.
        rms_end_effector: Root mean square of the end effector's distance, m.
        late_end_effector: That of the second half, m.
        final_end_effector: That distance at the end, m.
        joint_error: The largest of the arm's joints at the end, rad or m.
        joint_effort: Largest share of an effort limit of the arm.
        peak_effort: Largest share of any effort limit.
        rms_effort: Root mean square of these shares over time and actuators.
        violations: The limits of the URDF that were broken, each as ``JOINT KIND``.
        would_slip: Whether its motion needs more grip than there is, on a plant that always rolls.
        would_tip: Whether its motion would lift a wheel, on a plant that cannot fall.
        tilt: Largest angle by which the robot leant over from where it stood, rad.
        felt_ground: What the plant says of the ground, in words; empty where its wheels roll.
        lifted_wheels: Wheels that bore nothing for a while.
        hanging_wheels: Those of them that bore nothing where it stood, before it moved.
        sample_time: Median of the processor's time that a sample of both laws takes, s.
        sample_time_99: Its 99th percentile, s.
    """

    outcome: str
    sentence: str = ""
    time: float = 0.0
    rms_base: float | None = None
    late_base: float | None = None
    final_base: float | None = None
    final_lateral: float | None = None
    settled_at: float | None = None
    rms_end_effector: float | None = None
    late_end_effector: float | None = None
    final_end_effector: float | None = None
    joint_error: float | None = None
    joint_effort: float | None = None
    peak_effort: float | None = None
    rms_effort: float | None = None
    violations: tuple[str, ...] = ()
    would_slip: bool = False
    would_tip: bool = False
    tilt: float = 0.0
    felt_ground: str = ""
    lifted_wheels: tuple[str, ...] = ()
    hanging_wheels: tuple[str, ...] = ()
    sample_time: float | None = None
    sample_time_99: float | None = None

    @property
    def failure(self) -> str | None:
        """Why there is no end; None of a run that came to it."""
        return self.sentence if self.outcome in (REFUSED, ENDED) else None

    @property
    def succeeded(self) -> bool:
        """Whether the robot tracked its reference, late or not, within the limits."""
        return self.outcome in SUCCESSES and not self.violations

    @property
    def late_error(self) -> float:
        """The larger error of the second half, m; inf where there is none, or one is no number."""
        errors = [each for each in (self.late_base, self.late_end_effector) if each is not None]
        return max(errors, default=math.inf) if all(map(math.isfinite, errors)) else math.inf


@dataclass(frozen=True)
class Row(Generic[AnyCell]):
    """A cell, and what became of it."""

    cell: AnyCell
    figures: Figures


@dataclass(frozen=True)
class CellRunner:
    """Runs the cells of one robot; it can be sent to another process.

    Attributes:
        references: Those of the robot.
        timed: Whether to measure what the laws take.
    """

    references: References
    timed: bool = False

    def __call__(self, cell: Cell) -> Figures:
        """Return what became of a cell; a run that was refused, or ended early, says why."""
        ended, seconds = list[Run](), list[float]()
        try:
            config = cell.config(self.references)
            reference = self.references(config.run)
            if self.timed:
                kinematic, dynamic = (
                    TimedLaw(law, seconds)  # type: ignore[arg-type]
                    for law in (config.kinematic, config.dynamic)
                )
                config = replace(config, kinematic=kinematic, dynamic=dynamic)
            run = simulate(self.references.robot, config, reference, ended=ended.append)
        except RpctlError as error:
            if not ended and not isinstance(error, DivergedError):
                return Figures(REFUSED, str(error))
            return Figures(ENDED, str(error), float(ended[0].t[-1]) if ended else 0.0)
        return figures_of(run, seconds)


def run_cells(
    runner: Callable[[AnyCell], Figures],
    cells: Sequence[AnyCell],
    executor: Executor,
    progress: Progress | None = None,
    keep: Callable[[AnyCell, Figures], object] = lambda cell, figures: None,
) -> list[Row[AnyCell]]:
    """Run cells; return their rows in order.

    Args:
        runner: What runs one; it can be sent to another process.
        cells: Which; each is another one.
        executor: On what.
        progress: Called with the cells done and their number.
        keep: Called with each cell and its figures as it ends.

    Raises:
        LostChunksError: A cell ended each process that ran it.
    """
    results: dict[AnyCell, Figures] = {}
    for cell, figures in executor.map_chunks(runner, cells):
        results[cell] = figures
        keep(cell, figures)
        if progress is not None:
            progress(len(results), len(cells))
    return [Row(cell, results[cell]) for cell in cells]


def figures_of(run: Run, call_seconds: Sequence[float] = ()) -> Figures:
    """Return the figures of a run that came to its end.

    Args:
        run: The run.
        call_seconds: What each call of its two laws took, in turn, s; nothing: not measured.
    """
    summary, errors, kind = summarize(run), measures(run), run.config.plant.kind
    late, settled = slice(len(run.t) // 2, None), int(fold(errors).settled)
    limits, wheels = np.array(run.robot.effort_limits), {w.joint for w in run.robot.drive.wheels}
    ratios = (run.tau / limits)[:, np.isfinite(limits)]
    arm = [each.ratio for each in summary.efforts if each.actuator in run.robot.joint_names]
    felt = summary.felt_ground
    samples = np.reshape(call_seconds, (-1, 2)).sum(axis=1)
    return Figures(
        outcome=summary.outcome,
        sentence=summary.outcome_sentence,
        time=float(run.t[-1]),
        rms_base=summary.rms_base_error,
        late_base=_rms(errors.base[late]),
        final_base=summary.final_base_error,
        final_lateral=summary.final_lateral_error,
        settled_at=float(run.t[settled]) if settled < len(run.t) else None,
        rms_end_effector=summary.rms_end_effector_error,
        late_end_effector=None if run.robot.end_effector is None else _rms(errors.tip[late]),
        final_end_effector=summary.final_end_effector_error,
        joint_error=max((joint.final for joint in summary.joint_errors), default=None),
        joint_effort=max(arm, default=None),
        peak_effort=float(np.abs(ratios).max()) if ratios.size else None,
        rms_effort=_rms(ratios) if ratios.size else None,
        violations=tuple(f"{each.joint} {each.limit}" for each in summary.limits_violated),
        would_slip=kind == ROLLING and bool(summary.ground.would_slip),
        would_tip=kind != CONTACT and bool(summary.ground.would_tip),
        tilt=largest_tilt(run.log.root_pose),
        felt_ground="" if felt is None else felt.sentence,
        lifted_wheels=() if felt is None else tuple(n for n in felt.lifted if n in wheels),
        hanging_wheels=() if felt is None else tuple(n for n in felt.hanging if n in wheels),
        sample_time=float(np.median(samples)) if len(samples) else None,
        sample_time_99=float(np.percentile(samples, 99.0)) if len(samples) else None,
    )


def csv_text(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return some columns of rows as CSV; no spreadsheet takes a cell for a formula."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _csv_cell(row.get(name)) for name in columns})
    return text.getvalue()


def _csv_cell(value: Any) -> Any:
    text = "; ".join(value) if isinstance(value, tuple | list) else value
    return f"'{text}" if isinstance(text, str) and text.startswith(FORMULA) else text


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def largest_tilt(poses: Array) -> float:
    """Return the largest angle (rad) by which a body leant over from where it stood.

    Args:
        poses: Its poses (K, 7): x, y, z, quaternion x, y, z, w; none (K, 0): it stays upright.
    """
    if not poses.size:
        return 0.0
    x, y, z, w = poses[:, 3:].T
    up = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return float(np.arccos(np.clip(up @ up[0], -1.0, 1.0)).max())


# ---- the time that laws take --------------------------------------------------------------


@dataclass(frozen=True)
class TimedLaw:
    """A law whose calls are timed.

    Attributes:
        law: The law.
        seconds: Gets the processor time (thread time) of each call, s.
    """

    law: Law[Any]
    seconds: list[float] = field(compare=False)

    def start(self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None) -> Any:
        """Return the controller of one run; see :meth:`rpctl.control.law.Law.start`."""
        return _TimedController(self.law.start(dynamics, period, rest), self.seconds)


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
