"""The page of a battery: how far each law holds, every run's outcome, and the worst to replay."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from rpctl.simulation.merits.path_error import length
from rpctl.study.cells import REFUSED
from rpctl.study.stress_battery import Stress
from rpctl.study.stress_report import VERDICTS, StressReport, StressRow, rule
from rpctl.view.labels import capital
from rpctl.view.pages.page import render_page
from rpctl.view.plots.figures import svg_address
from rpctl.view.plots.stress import stress_figure

STYLES = ("report.css", "study.css")


def stress_page(report: StressReport, commands: Sequence[tuple[str, str]]) -> bytes:
    """Return the page of a battery.

    Args:
        report: Of the battery.
        commands: The file of each worst case, beside the page, and the command that replays it; in
            the report's order.
    """
    battery = report.battery
    counts = Counter(row.verdict.name for row in report.rows)
    return render_page(
        "stress.html",
        title=f"{battery.robot.name}: stress · rpctl",
        styles=STYLES,
        name=battery.robot.name,
        subtitle=f"{len(report.rows)} runs of {battery.run.duration:g} s on "
        f"{battery.run.reference}, seed {battery.seed}",
        counts=[(name, counts[name]) for name in (*VERDICTS, REFUSED) if counts[name]],
        rule=rule(report.tolerance),
        picture=svg_address(stress_figure(report)),
        worst=[
            (row.cell, row.verdict, *files)
            for row, files in zip(report.worst(), commands, strict=True)
        ],
        plants=[
            {
                "name": plant,
                "ladders": list(_ladders(report, plant)),
                "notes": [
                    *(f"Left out: {stress}, {reason}"
                      for (of, stress), reason in battery.left_out.items() if of == plant),
                    *map(capital, report.hanging(plant)),
                ],
            }
            for plant in battery.plants
        ],
    ).encode("utf-8", "backslashreplace")  # fmt: skip


def _ladders(report: StressReport, plant: str) -> Iterator[dict[str, Any]]:
    """Yield what is shown of each stress on a plant, and of two at once."""
    battery, reaches = report.battery, report.reaches()
    for stress in battery.stresses_on(plant):
        found = [x for x in reaches if (x["plant"], x["stress"]) == (plant, stress.name)]
        yield {
            "title": capital(stress.name),
            "about": stress.summary,
            "reach": [(each["law"], _reach(each, stress)) for each in found],
            "rows": [
                (
                    f"{stress.text(level)} {stress.unit}".rstrip(),
                    *_row(report.row(plant, law, stress, level)),
                )
                for level in stress.levels
                for law in battery.laws
            ],
        }
    rows = [row for law in battery.laws for row in report.combined(plant, law)]
    if rows:
        counts = Counter((str(row.cell.law), row.verdict.name) for row in rows)
        yield {
            "title": "Two at once",
            "about": "",
            "reach": [(law, f"{count} {name}") for (law, name), count in counts.items()],
            "rows": [(row.cell.words, *_row(row)) for row in rows],
        }


def _reach(reach: dict[str, Any], stress: Stress) -> str:
    """Return from which to which level a law passes, and tracks, in words."""
    told = [
        f"{word} {' to '.join(map(stress.text, dict.fromkeys(reach[word] or ()))) or 'nowhere'}"
        for word in ("passes", "tracks")
    ]
    return ", ".join(told if reach["passes"] != reach["tracks"] else told[:1])


def _row(row: StressRow) -> tuple[str, str, str, str, str]:
    """Return law, verdict, outcome, error, and why."""
    error, outcome = row.figures.late_error, row.figures.outcome
    return (
        str(row.cell.law),
        row.verdict.name,
        "did not run" if outcome == REFUSED else outcome,
        length(error) if math.isfinite(error) else "–",
        row.verdict.reason,
    )
