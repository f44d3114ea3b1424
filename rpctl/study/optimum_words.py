"""Whether the settings that a search found are better than the file's, in a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from rpctl.study.statistics import Interval
from rpctl.study.words import merit_unit, merit_words, number, unit_of

BETTER, WORSE, UNCLEAR = "better", "worse", "no clear difference"


class OptimumVerdict(NamedTuple):
    """Whether settings are :data:`BETTER`, :data:`WORSE`, or neither, and a sentence on it."""

    verdict: str
    text: str


def statistic_words(found: Mapping[str, Any]) -> str:
    """Return what a search made small, as ``95 % quantile of base error, rms``."""
    name = {"quantile": f"{100.0 * found['level']:g} % quantile", "worst": "largest"}
    return f"{name.get(found['statistic'], found['statistic'])} of {merit_words(found['merit'])}"


def optimum_sentence(found: Mapping[str, Any]) -> OptimumVerdict:
    """Return whether the settings found are better than the file's on fresh runs, and by how much.

    Args:
        found: What ``optimum.json`` holds.
    """
    checked = found["validation"]
    costs = [checked[name]["cost"] for name in ("before", "after")]
    before, after = (math.inf if each is None else float(each) for each in costs)
    kept = checked.get("change")  # none of a largest value, nor in files of older versions
    value = after - before if math.isfinite(before) or math.isfinite(after) else 0.0
    change = Interval(**kept) if kept else Interval(value, value, value)
    verdict = BETTER if change.high < 0.0 else WORSE if change.low > 0.0 else UNCLEAR
    unit = unit_of(merit_unit(found["merit"]), max(before, after))
    text = (
        f"{verdict}: {_cost_words(found)} goes from {number(before, unit)} to "
        f"{number(after, unit)} on {checked['runs']} fresh runs"
    )
    if before > 0.0 and math.isfinite(change.value):
        text += f", {_percent(change.value / before)}"
        if kept:
            low, high = (_percent(each / before) for each in (change.low, change.high))
            text += f" (95 % interval {low.removesuffix(' %')} to {high})"
    return OptimumVerdict(verdict, text)


def _cost_words(found: Mapping[str, Any]) -> str:
    """Return what the cost is: the statistic alone where no run failed."""
    checked = found["validation"]
    failed = any(checked[name]["success"]["value"] < 1.0 for name in ("before", "after"))
    weighted = found["failure_weight"] > 0.0 and failed
    return statistic_words(found) + (", with what failures cost," if weighted else "")


def _percent(share: float) -> str:
    """Return a relative change in per cent, with its sign."""
    return ("+" if share > 0.0 else "−" if share < 0.0 else "") + f"{100.0 * abs(share):.3g} %"
