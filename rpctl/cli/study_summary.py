"""What ``rpctl study`` prints: success, quantiles, what matters, worst runs; settings found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from rpctl.cli.terminal import console, escape, new_table
from rpctl.study.optimise import BETTER, optimum_sentence, statistic_words
from rpctl.study.sensitivity import Sensitivity, importances
from rpctl.study.statistics import Interval
from rpctl.study.study_result import StudyResult, replay_command
from rpctl.study.words import (
    Unit,
    grouped,
    merit_unit,
    merit_words,
    number,
    parameter_words,
    percent,
    share_span,
    unit_of,
)

SHOWN = 5  # parameters that are named for a merit
MEASURES = {  # of a sensitivity: what is shown
    "sobol": "share of variance",
    "morris": "mean change",
    "rank-correlation": "rank correlation",
}
NAME_WIDTH = 40  # characters of a parameter's name in one line


def show_study(result: StudyResult) -> None:
    """Print what a study found."""
    out = console()
    out.print(f"[bold]{escape(result.robot)}[/]: {grouped(len(result.runs))} runs, "
              f"{result.design.kind} design of {len(result.scatter)} parameters, "
              f"seed {result.design.seed}")  # fmt: skip
    style = "green" if result.success.value == 1.0 else "yellow"
    success = f"{percent(result.success.value)} (95 % interval {share_span(result.success)})"
    out.print(f"[{style}]success[/] {success}   {_outcomes(result)}")
    out.print()
    _show_statistics(out, result)
    found = result.sensitivity_of(result.merit)
    if found is not None:
        out.print()
        _show_sensitivity(out, result, found)
    if result.worst:
        out.print()
        _show_worst(out, result)


def _outcomes(result: StudyResult) -> str:
    """Return how many runs ended how, where that is not one word for all."""
    counts = Counter(result.runs.outcomes)
    return ", ".join(f"{grouped(count)} {escape(word)}" for word, count in counts.most_common())


def _show_statistics(out: Console, result: StudyResult) -> None:
    table = new_table("merit", ">median", ">5 to 95 % of runs", ">worst", "unit")
    for each in result.statistics:
        at = {found.level: found.value for found in each.quantiles}
        unit = unit_of(result.units.get(each.name, ""), each.largest)
        table.add_row(
            merit_words(each.name),
            number(at[0.5], Unit(unit.factor, "")),
            _span(at[0.05], at[0.95], unit.factor),
            number(math.inf if each.missing else each.largest, Unit(unit.factor, "")),
            unit.name,
            style="bold" if each.name == result.merit else "",
        )
    out.print(table)
    if any(each.missing for each in result.statistics):
        out.print("[dim]∞: of runs without the merit, as one that was not simulated to its end[/]")


def _show_sensitivity(out: Console, result: StudyResult, found: Sensitivity) -> None:
    bars, unit = importances(found, SHOWN), Unit(1.0, "")
    if found.method == "morris":
        unit = unit_of(result.units.get(found.merit, ""), max(abs(each.value) for each in bars))
    head = MEASURES[found.method] + (f" ({unit.name})" if unit.name else "")
    told = found.method == "rank-correlation"
    table = new_table(f"what matters to {merit_words(found.merit)}", f">{head}", ">95 % interval",
                      *["way"] * told)  # fmt: skip
    table.columns[0].max_width = NAME_WIDTH
    for each in bars:
        value = number(each.value, Unit(unit.factor, ""))
        table.add_row(
            escape(parameter_words(each.name).name),
            value,
            _span(each.low, each.high, unit.factor),
            *[each.way] * told,
        )
    out.print(table)


def _show_worst(out: Console, result: StudyResult) -> None:
    out.print(f"worst by {merit_words(result.merit)}:")
    unit = unit_of(result.units.get(result.merit, ""), max(each.value for each in result.worst))
    for each in result.worst:
        value = number(each.value, unit)
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
    table = new_table("setting", ">in the file", ">found", ">range", "unit")
    for name, each in found["settings"].items():
        before = "–" if each["before"] is None else number(each["before"])
        table.add_row(
            escape(parameter_words(name).name), before, number(each["after"]),
            _span(*each["range"]), parameter_words(name).unit,
        )  # fmt: skip
    out.print(table)
    out.print()
    checked = found["validation"]
    table = new_table(f"{checked['runs']} fresh runs", ">success", f">{statistic_words(found)}",
                      ">95 % interval")  # fmt: skip
    unit = unit_of(merit_unit(found["merit"]), checked["before"]["statistic"]["value"])
    for name, words in (("before", "as in the file"), ("after", "found")):
        each = checked[name]
        value = Interval(**each["statistic"])
        success = percent(each["success"]["value"])
        table.add_row(words, success, number(value.value, unit),
                      _span(value.low, value.high, unit.factor))  # fmt: skip
    out.print(table)
    out.print()
    judged = optimum_sentence(found)
    style = {BETTER: "green"}.get(judged.verdict, "yellow")
    sentence = judged.text.removeprefix(judged.verdict)
    out.print(f"[{style}]{judged.verdict}[/]{escape(sentence)}", soft_wrap=True)
    share = Interval(**checked["better"])
    out.print(f"smaller in {percent(share.value)} of the runs ({share_span(share)}), each with the "
              f"same scatter; {found['evaluations']} sets of settings were tried")  # fmt: skip
    if judged.verdict != BETTER:
        out.print("the search met too few runs to tell: give it more, or keep the file's settings")
    config = Path(found["config"])
    kind = "the settings found" if judged.verdict == BETTER else "what was found"
    out.print(f"use {kind}: [bold]{escape(replay_command(command, config))}[/]", soft_wrap=True)


def _span(low: float, high: float, factor: float = 1.0) -> str:
    unit = Unit(factor, "")
    return f"{number(low, unit)} to {number(high, unit)}"
