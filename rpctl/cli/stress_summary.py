"""What ``rpctl stress`` prints: a table a plant, the worst cases, and how to replay them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from rich.console import Console
from rich.table import Table

from rpctl.cli.terminal import console, escape, new_table
from rpctl.study.compare import LawPair
from rpctl.study.stress_battery import REFUSED
from rpctl.study.stress_report import (
    DEGRADE,
    FAIL,
    PASS,
    VERDICTS,
    StressReport,
    StressRow,
    error_text,
    rule,
)
from rpctl.study.study_result import replay_command

WIDTH = 100  # characters
WHY_WIDTH = 40  # characters of a line that says why
MARKS = {PASS: "✓", DEGRADE: "~", FAIL: "✗", REFUSED: "-"}
STYLES = {PASS: "green", DEGRADE: "yellow", FAIL: "bold red", REFUSED: "dim"}


def show_stress(report: StressReport, worst: Sequence[Path], command: str) -> None:
    """Print what a battery found.

    Args:
        report: It.
        worst: Configurations of the worst cases, in the report's order.
        command: What tracks the robot.
    """
    out = console()
    out.width = min(out.width, WIDTH)
    battery = report.battery
    out.print(f"[bold]{escape(battery.robot.name)}[/]: {len(report.rows)} runs of "
              f"{battery.run.duration:g} s on {escape(battery.run.reference)}, "
              f"seed {battery.seed}; errors in mm, base's or end effector's")  # fmt: skip
    out.print(f"[dim]{escape(rule(report.tolerance))}[/]")
    for plant in battery.plants:
        out.print()
        out.print(_table(report, plant))
        _show_left_out(out, report, plant)
    out.print()
    _show_worst(out, report, worst, command)
    failure = report.nominal_failure
    if failure is not None:
        out.print(f"[bold red]{escape(str(failure.cell))}[/]: {escape(failure.verdict.reason)}")


def _table(report: StressReport, plant: str) -> Table:
    """Return the ladders of one plant: a block a stress, a line a pair of laws."""
    battery = report.battery
    stresses = battery.stresses_on(plant)
    most = max((len(stress.levels) for stress in stresses), default=1)
    table = new_table(f"[bold]{plant}[/]", *[">"] * most)
    table.padding = (0, 1, 0, 0)
    for stress in stresses:
        label = f"{stress.name} {stress.unit}".rstrip()
        table.add_row(f"[dim]{label}[/]", *(f"[dim]{stress.text(x)}  [/]" for x in stress.levels))
        for law in battery.laws:
            rows = [report.row(plant, law, stress, level) for level in stress.levels]
            table.add_row(f"  {law}", *map(cell_text, rows))
    if battery.combinations and len(stresses) > 1:
        table.add_row("[dim]two at once[/]", *(f"[dim]{name}  [/]" for name in VERDICTS[:most]))
        for law in battery.laws:
            table.add_row(f"  {law}", *_counts(report, plant, law)[:most])
    return table


def _counts(report: StressReport, plant: str, law: LawPair) -> list[str]:
    found = Counter(row.verdict.name for row in report.combined(plant, law))
    return [f"[{STYLES[name]}]{found[name]} {MARKS[name]}[/]" for name in VERDICTS]


def cell_text(row: StressRow) -> str:
    """Return the verdict on a run and its error in mm, as markup: ``3.1 ✓``."""
    name = row.verdict.name
    return f"[{STYLES[name]}]{f'{error_text(row.figures.error)} {MARKS[name]}'.strip()}[/]"


def _show_left_out(out: Console, report: StressReport, plant: str) -> None:
    """Print what a plant leaves out, where wheels hang, and why runs were refused.

    What is alike is told once.

    Args:
        out: Where to print.
        report: Of the battery.
        plant: Kind of the plant.
    """
    left = [
        f"{stress} ({reason})"
        for (of, stress), reason in report.battery.left_out.items()
        if of == plant
    ]
    if left:
        out.print(f"[dim]left out: {escape(', '.join(left))}[/]")
    for sentence in report.hanging(plant):
        out.print(f"[yellow]{escape(sentence)}[/]")
    refused = (r for r in report.rows if r.cell.plant == plant and r.verdict.name == REFUSED)
    for law, reason in dict.fromkeys((str(row.cell.law), row.verdict.reason) for row in refused):
        out.print(f"[dim]{law}: did not run: {escape(reason)}[/]")


def _show_worst(out: Console, report: StressReport, worst: Sequence[Path], command: str) -> None:
    """Print the worst case of each pair of laws on each plant, and how to replay one.

    Args:
        out: Where to print.
        report: Of the battery.
        worst: Configurations.
        command: What tracks the robot.
    """
    table = new_table("worst case", "plant", "law", "", "stressed", "why")
    table.columns[-1].max_width = WHY_WIDTH
    for row, path in zip(report.worst(), worst, strict=True):
        name = row.verdict.name
        table.add_row(
            path.name,
            row.cell.plant,
            str(row.cell.law),
            f"[{STYLES[name]}]{name}[/]",
            row.cell.words,
            escape(row.verdict.reason),
        )
    out.print(table)
    path = worst[0]
    replay = f"{replay_command(command, path)}; rpctl view {quote(str(path.with_suffix('')))}"
    out.print("replay one, and look at it:")
    out.print(f"  [bold]{escape(replay)}[/]", soft_wrap=True)
    out.print(f"wrote [bold]{escape(str(path.parent))}[/]: stress.json, stress.csv, envelope.png "
              f"and {len(worst)} worst cases")  # fmt: skip
