"""The region of attraction: from which starts a law brings a robot to its reference."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rpctl.control.controller import default_laws
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.merits.outcome import DIVERGING, SLIPS, SUCCESSES, TIPS
from rpctl.study.cells import REFUSED, Figures, References, Row

REACH_M = 1.5  # m: starts lie within this square about the reference's own
HEADINGS = 8  # of the starts at one place; 4 where there are few starts
FEW_STARTS = 32
DURATION = 40.0  # s, of each run
RUN = RunSettings(duration=DURATION, control_period=0.01, plant_step=0.01, log_every=5)  # coarse

Error = tuple[float, float, float]  # x1, x2 (m), x3 (rad) at the start


@dataclass(frozen=True)
class Start:
    """A start of a robot: with which laws (None: its own dynamic one), and in which run."""

    kinematic: str
    dynamic: str | None
    run: RunSettings

    def config(self, references: References) -> Config:
        """Return the run's configuration; see :class:`rpctl.study.cells.Cell`."""
        own = Config(*default_laws(references.robot), self.run)
        return own.with_laws(self.kinematic, self.dynamic)


def converged(figures: Figures) -> bool:
    """Return whether the robot came to its reference within the limits."""
    return figures.settled_at is not None and not failed(figures)


def failed(figures: Figures) -> bool:
    """Return whether a robot went away from its reference, or beyond a limit.

    A far start may ask for more than the grip at first: whether laws come home is asked here of
    wheels that roll.
    """
    return figures.outcome not in (*SUCCESSES, SLIPS, TIPS) or bool(figures.violations)


def row_dict(row: Row[Start]) -> dict[str, Any]:
    """Return what became of a start as JSON says it."""
    figures, run = row.figures, row.cell.run
    outcome = figures.outcome if figures.failure is None else DIVERGING
    return {
        "kinematic": row.cell.kinematic,
        "reference": run.reference,
        "initial_error": list(run.initial_error),
        "outcome": None if figures.outcome == REFUSED else outcome,
        "error": figures.final_base,
        "settled_at": figures.settled_at,
        "violations": list(figures.violations),
        "sentence": figures.sentence,
        "converged": converged(figures),
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
    """Return where a robot with a tracking error stands: each is seen alike from the other."""
    return Placement(*Placement(*error).error())


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


def fractions(rows: Iterable[Row[Start]]) -> list[Fraction]:
    """Return the figures of each law on each reference, in the order of the rows."""
    groups: dict[tuple[str, str], list[Figures]] = {}
    for row in rows:
        groups.setdefault((row.cell.kinematic, row.cell.run.reference), []).append(row.figures)
    return [
        Fraction(
            *law_and_reference,
            starts=len(group),
            converged=sum(map(converged, group)),
            failed=sum(map(failed, group)),
            refused=sum(each.outcome == REFUSED for each in group),
            slowest=max(
                (each.settled_at or 0.0 for each in group if converged(each)), default=None
            ),
        )
        for law_and_reference, group in groups.items()
    ]
