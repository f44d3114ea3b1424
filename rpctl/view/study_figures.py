"""The figures of a study, described once: its page and its picture both draw these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.study.sensitivity import EITHER_SIDE, Importance, ParameterMap, Sensitivity, importances
from rpctl.study.statistics import LEVELS, envelope
from rpctl.study.study_result import StudyResult
from rpctl.study.words import Unit, merit_words, number, parameter_words, unit_of
from rpctl.view.still_chart import Axis, Cells, Mark, StillChart, axis_over

BINS = 32  # of a distribution
SAME = 1e-3  # of the largest value: a smaller spread is not drawn
METHODS = {
    "sobol": "Share of the variance that a parameter causes, with all that it acts together with "
    "(total Sobol index), and its 95 % interval.",
    "morris": "Mean size of the change over a parameter's range (μ* of Morris), and its 95 % "
    "interval.",
    "rank-correlation": "Rank correlation of a parameter, or of its distance from its median where "
    "that is larger, with the merit, and its 95 % interval: 1 if the merit grows wherever it does, "
    "−1 if it falls.",
}

MEASURES = {
    "sobol": "share of the variance, with interactions (total Sobol index)",
    "morris": "mean size of the change over the range (μ* of Morris)",
    "rank-correlation": "rank correlation",
}


def _largest(values: Array) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def envelope_charts(result: StudyResult) -> list[StillChart]:
    """Return how the errors spread over time: the median, half of the runs, and nine in ten."""
    t = result.runs.t
    charts = []
    for name, series in result.runs.series.items():
        if name == "lateral_error" or len(t) < 2:
            continue
        quantiles = envelope(np.asarray(series, float), LEVELS)
        unit = unit_of(result.units.get(name, "") or "m", _largest(quantiles))
        values = unit.factor * quantiles
        marks = (
            Mark(t, values[4], "base", values[0], opacity=0.18, label="5 to 95 %"),
            Mark(t, values[3], "base", values[1], opacity=0.38, label="25 to 75 %"),
            Mark(t, values[2], "base", label="median"),
        )
        words = name.replace("_", " ")
        summary = f"{words} over time: median, half of the runs, and nine in ten"
        time = Axis(float(t[0]), float(t[-1]), "time (s)")
        error = axis_over(values, f"error ({unit.name})")
        charts.append(StillChart(words, time, error, marks, summary=summary))
    return charts


def distribution_chart(
    merit: str, values: Array, good: NDArray[np.bool_], unit_name: str
) -> StillChart | str:
    """Return how a merit is distributed, or a sentence where there is nothing to draw.

    Args:
        merit: Its name.
        values: Of each run (N,); what is not finite is left out.
        good: Which runs (N,) succeeded: they are below, the others on top of them.
        unit_name: Of the merit.
    """
    known = np.isfinite(values)
    if not known.any():
        return "No run has it."
    unit = unit_of(unit_name, _largest(values))
    inside, good = unit.factor * values[known], good[known]
    if np.ptp(inside) <= SAME * np.abs(inside).max():
        only = number(float(inside[0]), Unit(1.0, unit.name))
        return f"{only} in {known.sum()} of {len(known)} runs"
    x = axis_over(inside, unit.name, zero=False)
    shares = np.linspace(0.0, 1.0, BINS + 1)
    edges = x.value(shares)
    counts = np.histogram(x.at(inside), shares)[0]
    good_counts = np.histogram(x.at(inside[good]), shares)[0]
    y = Axis(0.0, 1.05 * float(counts.max()), "runs")
    middle = float(np.median(inside))
    marks = (
        Mark(edges, good_counts, "base", np.zeros(BINS), opacity=0.75, label="succeeded"),
        Mark(edges, counts, "tip", good_counts, label="did not"),
        Mark(np.full(2, middle), np.array([0.0, y.high]), "ink", width=1.2, dashed=True,
             label="median"),
    )  # fmt: skip
    summary = f"Distribution over {known.sum()} runs, median {number(middle)} {unit.name}".strip()
    return StillChart(merit_words(merit), x, y, marks, summary=summary)


def map_chart(found: ParameterMap, unit_name: str) -> tuple[StillChart, Unit]:
    """Return the medians of a merit over two parameters, and the unit that they are shown in."""
    unit = unit_of(unit_name, _largest(found.median))
    known = found.median[np.isfinite(found.median)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    names = [parameter_words(name) for name in (found.x, found.y)]
    x, y = (
        Axis(float(edges[0]), float(edges[-1]), str(words))
        for edges, words in zip((found.x_edges, found.y_edges), names, strict=True)
    )
    values = np.where(found.count > 0, unit.factor * found.median, np.nan)
    texts = [
        [_cell_text(found, row, column, unit) for column in range(values.shape[1])]
        for row in range(values.shape[0])
    ]
    ends = unit.factor * low, unit.factor * high
    label = merit_words(found.merit) + (f" ({unit.name})" if unit.name else "")
    cells = Cells(found.x_edges, found.y_edges, values, *ends, texts, label)
    title = f"{merit_words(found.merit)} over {names[0].name} and {names[1].name}"
    summary = f"Median of {title}, from {number(low, unit)} to {number(high, unit)}"
    return StillChart(title, x, y, cells=cells, summary=summary), unit


def _cell_text(found: ParameterMap, row: int, column: int, unit: Unit) -> str:
    spans = []
    for name, edges, k in ((found.x, found.x_edges, column), (found.y, found.y_edges, row)):
        words = parameter_words(name)
        span = f"{number(float(edges[k]))} to {number(float(edges[k + 1]))}"
        spans.append(f"{words.name} {span} {words.unit}".rstrip())
    value = number(float(found.median[row, column]), unit)
    return f"{', '.join(spans)}: {value}, {found.count[row, column]} runs"


@dataclass(frozen=True)
class ImportanceBars:
    """What matters to a merit: a bar with its interval a parameter, what matters most first.

    Attributes:
        title: The merit.
        axis: Of the bars, in the merit's own unit.
        bars: In their order.
        unit: How values are shown.
        measure: What is measured, in short.
        left_out: Parameters that matter less.
    """

    title: str
    measure: str
    axis: Axis
    bars: tuple[Importance, ...]
    unit: Unit
    left_out: int = 0

    @property
    def rank(self) -> bool:
        """Whether they are correlations, some of them of a distance from the median."""
        return self.axis.low < 0.0

    def bent(self, bar: Importance) -> bool:
        """Return whether a bar is of a parameter's distance from its median."""
        return bar.way == EITHER_SIDE


def importance_bars(result: StudyResult, found: Sensitivity, most: int) -> ImportanceBars:
    """Return the bars of the ``most`` parameters that matter most."""
    bars = tuple(importances(found, most))
    unit = Unit(1.0, "")
    if found.method == "morris":
        largest = max((abs(each.value) for each in bars), default=0.0)
        unit = unit_of(result.units.get(found.merit, ""), largest)
    if found.method == "rank-correlation":
        axis = Axis(-1.0, 1.0)
    else:
        ends = np.array([[each.value, each.low, each.high] for each in bars])
        axis = Axis(0.0, _largest(ends) or 1.0)
    left_out = len(found.ranking) - len(bars)
    title, measure = merit_words(found.merit), MEASURES[found.method]
    return ImportanceBars(title, measure, axis, bars, unit, left_out)
