"""The charts of one run or several as JSON for the page: thinned, on one time axis."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.simulation.run import Run
from rpctl.view.chart import Chart, Line, decades
from rpctl.view.charts import each_chart
from rpctl.view.labels import shorten

MAX_POINTS = 2000  # of one line: a screen has no more columns
SAME_TIME_S = 1e-9  # s: times that differ by less are the same

Thin = Callable[[Array], Array]
Variants = list[tuple[str, Chart, list[Thin]]]  # label, chart and how its lines are thinned


def packed(values: NDArray[Any]) -> str:
    """Return numbers as base64 of float32, row after row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def chart_data(runs: Sequence[Run], names: Sequence[str]) -> dict[str, Any]:
    """Return the time axis and the charts of runs, ready for JSON.

    Of one run, a chart shows all lines of a kind. Of several, it shows one line of that kind, of
    every run, and its ``variants`` are the lines to choose from.

    Args:
        runs: At least one.
        names: What the runs are called.
    """
    times, thins = _axis([run.t - run.t[0] for run in runs])
    found: Iterable[tuple[str, str, Variants]]
    if len(runs) == 1:
        found = ((c.title, c.note, [("", c, thins)]) for c in _clipped_charts(runs[0]))
    else:
        found = _by_line(runs, names, thins)
    return {
        "x": packed(times),
        "charts": [
            {
                "title": title,
                "note": note,
                "variants": [
                    {"label": label, **_variant(chart, drawn)} for label, chart, drawn in variants
                ],
            }
            for title, note, variants in found
        ],
    }


def drawn_charts(times: Array, charts: Sequence[Chart]) -> dict[str, Any]:
    """Return charts on one time axis (n,), s, ready for JSON; none has more than MAX_POINTS.

    Args:
        times: The axis.
        charts: Their lines have n values each.
    """

    def whole(values: Array) -> Array:
        return values

    return {
        "x": packed(times),
        "charts": [
            {
                "title": chart.title,
                "note": chart.note,
                "variants": [{"label": "", **_variant(chart, [whole])}],
            }
            for chart in charts
        ],
    }


def _clipped_charts(run: Run) -> Iterator[Chart]:
    """Yield the charts of a run, each clipped at its top; a band beyond it has no upper bound."""
    for chart in each_chart(run):
        top, lines = chart.top, []
        for line in chart.lines if top < np.inf else ():
            band = line.band
            if band is not None:
                band = np.minimum(band[0], top), np.where(band[1] > top, np.inf, band[1])
            lines.append(replace(line, values=np.minimum(line.values, top), band=band))
        yield replace(chart, lines=tuple(lines)) if lines else chart


def _by_line(
    runs: Sequence[Run], names: Sequence[str], thins: list[Thin]
) -> list[tuple[str, str, Variants]]:
    """Regroup the charts of several runs: per chart and kind of line, one line for each run."""
    gathered: dict[str, dict[str, list[tuple[Chart, Line, int]]]] = {}
    for k, run in enumerate(runs):
        for chart in _clipped_charts(run):
            for line in chart.lines:
                found = gathered.setdefault(chart.title, {}).setdefault(line.label, [])
                found.append((chart, line, k))
    result = []
    for title, kinds in gathered.items():
        variants: Variants = []
        for label, found in kinds.items():
            lines = tuple(
                replace(line, label=names[k], colour=k, shown=True) for _, line, k in found
            )
            unit = _axis_unit(found[0][0], lines[0])
            chart = replace(found[0][0], unit=unit, lines=lines, named=True)
            variants.append((label, chart, [thins[k] for _, _, k in found]))
        note = variants[0][1].note
        if next(iter(kinds.values()))[0][0].named:
            short = shorten(list(kinds))
            variants = [
                (name, chart, thinned)
                for name, (_, chart, thinned) in zip(short.names, variants, strict=True)
            ]
            note = "; ".join(filter(None, [note, short.shared]))
        result.append((title, note, variants))
    return result


def _axis_unit(chart: Chart, line: Line) -> str:
    return chart.unit if chart.limits else line.unit


def _variant(chart: Chart, thins: list[Thin]) -> dict[str, Any]:
    lines = chart.lines
    if len(thins) == 1:
        thins = thins * len(lines)
    entry: dict[str, Any] = {"unit": chart.unit, "limits": list(chart.limits)}
    if chart.errors:
        entry["decades"] = list(decades(lines))
    if chart.named:
        short = shorten([line.label for line in lines])
        lines = tuple(
            replace(line, label=name) for line, name in zip(lines, short.names, strict=True)
        )
        entry["names"] = short.shared
    entry["lines"] = [_line(line, thin) for line, thin in zip(lines, thins, strict=True)]
    return entry


def _line(line: Line, thin: Thin) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "label": line.label,
        "unit": line.unit,
        "colour": line.colour,
        "scale": line.scale,
        "shown": line.shown,
        "values": packed(thin(line.values)),
    }
    if line.reference is not None:
        entry["reference"] = packed(thin(line.reference))
    if line.band is not None:
        entry["band"] = [packed(thin(edge)) for edge in line.band]
    return entry


def _axis(time_axes: list[Array]) -> tuple[Array, list[Thin]]:
    """Return a common time axis (n,) and, for each run, a function that resamples its lines to it.

    A short run keeps its samples. Of a longer one, and of runs sampled at other times, each
    stretch of time gives its least and its largest value, in order, so that no peak is lost;
    after the end of a run its lines are NaN.
    """
    first = time_axes[0]
    alike = all(len(t) == len(first) and np.array_equal(t, first) for t in time_axes)
    if alike and len(first) <= MAX_POINTS:
        return first, [lambda values: values for _ in time_axes]
    end = max(float(t[-1]) for t in time_axes)
    gap = max(float(np.diff(t).max()) for t in time_axes if len(t) > 1)
    count = max(1, min(MAX_POINTS // 2, int(end / (2.0 * gap))))
    edges = np.linspace(0.0, end, count + 1)
    times = np.linspace(0.0, end, 2 * count)
    return times, [_extremes(t, edges) for t in time_axes]


def _extremes(t: Array, edges: Array) -> Thin:
    """Return a function that takes the extremes of values (K,) between each edge and the next."""
    starts = np.searchsorted(t, edges[:-1] - SAME_TIME_S)
    starts = starts[starts < len(t)]

    def thin(values: Array) -> Array:
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        falling = values[starts] > 0.5 * (low + high)
        pairs = np.full((len(edges) - 1, 2), np.nan)
        pairs[: len(starts)] = np.stack([low, high], 1)
        pairs[: len(starts)][falling] = np.stack([high, low], 1)[falling]
        return pairs.reshape(-1)

    return thin
