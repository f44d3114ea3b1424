"""Charts of a study as HTML that needs no script: it prints, and follows the page's colours.

The marks are SVG, stretched over the plot's area; ticks and labels are text beside it, so that they
keep their size on any width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.study.sensitivity import EITHER_SIDE, Importance
from rpctl.study.words import Unit, number, parameter_words, unit_of
from rpctl.view.pages.page import escape

SIDE = 1000  # of the SVG's box, which is stretched
DECADES_RATIO = 40.0  # largest over smallest: beyond, an axis is logarithmic
TICKS = 5  # about, of an axis
TICK_TEXT = {"wide": 60, "small": 20}  # characters of the labels below a chart that fit
WAYS = {EITHER_SIDE: "either side of its median"}
SAME = 1e-3  # of the largest value: a smaller spread is not drawn


@dataclass(frozen=True)
class ChartAxis:
    """An axis from ``low`` to ``high``, linear or logarithmic."""

    low: float
    high: float
    log: bool = False

    def at(self, values: Array) -> Array:
        """Return where values are, 0 at the low end to 1; beyond the ends they are at them."""
        if self.log:
            bounded = np.log(np.clip(values, self.low, self.high))
            return np.asarray(
                (bounded - math.log(self.low)) / (math.log(self.high) - math.log(self.low))
            )
        return np.asarray(np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0))

    def ticks(self) -> list[float]:
        """Return round values inside, about :data:`TICKS` of them."""
        if not self.log:
            step = _round_step((self.high - self.low) / TICKS)
            first = math.ceil(self.low / step - 1e-9)
            return [k * step for k in range(first, math.floor(self.high / step + 1e-9) + 1)]
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        steps = (1.0, 3.0) if len(decades) <= 4 else (1.0,)
        values = [step * 10.0**decade for decade in decades for step in steps]
        return [value for value in values if self.low <= value * 1.0001 <= self.high * 1.0002]


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least * 0.999)


def axis_over(values: Array, log: bool | None = None, zero: bool = True) -> ChartAxis:
    """Return an axis that holds values, with a little room.

    Args:
        values: Those that are not finite are left out.
        log: Whether it is logarithmic; None: where the values span decades.
        zero: Whether a linear one begins at zero, if no value is below.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return ChartAxis(0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    positive = known[known > 0.0]
    if log is None:
        log = low >= 0.0 and len(positive) > 0 and high > DECADES_RATIO * float(positive.min())
    if log and len(positive):
        least = max(float(positive.min()), high * 1e-6)
        return ChartAxis(least / 1.15, high * 1.15, log=True)
    if zero and low >= 0.0:
        low = 0.0
    room = 0.04 * (high - low) or 0.5 * abs(high) or 1.0
    return ChartAxis(low if low == 0.0 else low - room, high + room)


def chart(marks: str, x: ChartAxis, y: ChartAxis, labels: tuple[str, str], summary: str,
          small: bool = False) -> str:  # fmt: skip
    """Return a chart with ticks and labels.

    Args:
        marks: SVG in a box of :data:`SIDE` by :data:`SIDE`.
        x: The horizontal axis, in the units that are shown.
        y: The vertical one.
        labels: Of the axes.
        summary: What who does not see it is told.
        small: Whether it is one of many: fewer labels fit below it.
    """
    across, up = fitting(x.ticks(), TICK_TEXT["small" if small else "wide"]), y.ticks()
    grid = "".join(f'<path d="M0 {_up(y, value)}H{SIDE}"/>' for value in up)
    return (
        f'<div class="plot" role="img" aria-label="{escape(summary)}">'
        f'<svg viewBox="0 0 {SIDE} {SIDE}" preserveAspectRatio="none" aria-hidden="true">'
        f'<g class="grid">{grid}</g>{marks}</svg>'
        + "".join(f'<b class="y" style="top:{_up(y, v) / 10:.2f}%">{number(v)}</b>' for v in up)
        + "".join(
            f'<b class="x" style="left:{100 * float(x.at(np.array(v))):.2f}%">{number(v)}</b>'
            for v in across
        )
        + f'<em class="x">{escape(labels[0])}</em><em class="y">{escape(labels[1])}</em></div>'
    )


def fitting(ticks: list[float], room: int) -> list[float]:
    """Return every n-th of the ticks, so that their labels do not touch.

    Args:
        ticks: Their values, in order.
        room: Characters that fit side by side.
    """
    length = 2 + max((len(number(each)) for each in ticks), default=0)
    return ticks[:: max(1, -(-len(ticks) * length // room))]


def _up(axis: ChartAxis, value: float) -> float:
    return round(SIDE * (1.0 - float(axis.at(np.array(value)))), 1)


def line(x: Array, y: Array) -> str:
    """Return a path through points (n,) of the box, from 0 to 1 along each axis, upwards."""
    return "M" + "L".join(f"{SIDE * a:.1f} {SIDE * (1 - b):.1f}" for a, b in zip(x, y, strict=True))


def band(x: Array, low: Array, high: Array) -> str:
    """Return the path around what lies between two lines over the same places.

    Args:
        x: Places (n,), 0 to 1.
        low: The lower line (n,), 0 to 1.
        high: The upper one (n,).
    """
    return line(np.append(x, x[::-1]), np.append(high, low[::-1])) + "Z"


def envelope_chart(t: Array, quantiles: Array, unit: str, summary: str) -> str:
    """Return a chart of the quantiles of an error over time: two bands and the median.

    Args:
        t: Times (T,), s.
        quantiles: 5, 25, 50, 75 and 95 % (5, T); inf where so many runs had ended.
        unit: Of the error.
        summary: What who does not see it is told.
    """
    known = quantiles[np.isfinite(quantiles)]
    shown = unit_of(unit, float(known.max()) if len(known) else 0.0)
    values = quantiles * shown.factor
    x, y = ChartAxis(float(t[0]), float(t[-1])), axis_over(values)
    across, up = x.at(t), y.at(values)
    marks = (
        f'<path class="outer" d="{band(across, up[0], up[4])}"/>'
        f'<path class="inner" d="{band(across, up[1], up[3])}"/>'
        f'<path class="median" d="{line(across, up[2])}"/>'
    )
    return chart(marks, x, y, ("time (s)", f"error ({shown.name})"), summary)


def histogram(values: Array, good: NDArray[np.bool_], unit: str, bins: int = 32) -> str:
    """Return how a merit is distributed: runs that succeeded below, the others on top of them.

    Args:
        values: The merit of each run (N,); what is not finite is left out.
        good: Which runs (N,) succeeded.
        unit: Of the merit.
        bins: How many bars.
    """
    known = np.isfinite(values)
    if not known.any():
        return '<p class="quiet">No run has it.</p>'
    shown = unit_of(unit, float(np.abs(values[known]).max()))
    inside, good = values[known] * shown.factor, good[known]
    if np.ptp(inside) <= SAME * np.abs(inside).max():
        only = number(float(inside[0]), Unit(1.0, shown.name))
        return f'<p class="quiet">{escape(only)} in {known.sum()} of {len(known)} runs</p>'
    x = axis_over(inside, zero=False)
    edges = np.linspace(0.0, 1.0, bins + 1)
    all_of = np.histogram(x.at(inside), edges)[0]
    good_of = np.histogram(x.at(inside[good]), edges)[0]
    y = ChartAxis(0.0, 1.05 * float(all_of.max()))
    marks = _bars(edges, np.zeros(bins), y.at(good_of), "done")
    marks += _bars(edges, y.at(good_of), y.at(all_of), "failed")
    middle = float(x.at(np.array(np.median(inside))))
    marks += f'<path class="median" d="M{SIDE * middle:.1f} 0V{SIDE}"/>'
    summary = f"Distribution over {known.sum()} runs, median {number(float(np.median(inside)))}"
    return chart(marks, x, y, (shown.name, "runs"), f"{summary} {shown.name}".strip(), small=True)


def _bars(edges: Array, low: Array, high: Array, kind: str) -> str:
    """Return the bars between two heights, as one path."""
    boxes = [
        f"M{SIDE * a:.1f} {SIDE * (1 - bottom):.1f}V{SIDE * (1 - top):.1f}H{SIDE * b:.1f}"
        f"V{SIDE * (1 - bottom):.1f}Z"
        for a, b, bottom, top in zip(edges[:-1], edges[1:], low, high, strict=True)
        if top > bottom
    ]
    return f'<path class="{kind}" d="{"".join(boxes)}"/>'


def interval_bars(bars: Sequence[Importance], signed: bool, unit: Unit, summary: str) -> str:
    """Return bars with their intervals, one below the other.

    Args:
        bars: In their order.
        signed: Whether zero is in the middle, and the axis ends at ±1.
        unit: How values are shown.
        summary: What who does not see it is told.
    """
    ends = [abs(end) for each in bars for end in (each.value, each.low, each.high)]
    top = 1.0 if signed else max([end for end in ends if math.isfinite(end)] or [0.0]) or 1.0
    axis = ChartAxis(-top if signed else 0.0, top)

    def at(value: float) -> float:
        return 100.0 * float(axis.at(np.array(value)))

    rows = []
    for each in bars:
        left, right = sorted((at(0.0), at(each.value)))
        whisker = ""
        if math.isfinite(each.low) and math.isfinite(each.high):
            low, high = at(each.low), at(each.high)
            whisker = f'<i class="whisker" style="left:{low:.2f}%;width:{high - low:.2f}%"></i>'
        words = parameter_words(each.name).name
        way = f"<small>{WAYS[each.way]}</small>" if each.way == EITHER_SIDE else ""
        rows.append(
            f'<li><span class="name" title="{escape(each.name)}">{escape(words)}{way}</span>'
            f'<span class="track"><i class="zero" style="left:{at(0.0):.2f}%"></i>'
            f'<i class="bar{" either" * bool(way)}" style="left:{left:.2f}%;'
            f'width:{right - left:.2f}%"></i>{whisker}'
            f'</span><span class="value">{number(each.value, unit)}</span></li>'
        )
    return f'<ul class="bars" aria-label="{escape(summary)}">{"".join(rows)}</ul>'
