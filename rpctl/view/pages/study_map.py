"""The map of a merit over two parameters, as HTML."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.study.sensitivity import ParameterMap
from rpctl.study.words import Unit, merit_words, number, parameter_words, unit_of
from rpctl.view.pages.page import escape
from rpctl.view.pages.study_charts import SIDE, ChartAxis, chart

# Cividis, which is told apart without red or green, and by its lightness alone.
RAMP = ("#00224e", "#233e6c", "#4f576c", "#707173", "#948e77", "#bda969", "#e5c953", "#fee838")


def map_chart(found: ParameterMap, unit: str) -> str:
    """Return the medians of a merit in the cells of two parameters, with their scale.

    Args:
        found: The map.
        unit: Of the merit.
    """
    known = found.median[np.isfinite(found.median)]
    if not len(known):
        return '<p class="quiet">No run has this merit.</p>'
    low, high = float(known.min()), float(known.max())
    shown = unit_of(unit, high)
    x = ChartAxis(float(found.x_edges[0]), float(found.x_edges[-1]))
    y = ChartAxis(float(found.y_edges[0]), float(found.y_edges[-1]))
    across, up = parameter_words(found.x), parameter_words(found.y)
    summary = (
        f"Median of {merit_words(found.merit)} over {across.name} and {up.name}, "
        f"from {number(low, shown)} to {number(high, shown)}"
    )
    cells = _cells(found, x, y, ChartAxis(low, high if high > low else low + 1.0), shown)
    return chart(cells, x, y, (str(across), str(up)), summary) + _scale(low, high, shown)


def _cells(found: ParameterMap, x: ChartAxis, y: ChartAxis, axis: ChartAxis, shown: Unit) -> str:
    left, top = SIDE * x.at(found.x_edges), SIDE * (1.0 - y.at(found.y_edges))
    cells = []
    for row, column in np.ndindex(found.median.shape):
        value, count = float(found.median[row, column]), int(found.count[row, column])
        if not count:
            continue
        width, height = left[column + 1] - left[column], top[row] - top[row + 1]
        fill = "var(--lost)" if math.isinf(value) else ramp_colour(float(axis.at(np.array(value))))
        cells.append(
            f'<rect x="{left[column]:.1f}" y="{top[row + 1]:.1f}" width="{width:.1f}" '
            f'height="{height:.1f}" style="fill:{fill}"><title>'
            f"{escape(_cell_text(found, row, column))}: {number(value, shown)}, {count} runs"
            "</title></rect>"
        )
    return "".join(cells)


def _cell_text(found: ParameterMap, row: int, column: int) -> str:
    def span(edges: Array, k: int) -> str:
        return f"{number(float(edges[k]))} to {number(float(edges[k + 1]))}"

    x, y = parameter_words(found.x), parameter_words(found.y)
    return (
        f"{x.name} {span(found.x_edges, column)} {x.unit}, ".replace(" , ", ", ")
        + f"{y.name} {span(found.y_edges, row)} {y.unit}".rstrip()
    )


def ramp_colour(share: float) -> str:
    """Return the colour at a share (0 to 1) of the ramp, between its two neighbours."""
    at = min(max(share, 0.0), 1.0) * (len(RAMP) - 1)
    k = min(int(at), len(RAMP) - 2)
    ends = [[int(each[i : i + 2], 16) for i in (1, 3, 5)] for each in RAMP[k : k + 2]]
    mixed = [round(a + (b - a) * (at - k)) for a, b in zip(*ends, strict=True)]
    return "#" + "".join(f"{each:02x}" for each in mixed)


def _scale(low: float, high: float, shown: Unit) -> str:
    stops = ", ".join(RAMP)
    return (
        f'<div class="scale"><span>{number(low, shown)}</span>'
        f'<i style="background:linear-gradient(90deg, {stops})"></i>'
        f"<span>{number(high, shown)}</span></div>"
    )
