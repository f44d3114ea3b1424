"""What a battery found: its rows, how far each law holds, and the worst case of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from typing import Any

from rpctl.control.settings import to_table
from rpctl.study.scenarios import LawPair
from rpctl.study.stress.battery import Battery, StressCell
from rpctl.study.stress.hanging import hanging_told
from rpctl.study.stress.ladders import LOCALISATION, Stress
from rpctl.study.stress.verdict import (
    FAIL,
    PASS,
    REFUSED,
    VERDICTS,
    StressFigures,
    StressVerdict,
    judge,
    rule,
)


@dataclass(frozen=True)
class StressRow:
    """A cell, what became of it, and the verdict."""

    cell: StressCell
    figures: StressFigures
    verdict: StressVerdict

    @property
    def badness(self) -> tuple[int, float]:
        """What rows are compared by; larger is worse."""
        return VERDICTS.index(self.verdict.name), self.figures.error

    def to_dict(self) -> dict[str, Any]:
        """Return the row as JSON says it."""
        cell = self.cell
        return {
            "plant": cell.plant,
            "law": str(cell.law),
            "levels": dict(cell.levels),
            "seed": cell.seed,
            "verdict": self.verdict.name,
            "reason": self.verdict.reason,
            **self.figures.to_dict(),
        }


@dataclass(frozen=True)
class Reach:
    """How far a law holds along a ladder, from the nominal level on without a break.

    Attributes:
        plant: Kind of the plant.
        law: The laws.
        stress: Name of the stress.
        passes: First and last level of the ladder up to which all pass; None: the nominal one does
            not.
        tracks: Likewise of those that do not fail.
    """

    plant: str
    law: str
    stress: str
    passes: tuple[float, float] | None
    tracks: tuple[float, float] | None


@dataclass(frozen=True)
class StressReport:
    """All runs of a battery and the verdicts on them.

    Attributes:
        battery: The battery.
        tolerance: How far from its reference a run that passes may be, m.
        rows: In the order of the battery's cells.
    """

    battery: Battery
    tolerance: float
    rows: tuple[StressRow, ...]

    def row(
        self, plant: str, law: LawPair, stress: Stress | None = None, level: float = 0.0
    ) -> StressRow:
        """Return the row of one level of a ladder.

        Args:
            plant: Kind of the plant.
            law: The laws.
            stress: The ladder; None: nothing is stressed.
            level: The level.
        """
        nominal = stress is None or level == stress.nominal
        levels = () if nominal or stress is None else ((stress.name, level),)
        return self._by_cell[StressCell(plant, law, levels, self.battery.seed)]

    @cached_property
    def _by_cell(self) -> Mapping[StressCell, StressRow]:
        return {row.cell: row for row in self.rows}

    def pairs(self) -> list[tuple[str, LawPair]]:
        """Return each plant with each pair of laws."""
        return list(product(self.battery.plants, self.battery.laws))

    def combined(self, plant: str, law: LawPair) -> list[StressRow]:
        """Return the rows with two stresses.

        Args:
            plant: Kind of the plant.
            law: The laws.
        """
        of = [row for row in self.rows if (row.cell.plant, row.cell.law) == (plant, law)]
        return [row for row in of if len(row.cell.levels) > 1]

    def worst(self) -> list[StressRow]:
        """Return the worst row of each pair of laws on each plant: by its verdict, then its error.

        Those of which every run was refused have none.
        """
        found = []
        for plant, law in self.pairs():
            of = [row for row in self.rows if (row.cell.plant, row.cell.law) == (plant, law)]
            ran = [row for row in of if row.verdict.name != REFUSED]
            found += [max(ran, key=lambda row: row.badness)] if ran else []
        return found

    def reaches(self) -> list[Reach]:
        """Return how far each law holds on each plant along each ladder."""
        return [
            Reach(
                plant,
                str(law),
                stress.name,
                self._reach(plant, law, stress, (PASS,)),
                self._reach(plant, law, stress, VERDICTS[: VERDICTS.index(FAIL)]),
            )
            for plant, law in self.pairs()
            for stress in self.battery.stresses_on(plant)
        ]

    def _reach(
        self, plant: str, law: LawPair, stress: Stress, good: Sequence[str]
    ) -> tuple[float, float] | None:
        """Return the ends of the stretch of good levels about the nominal one."""
        levels = stress.levels
        middle = levels.index(stress.nominal)
        holds = [self.row(plant, law, stress, each).verdict.name in good for each in levels]
        if not holds[middle]:
            return None
        first = last = middle
        while first > 0 and holds[first - 1]:
            first -= 1
        while last + 1 < len(levels) and holds[last + 1]:
            last += 1
        return levels[first], levels[last]

    def hanging(self, plant: str) -> list[str]:
        """Return where wheels hang in the air from the start, and why; a sentence a ladder.

        Args:
            plant: Kind of the plant.
        """
        runs = [(row.cell, row.figures) for row in self.rows if row.cell.plant == plant]
        return hanging_told(runs, self.battery.stresses_on(plant))

    @property
    def nominal_failure(self) -> StressRow | None:
        """The first run of the first laws that fails, or is refused, with nothing stressed."""
        rows = (self.row(plant, self.battery.laws[0]) for plant in self.battery.plants)
        return next((row for row in rows if row.verdict.name in (FAIL, REFUSED)), None)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON says it."""
        battery = self.battery
        return {
            "robot": battery.robot.name,
            "rule": rule(self.tolerance),
            "tolerance": self.tolerance,
            "seed": battery.seed,
            "run": to_table(battery.run),
            "plants": list(battery.plants),
            "laws": list(map(str, battery.laws)),
            "stresses": [_stress_dict(each) for each in battery.stresses],
            "left_out": [
                {"plant": plant, "stress": stress, "reason": reason}
                for (plant, stress), reason in battery.left_out.items()
            ],
            "hanging": {plant: self.hanging(plant) for plant in battery.plants},
            "localisation": asdict(LOCALISATION),
            "cells": [row.to_dict() for row in self.rows],
            "envelope": [asdict(each) for each in self.reaches()],
        }


def _stress_dict(stress: Stress) -> dict[str, Any]:
    names = ("name", "unit", "levels", "nominal", "summary")
    return {name: getattr(stress, name) for name in names}


def report_of(
    battery: Battery, figures: Mapping[str, StressFigures], tolerance: float
) -> StressReport:
    """Return the report of a battery whose runs have all ended.

    Args:
        battery: The battery.
        figures: By the key of the cell.
        tolerance: How far from its reference a run that passes may be, m.
    """
    rows = (
        StressRow(cell, figures[cell.key], judge(figures[cell.key], tolerance))
        for cell in battery.cells
    )
    return StressReport(battery, tolerance, tuple(rows))
