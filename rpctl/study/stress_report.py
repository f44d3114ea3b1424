"""What a battery found: the verdict on each run, how far each law holds, the worst case of each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product, takewhile
from pathlib import Path
from typing import Any, NamedTuple

from rpctl.errors import RpctlError, listed
from rpctl.files.records import to_plain
from rpctl.simulation.config import write_config
from rpctl.simulation.merits.outcome import LATE, SUCCESSES
from rpctl.simulation.merits.path_error import length
from rpctl.study.cells import REFUSED, Figures, References, csv_text
from rpctl.study.compare import LawPair
from rpctl.study.stress_battery import LOCALISATION, RADIUS, Battery, Stress, StressCell

PASS, DEGRADE, FAIL = "pass", "degrade", "fail"
VERDICTS = (PASS, DEGRADE, FAIL)  # from good to bad; a run that was refused has none
TOLERANCE_RATIO = 0.01  # of the robot's length: how far from its reference a run that passes may be
MOST_TOLD = 3  # broken limits that a reason names; the figures have all
MAX_TILT = math.radians(10.0)  # rad: tyres and casters give way by less; a fall goes on beyond it
RIGID = "the supports are rigid and at the height in the file, so they carry the robot"
OTHERS = "the other contacts carry the robot"
COLUMNS = (
    "plant", "law", "stress", "level", "unit", "and_stress", "and_level", "and_unit", "seed",
    "verdict", "reason", "outcome", "time", "base_error", "end_effector_error", "violations",
    "tilt", "felt_ground",
)  # fmt: skip
ERRORS = {"base_error": "late_base", "end_effector_error": "late_end_effector"}  # in the files
FIGURES = (
    "outcome", "sentence", "time", "violations", "would_slip", "would_tip", "tilt", "felt_ground",
    "lifted_wheels", "hanging_wheels",
)  # fmt: skip


class StressVerdict(NamedTuple):
    """One of ``VERDICTS``, or ``"refused"``, and why, in words."""

    name: str
    reason: str


def error_text(error: float) -> str:
    """Return an error (m) in mm, in five characters at most; nothing where there is none."""
    millimetres = 1e3 * error
    if not math.isfinite(error):
        return ""
    if error >= 9.95:
        return f"{error:.0f} m" if error < 999.5 else "> km"
    if error >= 0.9995:
        return f"{error:.1f} m"
    digits = 2 if millimetres < 9.995 else 1 if millimetres < 99.95 else 0
    return f"{millimetres:.{digits}f}"


def rule(tolerance: float) -> str:
    """Return the rule in words.

    Args:
        tolerance: How far from its reference a run that passes may be, m.
    """
    return (
        f"{PASS}: tracked within all limits, base and end effector within {length(tolerance)} of "
        f"their references (rms of the second half). {DEGRADE}: tracked with a larger error, or "
        f"late, or the motion needs more grip than available. {FAIL}: stuck, diverging, collided, "
        "ended early, a limit broken, or tipped over."
    )


def judge(figures: Figures, tolerance: float) -> StressVerdict:
    """Return the verdict on a run by the rule."""
    if figures.outcome == REFUSED:
        return StressVerdict(REFUSED, figures.sentence)
    wheels = ""  # that bore nothing
    if figures.hanging_wheels:
        wheels = f"; {', '.join(figures.hanging_wheels)} carried no load from the start"
    elif figures.lifted_wheels:
        wheels = f"; {', '.join(figures.lifted_wheels)} lifted"
    fault = _fault(figures)
    if fault is not None:
        return StressVerdict(FAIL, fault + wheels)
    if figures.outcome == LATE:
        return StressVerdict(DEGRADE, f"late: {figures.sentence}{wheels}")
    if figures.would_slip:
        return StressVerdict(DEGRADE, "its wheels would slip")
    away = f"{length(figures.late_error)} from its reference"
    if figures.late_error <= tolerance:
        return StressVerdict(PASS, away)
    return StressVerdict(DEGRADE, away + wheels)


def _fault(figures: Figures) -> str | None:
    """Return why a run fails, in words; None if it does not."""
    if figures.outcome not in SUCCESSES:
        return f"{figures.outcome}: {figures.sentence}"
    if figures.tilt > MAX_TILT:
        return f"tipped over: it leaned {math.degrees(figures.tilt):.0f} degrees"
    if figures.would_tip:
        return "it would tip over"
    if figures.violations:
        return f"broke {listed(figures.violations, MOST_TOLD)}"
    return None if math.isfinite(figures.late_error) else "its error is not finite"


@dataclass(frozen=True)
class StressRow:
    """A cell, what became of it, and the verdict."""

    cell: StressCell
    figures: Figures
    verdict: StressVerdict

    def to_dict(self) -> dict[str, Any]:
        """Return the row as JSON says it."""
        cell, figures = self.cell, self.figures
        return {
            "plant": cell.plant,
            "law": str(cell.law),
            "levels": dict(cell.levels),
            "seed": cell.seed,
            "verdict": self.verdict.name,
            "reason": self.verdict.reason,
            **{name: getattr(figures, name) for name in FIGURES},
            **{name: getattr(figures, key) for name, key in ERRORS.items()},
        }


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
        """Return the row of one level of a ladder; without a ladder that of nothing stressed."""
        levels = () if stress is None or level == stress.nominal else ((stress.name, level),)
        return self._by_levels[plant, law, levels]

    @cached_property
    def _by_levels(self) -> Mapping[tuple[Any, ...], StressRow]:
        return {(row.cell.plant, row.cell.law, row.cell.levels): row for row in self.rows}

    def pairs(self) -> list[tuple[str, LawPair]]:
        """Return each plant with each pair of laws."""
        return list(product(self.battery.plants, self.battery.laws))

    def _rows_of(self, plant: str, law: LawPair) -> list[StressRow]:
        return [row for row in self.rows if (row.cell.plant, row.cell.law) == (plant, law)]

    def combined(self, plant: str, law: LawPair) -> list[StressRow]:
        """Return the rows with two stresses."""
        return [row for row in self._rows_of(plant, law) if len(row.cell.levels) > 1]

    def worst(self) -> list[StressRow]:
        """Return the worst row of each pair of laws on each plant: by its verdict, then its error.

        Those of which every run was refused have none.
        """
        ran = [
            [r for r in self._rows_of(*pair) if r.verdict.name != REFUSED] for pair in self.pairs()
        ]
        return [
            max(rows, key=lambda row: (VERDICTS.index(row.verdict.name), row.figures.late_error))
            for rows in ran
            if rows
        ]

    def reaches(self) -> list[dict[str, Any]]:
        """Return how far each law holds on each plant along each ladder, as JSON says it.

        ``passes`` are the first and last level up to which all pass, from the nominal one on
        without a break; None: that one does not. ``tracks``, likewise: up to which none fails.
        """
        return [
            {
                "plant": plant,
                "law": str(law),
                "stress": stress.name,
                "passes": self._reach(plant, law, stress, (PASS,)),
                "tracks": self._reach(plant, law, stress, (PASS, DEGRADE)),
            }
            for plant, law in self.pairs()
            for stress in self.battery.stresses_on(plant)
        ]

    def _reach(
        self, plant: str, law: LawPair, stress: Stress, good: Sequence[str]
    ) -> tuple[float, float] | None:
        """Return the ends of the stretch of good levels about the nominal one."""
        levels = stress.levels
        middle = levels.index(stress.nominal)

        def holds(level: float) -> bool:
            return self.row(plant, law, stress, level).verdict.name in good

        if not holds(stress.nominal):
            return None
        below = [*takewhile(holds, reversed(levels[:middle]))]
        above = [*takewhile(holds, levels[middle:])]
        return [stress.nominal, *below][-1], above[-1]

    def hanging(self, plant: str) -> list[str]:
        """Return where wheels hang in the air from the start, and why; a sentence a ladder."""
        hanging = {
            row.cell.levels: row.figures.hanging_wheels
            for row in self.rows
            if row.cell.plant == plant
        }
        always = hanging.get((), ())
        told = [f"nothing stressed: {', '.join(always)} carry no load: {OTHERS}"] if always else []
        for stress in self.battery.stresses_on(plant):
            wheels = {
                level: [n for n in hanging.get(((stress.name, level),), ()) if n not in always]
                for level in stress.levels
            }
            levels = [stress.text(level) for level, names in wheels.items() if names]
            if levels:
                named = dict.fromkeys(name for names in wheels.values() for name in names)
                where = f"{stress.name} {', '.join(levels)} {stress.unit}".rstrip()
                why = RIGID if stress.name == RADIUS else OTHERS
                told.append(f"{where}: {', '.join(named)} carry no load from the start: {why}")
        return told

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
            "run": to_plain(battery.run),
            "plants": list(battery.plants),
            "laws": list(map(str, battery.laws)),
            "stresses": [
                {key: getattr(x, key) for key in ("name", "unit", "levels", "nominal", "summary")}
                for x in battery.stresses
            ],
            "left_out": [
                {"plant": plant, "stress": stress, "reason": reason}
                for (plant, stress), reason in battery.left_out.items()
            ],
            "hanging": {plant: self.hanging(plant) for plant in battery.plants},
            "localisation": asdict(LOCALISATION),
            "cells": [row.to_dict() for row in self.rows],
            "envelope": self.reaches(),
        }


def report_of(battery: Battery, figures: Mapping[str, Figures], tolerance: float) -> StressReport:
    """Return the report of a battery whose runs have all ended.

    Args:
        battery: The battery.
        figures: By the key of the cell.
        tolerance: How far from its reference a run that passes may be, m.

    Raises:
        RpctlError: No run could be made.
    """
    rows = tuple(
        StressRow(cell, figures[cell.key], judge(figures[cell.key], tolerance))
        for cell in battery.cells
    )
    report = StressReport(battery, tolerance, rows)
    if not report.worst():
        raise RpctlError(f"none of the runs could start: {rows[0].verdict.reason}")
    return report


def report_csv(report: StressReport) -> str:
    """Return the rows of a report as CSV; errors in m, times in s, angles in rad."""
    units = {stress.name: stress.unit for stress in report.battery.stresses}
    rows = []
    for row in report.rows:
        cells = row.to_dict()
        for head, (name, level) in zip(("", "and_"), row.cell.levels, strict=False):
            cells |= {f"{head}stress": name, f"{head}level": level, f"{head}unit": units[name]}
        rows.append(cells)
    return csv_text(rows, COLUMNS)


def write_worst(report: StressReport, out: Path) -> list[Path]:
    """Write the configurations of the worst cases, in the place of any before.

    Args:
        report: The report.
        out: Its folder.

    Returns:
        The files, in the order of ``report.worst()``.
    """
    for left in out.glob("worst-*.toml"):
        left.unlink(missing_ok=True)
    references = References(report.battery.robot)
    return [
        write_config(row.cell.config(references), out / f"worst-{k}.toml")
        for k, row in enumerate(report.worst(), start=1)
    ]
