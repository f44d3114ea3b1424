"""The region of attraction: from which starts a law brings a robot to its reference."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import default_laws
from rpctl.control.registry import dynamic_by_name, kinematic_by_name
from rpctl.errors import DivergedError, RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.outcome import DIVERGING, ON_PATH_M, SUCCESSES
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.run.run import Run
from rpctl.study.cells import References

REACH_M = 1.5  # m: starts lie within this square about the reference's own
PERIOD = 0.01  # s: of control and integration; coarse, for many runs
LOG_EVERY = 5  # samples
HEADINGS = 8  # of the starts at one place; 4 where there are few starts
FEW_STARTS = 32
DURATION = 40.0  # s, of each run

Error = tuple[float, float, float]  # x1, x2 (m), x3 (rad) at the start


class Start(NamedTuple):
    """A start of a robot: with which law, on which reference, with which tracking error."""

    kinematic: str
    reference: str
    error: Error


@dataclass(frozen=True)
class Ending:
    """What became of a start.

    Attributes:
        start: The start.
        outcome: A word of ``simulation/merits/outcome.py``; None where the run was refused.
        error: P's distance from its reference at the end, m; None where there is no end.
        settled_at: Since when that distance is below 5 cm, s; None where it is not.
        violations: The limits of the URDF that were broken, each as ``JOINT KIND``.
        sentence: Why, in words.
    """

    start: Start
    outcome: str | None
    error: float | None
    settled_at: float | None
    violations: tuple[str, ...]
    sentence: str

    @property
    def converged(self) -> bool:
        """Whether the robot came to its reference within the limits."""
        return self.settled_at is not None and not self.failed

    @property
    def failed(self) -> bool:
        """Whether the run's outcome says that it did not: ``track`` ends with exit code 1."""
        return self.outcome not in SUCCESSES or bool(self.violations)

    def to_dict(self) -> dict[str, Any]:
        """Return the ending as JSON says it."""
        return {
            "kinematic": self.start.kinematic,
            "reference": self.start.reference,
            "initial_error": list(self.start.error),
            "outcome": self.outcome,
            "error": self.error,
            "settled_at": self.settled_at,
            "violations": list(self.violations),
            "sentence": self.sentence,
            "converged": self.converged,
        }


class Placement(NamedTuple):
    """Where a robot starts, seen from its reference: ahead and to the left of it (m), turned."""

    x: float
    y: float
    heading: float  # rad, to the left

    def error(self) -> Error:
        """Return the tracking error: the reference seen from the robot."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return -cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.heading


def placement(error: Error) -> Placement:
    """Return where a robot with a tracking error stands; the inverse of ``Placement.error``."""
    x1, x2, x3 = error
    cos, sin = math.cos(x3), math.sin(x3)
    return Placement(-cos * x1 - sin * x2, sin * x1 - cos * x2, -x3)


def start_errors(count: int) -> list[Error]:
    """Return about ``count`` errors on a grid: places in a square, and headings all round.

    Args:
        count: How many are wanted; the nearest number that fills a grid is taken.
    """
    headings = HEADINGS if count >= FEW_STARTS else HEADINGS // 2
    side = max(2, round(math.sqrt(count / headings)))
    places = np.linspace(-REACH_M, REACH_M, side).tolist()
    turns = (2.0 * math.pi * np.arange(headings) / headings - math.pi).tolist()
    return [Placement(x, y, turn).error() for y in places for x in places for turn in turns]


@dataclass(frozen=True)
class Attraction:
    """Runs starts of one robot, with coarse samples.

    Attributes:
        robot: The robot.
        dynamic: Name of the dynamic law; None: the robot's default.
        duration: Of each run, s.
        period: Of control and integration, s.
    """

    robot: Robot
    dynamic: str | None = None
    duration: float = DURATION
    period: float = PERIOD

    @cached_property
    def _references(self) -> References:
        return References(self.robot)

    def __call__(self, start: Start) -> Ending:
        """Return what became of a start; what keeps it from running is said."""
        try:
            return self._ending(start, self._run(start))
        except DivergedError as error:
            return Ending(start, DIVERGING, None, None, (), str(error))
        except RpctlError as error:
            return Ending(start, None, None, None, (), str(error))

    def _run(self, start: Start) -> Run:
        dynamic = default_laws(self.robot)[1]
        config = Config(
            kinematic=kinematic_by_name(start.kinematic),
            dynamic=dynamic if self.dynamic is None else dynamic_by_name(self.dynamic),
            run=RunSettings(
                reference=start.reference,
                duration=self.duration,
                initial_error=start.error,
                control_period=self.period,
                plant_step=self.period,
                log_every=LOG_EVERY,
            ),
        )
        return simulate(self.robot, config, self._references(config.run))

    def _ending(self, start: Start, run: Run) -> Ending:
        summary = summarize(run)
        away = np.hypot(*(run.log.e[:, :2]).T)
        return Ending(
            start,
            summary.outcome,
            summary.final_base_error,
            _settled_at(run.t, away),
            tuple(f"{each.joint} {each.limit}" for each in summary.limits_violated),
            summary.outcome_sentence,
        )


def _settled_at(t: Array, away: Array) -> float | None:
    """Return since when the distance from the reference stays below 5 cm; None if it does not."""
    far = np.flatnonzero(~(away <= ON_PATH_M))
    if not len(far):
        return float(t[0])
    return None if far[-1] == len(t) - 1 else float(t[far[-1] + 1])


class Fraction(NamedTuple):
    """How many of a law's starts on a reference converged, diverged or were refused."""

    kinematic: str
    reference: str
    starts: int
    converged: int
    failed: int
    refused: int
    slowest: float | None  # s, of those that converged

    @property
    def undecided(self) -> int:
        """How many were still coming nearer when their run ended."""
        return self.starts - self.converged - self.failed


def fractions(endings: Iterable[Ending]) -> list[Fraction]:
    """Return the figures of each law on each reference, in the order of the endings."""
    groups: dict[tuple[str, str], list[Ending]] = {}
    for ending in endings:
        groups.setdefault((ending.start.kinematic, ending.start.reference), []).append(ending)
    return [_fraction(*key, group) for key, group in groups.items()]


def _fraction(kinematic: str, reference: str, group: Sequence[Ending]) -> Fraction:
    settled = [each.settled_at for each in group if each.converged and each.settled_at is not None]
    return Fraction(
        kinematic,
        reference,
        len(group),
        len(settled),
        sum(each.failed for each in group),
        sum(each.outcome is None for each in group),
        max(settled, default=None),
    )
