"""The rows of a battery's report as CSV."""

from __future__ import annotations

import csv
import io
from typing import Any

from rpctl.simulation.table import FORMULA
from rpctl.study.stress.report import StressReport, StressRow

COLUMNS = (
    "plant", "law", "stress", "level", "unit", "and_stress", "and_level", "and_unit", "seed",
    "verdict", "reason", "outcome", "time", "base_error", "end_effector_error", "violations",
    "tilt", "felt_ground",
)  # fmt: skip


def report_csv(report: StressReport) -> str:
    """Return the rows of a report as CSV; errors in m, times in s, angles in rad."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    units = {stress.name: stress.unit for stress in report.battery.stresses}
    for row in report.rows:
        cells = {**row.to_dict(), **_levels(row, units)}
        cells["violations"] = "; ".join(row.figures.violations)
        writer.writerow({name: _literal(cells.get(name)) for name in COLUMNS})
    return text.getvalue()


def _levels(row: StressRow, units: dict[str, str]) -> dict[str, Any]:
    """Return the stresses of a row as cells: the first, and the second that is there besides."""
    found: dict[str, Any] = {}
    for head, (name, level) in zip(("", "and_"), row.cell.levels, strict=False):
        found |= {f"{head}stress": name, f"{head}level": level, f"{head}unit": units[name]}
    return found


def _literal(cell: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell
