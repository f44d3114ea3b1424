"""The benchmark: a grid of laws, references and scenarios, and who won which of its cells."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.registry import KINEMATIC_LAWS, read_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import Reference, configuration_along
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses
from rpctl.simulation.config import Config, LimitOverrides, RunSettings, whole_periods
from rpctl.simulation.loop.track import default_duration
from rpctl.simulation.plants.plant import Plant
from rpctl.study.cells import References, Row

ARM_MASS_RATIO = 0.7  # of the arm's mass: what the controller takes it for
BIAS_RATIO = 0.05  # of the first wheel's effort limit
DEFAULT_BIAS_NM = 1.0  # N·m, where it has none
DELAY_S = 0.02  # s
EFFORT_LIMIT_RATIO = 0.5  # of what holding still leaves of each effort limit
HOLDING_SAMPLE_S = 0.1  # s: at a reference, for what holding still takes
REFERENCES = ("line", "reverse", "spin", "circle", "eight", "waypoints", "ee-square")
INITIAL_ERROR = (0.1, -0.1, 0.1)  # m, m, rad

COLUMNS = (
    "rms_base", "final_base", "final_lateral", "rms_end_effector", "final_end_effector",
    "peak_effort", "rms_effort", "violations", "sample_time", "sample_time_99", "outcome",
)  # fmt: skip
MEASURES = {"rms_base": "base", "rms_end_effector": "end effector"}
TIE_RATIO = 1.01  # times the least error: as good, for all that a table shows


@dataclass(frozen=True)
class Scenario:
    """A disturbance or model error that a run is made with.

    Attributes:
        summary: What it is, in a line.
        change: Returns the configuration of a robot on a reference with it.
    """

    summary: str
    change: Callable[[Config, Robot, Reference], Config]


def _light_arm(config: Config, robot: Robot, reference: Reference) -> Config:
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm")
    for name in robot.joint_names:
        robot = scale_masses(robot, glob.escape(name), ARM_MASS_RATIO)
    return replace(config, plant=Plant(controller_model=robot))


def _wheel_bias(config: Config, robot: Robot, reference: Reference) -> Config:
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    for name, limit in zip(robot.actuators, robot.effort_limits, strict=True):
        if name in wheels:
            bias = BIAS_RATIO * float(limit) if np.isfinite(limit) else DEFAULT_BIAS_NM
            return replace(config, plant=Plant(tau_bias={name: bias}))
    raise RpctlError(f"{robot.name} has no driven wheel")


def _half_limits(config: Config, robot: Robot, reference: Reference) -> Config:
    """Halve what each effort limit exceeds the largest static effort of the reference by."""
    limits, holding = robot.effort_limits, _holding_efforts(robot, reference)
    left = limits - EFFORT_LIMIT_RATIO * np.maximum(limits - holding, 0.0)
    efforts = {
        glob.escape(name): float(limit)
        for name, limit in zip(robot.actuators, left, strict=True)
        if np.isfinite(limit)
    }
    return replace(config, limits=LimitOverrides(effort=efforts))


def _holding_efforts(robot: Robot, reference: Reference) -> Array:
    """Return the largest efforts (n_act,) that hold the robot still anywhere on a reference."""
    dynamics, times = (
        ReducedDynamics(robot),
        np.arange(0.0, default_duration(reference), HOLDING_SAMPLE_S),
    )
    places = [configuration_along(robot, reference(t)) for t in times.tolist()]
    efforts = [dynamics.efforts(q, dynamics.bias(q, np.zeros(robot.dof))) for q in places]
    return np.asarray(np.abs(efforts).max(axis=0))


def _with_plant(**settings: Any) -> Callable[[Config, Robot, Reference], Config]:
    return lambda config, robot, reference: replace(config, plant=Plant(**settings))


SCENARIOS = {
    "nominal": Scenario("the model is exact", _with_plant()),
    "arm-mass": Scenario(
        "the controller's model has 30 % less mass in each moving link of the arm",
        _light_arm,
    ),
    "wheel-bias": Scenario(
        "a constant effort on the first driven wheel, 5 % of its limit (1 N·m without a limit)",
        _wheel_bias,
    ),
    "delay": Scenario(
        "20 ms from a measurement to the efforts that answer it", _with_plant(delay=DELAY_S)
    ),
    "computing": Scenario(
        "computing takes the time measured here: efforts act later, samples are missed",
        _with_plant(computing_time="measured"),
    ),
    "half-limits": Scenario(
        "half of each effort limit above the effort to stand still; references are unchanged",
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
PROPOSED_LEANING = LawPair("unified", "balance")
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
    if robot.drive.leans:
        return PROPOSED_LEANING
    return PROPOSED if robot.joints else PROPOSED_ARMLESS


def controllers(
    laws: Sequence[str] = (), dynamic: str | None = None, robot: Robot | None = None
) -> list[LawPair]:
    """Return the controllers that are asked for.

    Args:
        laws: ``KINEMATIC+DYNAMIC``, or ``KINEMATIC`` alone: with ``dynamic``, else every pair of
            :data:`PAIRS` that has it. Nothing: all kinematic laws.
        dynamic: The dynamic law of kinematic laws that stand alone.
        robot: Whose; of one that leans, laws are those that balance it, which follow a wish alike
            or plan.

    Raises:
        UnknownNameError: There is no such law.
    """
    chosen: list[LawPair] = []
    if robot is not None and robot.drive.leans:
        laws, dynamic = laws or ("unified", "horizon"), dynamic or PROPOSED_LEANING.dynamic
    for name in laws or KINEMATIC_LAWS:
        kinematic, _, own = name.partition("+")
        read_law("kinematic", kinematic)
        wanted = own or dynamic
        if wanted is not None:
            read_law("dynamic", wanted)
            chosen.append(LawPair(kinematic, wanted))
        else:
            pairs = [pair for pair in LAW_PAIRS if pair.kinematic == kinematic]
            chosen += pairs or [LawPair(kinematic, "bounded")]
    order = {pair: place for place, pair in enumerate(LAW_PAIRS)}
    return sorted(dict.fromkeys(chosen), key=lambda pair: order.get(pair, len(LAW_PAIRS)))


@dataclass(frozen=True)
class CompareCell:
    """One run of the grid: a pair of laws on a reference in a scenario."""

    scenario: str
    controller: LawPair
    run: RunSettings

    def config(self, references: References) -> Config:
        """Return the run's configuration; see :class:`rpctl.study.cells.Cell`."""
        laws, reference = self.controller, references(self.run)
        config = Config(run=self.run).with_laws(laws.kinematic, laws.dynamic)
        return SCENARIOS[self.scenario].change(config, references.robot, reference)


CompareRow = Row[CompareCell]


def row_dict(row: CompareRow) -> dict[str, Any]:
    """Return a row as JSON says it."""
    cell, figures = row.cell, row.figures
    failed = figures.failure is not None
    return {
        "scenario": cell.scenario,
        "reference": cell.run.reference,
        "controller": str(cell.controller),
        "kinematic": cell.controller.kinematic,
        "dynamic": cell.controller.dynamic,
        "failure": figures.failure,
        **{name: None if failed else getattr(figures, name) for name in COLUMNS},
    }


def grid(
    robot: Robot,
    scenarios: Sequence[str],
    references: Sequence[str],
    controllers: Sequence[LawPair],
    run: RunSettings,
) -> list[CompareCell]:
    """Return all cells, scenario by scenario.

    Args:
        robot: The robot; one with a fixed base starts where it is.
        scenarios: Names of scenarios.
        references: Names or files of references.
        controllers: Pairs of a kinematic and a dynamic law.
        run: What all runs have in common; they end with the last whole control period.
    """
    if run.duration is not None:
        whole = whole_periods(run.duration, run.control_period) * run.control_period
        run = replace(run, duration=whole)
    if not robot.drive.base_speeds:
        run = replace(run, initial_error=(0.0, 0.0, 0.0))
    bare = replace(run, smooth=None, retime=False)  # of references that are no table
    runs = {
        name: replace(run if name.endswith(".csv") else bare, reference=name) for name in references
    }
    return [
        CompareCell(scenario, controller, runs[name])
        for scenario, name, controller in product(scenarios, references, controllers)
    ]


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


def group_rows(rows: Iterable[CompareRow]) -> dict[tuple[str, str], list[CompareRow]]:
    """Return the rows by scenario and reference, in order."""
    groups: dict[tuple[str, str], list[CompareRow]] = {}
    for row in rows:
        groups.setdefault((row.cell.scenario, row.cell.run.reference), []).append(row)
    return groups


def best(rows: Sequence[CompareRow], measure: str) -> tuple[float, LawPair] | None:
    """Return the least error of the controllers that work, and whose it is."""
    errors = _errors(rows, measure)
    return min(((error, by) for by, error in errors.items()), key=itemgetter(0), default=None)


def verdicts(rows: Sequence[CompareRow], proposed: LawPair) -> list[Verdict]:
    """Return the verdict on each scenario, reference and measure in which a controller works.

    Args:
        rows: Of a grid.
        proposed: The controller that rpctl proposes; none of the rows is its: no verdict.
    """
    found = []
    for (scenario, reference), group in group_rows(rows).items():
        for measure in MEASURES:
            least, errors = best(group, measure), _errors(group, measure)
            if least is not None and any(row.cell.controller == proposed for row in group):
                ours, paper = errors.get(proposed), errors.get(PAPER)
                found.append(Verdict(scenario, reference, measure, ours, paper, *least))
    return found


def _errors(rows: Sequence[CompareRow], measure: str) -> dict[LawPair, float]:
    figures = {row.cell.controller: row.figures for row in rows if row.figures.succeeded}
    errors = {by: getattr(each, measure) for by, each in figures.items()}
    return {by: error for by, error in errors.items() if error is not None}
