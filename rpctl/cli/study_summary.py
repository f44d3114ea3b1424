"""What ``rpctl study`` prints: success, quantiles, what matters, worst runs; settings found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from rpctl.cli.terminal import console, escape, new_table
from rpctl.study.sensitivity import Sensitivity
from rpctl.study.statistics import Interval, Quantile
from rpctl.study.study_result import StudyResult, replay_command

SHOWN = 5  # parameters that are named for a merit
MEASURES = {  # of a sensitivity: what is shown
    "sobol": {"first": "share of variance, alone", "total": "with interactions"},
    "morris": {"mu_star": "mean size of its change over the range"},
    "rank-correlation": {
        "rank_correlation": "rank correlation",
        "from_middle": "that of the distance from its median",
    },
}


def show_study(result: StudyResult) -> None:
    """Print what a study found."""
    out = console()
    out.print(f"[bold]{escape(result.robot)}[/]: {len(result.runs)} runs, {result.design.kind} "
              f"design of {len(result.scatter)} parameters, seed {result.design.seed}")  # fmt: skip
    style = "green" if result.success.value == 1.0 else "yellow"
    out.print(f"[{style}]success[/] {_percent(result.success)}   {_outcomes(result)}")
    out.print()
    _show_statistics(out, result)
    found = result.sensitivity_of(result.merit)
    if found is not None:
        out.print()
        _show_sensitivity(out, found)
    if result.worst:
        out.print()
        _show_worst(out, result)


def _outcomes(result: StudyResult) -> str:
    """Return how many runs ended how, where that is not one word for all."""
    counts = Counter(result.runs.outcomes)
    return ", ".join(f"{count} {escape(word)}" for word, count in counts.most_common())


def _show_statistics(out: Console, result: StudyResult) -> None:
    table = new_table("merit", ">mean", ">5 %", ">median", ">95 %", ">95 % lies within", ">worst",
                      ">without", "unit")  # fmt: skip
    for each in result.statistics:
        at = {found.level: found for found in each.quantiles}
        high = at[0.95]
        table.add_row(
            each.name,
            *(_number(x) for x in (each.mean.value, at[0.05].value, at[0.5].value, high.value)),
            _within(high),
            _number(each.largest),
            str(each.missing) if each.missing else "",
            result.units.get(each.name, ""),
            style="bold" if each.name == result.merit else "",
        )
    out.print(table)


def _show_sensitivity(out: Console, found: Sensitivity) -> None:
    shown = MEASURES[found.method]
    heads = [head for words in shown.values() for head in (f">{words}", ">95 % interval")]
    table = new_table(f"what matters to {found.merit}", *heads)
    for name in found.ranking[:SHOWN]:
        at = found.parameters.index(name)
        intervals = [found.measures[key][at] for key in shown]
        cells = [cell for each in intervals for cell in (_number(each.value), _within(each))]
        table.add_row(escape(name), *cells)
    out.print(table)


def _show_worst(out: Console, result: StudyResult) -> None:
    out.print(f"worst by {result.merit}:")
    for each in result.worst:
        value = f"{_number(each.value)} {result.units.get(result.merit, '')}".rstrip()
        out.print(f"  run {each.run}: {value}, {escape(each.outcome)}: {escape(each.reason)}")
        if each.command:
            out.print(f"    [dim]{escape(each.command)}[/]", soft_wrap=True)


def show_optimum(found: Mapping[str, Any], command: str) -> None:
    """Print what a search found.

    Args:
        found: What ``optimum.json`` holds.
        command: What tracks the robot.
    """
    out = console()
    table = new_table("setting", ">before", ">found", ">from", ">to")
    for name, each in found["settings"].items():
        numbers = (each["before"], each["after"], *each["range"])
        table.add_row(escape(name), *("-" if x is None else _number(x) for x in numbers))
    out.print(table)
    out.print()
    checked = found["validation"]
    statistic = found["statistic"]
    label = f"{100.0 * found['level']:g} % quantile" if statistic == "quantile" else statistic
    table = new_table(f"{checked['runs']} fresh runs", ">success", f">{label} of {found['merit']}",
                      ">95 % interval", ">cost")  # fmt: skip
    for name in ("before", "after"):
        each = checked[name]
        value = Interval(**each["statistic"])
        table.add_row(
            {"before": "as in the file", "after": "found"}[name],
            _percent(Interval(**each["success"])),
            _number(value.value),
            _within(value),
            _number(each["cost"]),
        )
    out.print(table)
    out.print(f"better in {_percent(Interval(**checked['better']))} of the runs, each with the "
              f"same scatter; {found['evaluations']} sets of settings were tried")  # fmt: skip
    if not checked["after"]["cost"] < checked["before"]["cost"]:
        out.print("[yellow]no better[/] on fresh runs: the search met too few to tell; give it "
                  "more runs, or keep the file's settings")  # fmt: skip
    config = Path(found["config"])
    out.print(f"wrote [bold]{escape(str(config))}[/]: "
              f"{escape(replay_command(command, config))}", soft_wrap=True)  # fmt: skip


def _percent(found: Interval) -> str:
    low, high = 100.0 * found.low, 100.0 * found.high
    return f"{100.0 * found.value:.4g} % ({low:.4g} to {high:.4g})"


def _within(found: Interval | Quantile) -> str:
    return f"{_number(found.low)} to {_number(found.high)}"


def _number(value: float) -> str:
    """Return four digits, or a dash where there is no number."""
    return "-" if math.isnan(value) else f"{value:.4g}"
