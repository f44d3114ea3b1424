"""The figures of a study, drawn once: the page shows what the picture shows, and more of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from rpctl.arrays import Array
from rpctl.study.merits import (
    Unit,
    grouped,
    merit_words,
    number,
    parameter_words,
    percent,
    share_span,
    unit_of,
)
from rpctl.study.statistics import EITHER_SIDE, LEVELS, Sensitivity, envelope, importances
from rpctl.study.study_result import StudyResult
from rpctl.view.labels import capital, fold, literal
from rpctl.view.palette import RAMP, light
from rpctl.view.plots import style
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, style_axes

WIDTH_IN, PANEL_IN, SMALL_PANEL_IN, HEAD_IN, BAR_IN = (
    7.0,
    2.3,
    1.7,
    0.4,
    0.24,
)  # inches: of the figure, and heights
TITLE_LETTERS, LABEL_LETTERS, NAME_LETTERS = 86, 36, 44  # in a line
MOST_BARS = 10
OUTLIERS = 3.0  # times what 95 % of runs are below: a linear axis ends there
MAX_DECADES_RATIO = 1e6  # that a logarithmic axis shows
ROOM = 0.04  # of the range of values: left free at either end
BINS = 32  # of a distribution
SAME = 1e-3  # of the largest value: a smaller spread is not drawn
BENT = {False: "of the parameter", True: "of its distance from its median"}  # of a correlation
MEASURES = {
    "sobol": "share of the variance, with interactions (total Sobol index)",
    "morris": "mean size of the change over the range (μ* of Morris)",
    "rank-correlation": "rank correlation",
}
Draw = Callable[[Axes], object]


@style.own_settings()
def study_runs_figure(result: StudyResult, log: bool = False) -> Figure:
    """Return errors over time, the merit's distribution, its map, and what matters to it.

    Args:
        result: Of the study.
        log: Whether errors and the merit have logarithmic axes.
    """
    series = [name for name in result.runs.series if name != "lateral_error"]
    panels: list[Draw] = [partial(draw_envelope, result, name, log=log) for name in series]
    panels = panels if len(result.runs.t) > 1 else []
    panels.append(partial(draw_distribution, result, result.merit, log=log))
    known = any(np.isfinite(each.median).any() for each in result.maps)
    panels += [partial(draw_map, result)] if known else []
    found = result.sensitivity_of(result.merit)
    bars = [] if found is None else [partial(draw_importance, result, found)]
    shown = 0 if found is None else min(MOST_BARS, len(found.parameters))
    rows = -(-len(panels) // 2)
    heights = [PANEL_IN * rows, 1.0 + BAR_IN * shown if bars else 0.01]
    success = result.success
    share = f"{percent(success.value)} succeeded (95 % interval {share_span(success)})"
    title = fold(f"{result.robot}: {grouped(len(result.runs))} runs, {share}", TITLE_LETTERS)
    figure = _figure(HEAD_IN + 0.14 * title.count("\n") + sum(heights))
    figure.suptitle(literal(title), x=0.015, ha="left", fontsize=TEXT_PT + 1.0, fontweight="bold",
                    color=style.INK)  # fmt: skip
    parts: Any = figure.subfigures(2, 1, height_ratios=heights)
    above, below = parts
    _fill(above, panels)
    _fill(below, bars)
    return figure


@style.own_settings()
def merits_figure(result: StudyResult, log: bool = False) -> Figure:
    """Return the distribution of each merit."""
    panels = [partial(draw_distribution, result, name, log=log) for name in result.runs.merits]
    figure = _figure(SMALL_PANEL_IN * -(-len(panels) // 3))
    _fill(figure, panels, 3)
    return figure


@style.own_settings()
def others_figure(result: StudyResult) -> Figure:
    """Return how much each parameter matters to each merit, of what matters most to it."""
    main = result.sensitivity_of(result.merit)
    names = main.ranking[:MOST_BARS] if main is not None else ()
    found = {each.merit: importances(each, len(each.parameters)) for each in result.sensitivities}
    values = np.array(
        [
            [{each.name: each.value for each in bars}[name] for name in names]
            for bars in found.values()
        ]
    )
    shares = values / np.maximum(np.abs(values).max(axis=1, keepdims=True), 1e-300)
    figure = _figure(1.2 + BAR_IN * len(found))
    axes = figure.add_subplot()
    axes.imshow(np.abs(shares), cmap="Blues", vmin=0.0, vmax=1.4, aspect="auto")
    _style(axes, "Influence on each merit, relative to the largest", "", "")
    axes.grid(False)
    for (row, column), value in np.ndenumerate(values):
        axes.text(column, row, number(float(value)), fontsize=SMALL_PT, ha="center", va="center")
    words = [literal(fold(parameter_words(name).name, LABEL_LETTERS // 2)) for name in names]
    axes.set_xticks(range(len(names)), words, fontsize=SMALL_PT, rotation=30, ha="right")
    merits = [literal(merit_words(merit)) for merit in found]
    axes.set_yticks(range(len(merits)), merits, fontsize=SMALL_PT)
    return figure


def _figure(height: float) -> Figure:
    return Figure((WIDTH_IN, height), layout="constrained", facecolor=style.PAPER)


def _fill(figure: Figure | SubFigure, panels: Sequence[Draw], columns: int = 2) -> None:
    """Draw panels, some in a row; one that is alone in its row is as wide as the figure."""
    if not panels:
        return
    grid = figure.add_gridspec(-(-len(panels) // columns), columns)
    for k, draw in enumerate(panels):
        row, column = divmod(k, columns)
        alone = k == len(panels) - 1 and not column
        draw(figure.add_subplot(grid[row, :] if alone else grid[row, column]))


def draw_envelope(result: StudyResult, name: str, axes: Axes, log: bool = False) -> None:
    """Draw how an error spreads over time: the median, half of the runs, and nine in ten."""
    t, words = result.runs.t, name.replace("_", " ")
    quantiles = envelope(np.asarray(result.runs.series[name], float), LEVELS)
    unit = unit_of(result.units.get(name, "") or "m", _largest(quantiles))
    y = span_of(unit.factor * quantiles, log=log)
    values = np.clip(unit.factor * quantiles, y.low, y.high)
    axes.fill_between(t, values[0], values[4], color=style.BASE, alpha=0.18, lw=0.0,
                      label="5 to 95 %")  # fmt: skip
    axes.fill_between(t, values[1], values[3], color=style.BASE, alpha=0.38, lw=0.0,
                      label="25 to 75 %")  # fmt: skip
    axes.plot(t, values[2], color=style.BASE, lw=1.5, label="median")
    _style(axes, f"{capital(words)} over time", "time (s)", f"error ({unit.name})")
    axes.set(xlim=(t[0], t[-1]), yscale=y.scale, ylim=(y.low, y.high))
    if y.log:
        axes.yaxis.set_major_formatter("{x:g}")
    _legend(axes)


def draw_distribution(result: StudyResult, merit: str, axes: Axes, log: bool = False) -> None:
    """Draw how a merit is distributed, runs that failed on top, or say that there is nothing.

    A linear axis ends where outliers would leave no room for the others; the last bar holds these.
    """
    values = result.runs.merits[merit]
    known = np.isfinite(values)
    unit = unit_of(result.units.get(merit, ""), _largest(values))
    inside, good = unit.factor * values[known], result.succeeded[known]
    words = merit_words(merit)
    _style(axes, capital(words), f"{words} ({unit.name})".removesuffix(" ()"), "runs")
    if not len(inside) or np.ptp(inside) <= SAME * np.abs(inside).max():
        only = number(float(inside[0]), Unit(1.0, unit.name)) if len(inside) else "no value"
        text = f"{only} in {known.sum()} of {len(known)} runs"
        axes.text(0.5, 0.5, text, ha="center", fontsize=SMALL_PT, transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    median = float(np.median(inside))
    most = OUTLIERS * float(np.quantile(inside, 0.95))
    x = span_of(inside, zero=False, log=log)
    if not log and 0.0 < most < float(inside.max()):
        inside = np.minimum(inside, most)
        x = replace(span_of(inside, zero=False), high=most)
        axes.set_xlabel(f"{axes.get_xlabel()}; the last bar: all beyond")
    axes.hist([inside[good], inside[~good]], x.edges(), stacked=True,
              color=[style.BASE, style.TIP], label=["succeeded", "did not"])  # fmt: skip
    axes.axvline(median, color=style.INK, **style.LIMIT_STYLE, label="median")
    axes.set(xscale=x.scale, xlim=(x.low, x.high))
    if x.log:
        axes.xaxis.set_major_formatter("{x:g}")
    _legend(axes)


def draw_map(result: StudyResult, axes: Axes) -> None:
    """Draw the medians of the merit over the two parameters that matter most to it."""
    found = result.maps[0]
    unit = unit_of(result.units.get(found.merit, ""), _largest(found.median))
    ramp = LinearSegmentedColormap.from_list("ramp", RAMP).with_extremes(over=light("lost"))
    values = np.where(found.count > 0, unit.factor * found.median, np.nan)
    finite = values[np.isfinite(values)]
    low, high = finite.min(), finite.max()
    shown = np.where(np.isposinf(values), np.nextafter(high, np.inf), values)
    cells = axes.pcolormesh(found.x_edges, found.y_edges, shown, cmap=ramp, vmin=low, vmax=high)
    names = [str(parameter_words(name)) for name in (found.x, found.y)]
    _style(axes, "Median over the two most influential parameters", *names)
    axes.grid(False)
    bar = axes.figure.colorbar(cells, ax=axes, aspect=16)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2.0, pad=2)
    label = f"{merit_words(found.merit)} ({unit.name})".removesuffix(" ()")
    bar.set_label(literal(fold(label, LABEL_LETTERS)), fontsize=SMALL_PT, color=style.INK)


def draw_importance(result: StudyResult, found: Sensitivity, axes: Axes) -> None:
    """Draw what matters to a merit: a bar with its interval a parameter, from the top down."""
    bars, unit = importances(found, MOST_BARS), Unit(1.0, "")
    numbers = np.array([(each.value, each.low, each.high) for each in bars])
    if found.method == "morris":
        unit = unit_of(result.units.get(found.merit, ""), _largest(numbers[:, 0]))
    value, low, high = unit.factor * numbers.T
    ends = np.nan_to_num([value - low, high - value], posinf=0.0).clip(min=0.0)
    bent = [each.way == EITHER_SIDE for each in bars]
    colours = {False: style.BASE, True: style.TIP}
    axes.barh(range(len(bars)), value, xerr=ends, height=0.6, ecolor=style.INK,
              color=[colours[each] for each in bent], error_kw={"lw": 0.8})  # fmt: skip
    measure = f"{MEASURES[found.method]} ({unit.name})".removesuffix(" ()")
    style_axes(axes, literal(f"Influence on {merit_words(found.merit)}"))
    axes.set_xlabel(f"{measure}; line: its 95 % interval")
    names = [literal(fold(parameter_words(each.name).name, NAME_LETTERS)) for each in bars]
    axes.set_yticks(range(len(bars)), names, fontsize=SMALL_PT)
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.axvline(0.0, color=style.INK, lw=0.6)
    if found.method == "rank-correlation":
        axes.set_xlim(-1.0, 1.0)
        handles = [Patch(color=colours[kind], label=BENT[kind]) for kind in sorted({*bent})]
        _legend(axes, handles=handles)


def _largest(values: Array) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


@dataclass(frozen=True)
class Span:
    """What an axis shows, from its low end to its high one."""

    low: float
    high: float
    log: bool = False

    @property
    def scale(self) -> str:
        """The axis's scale, as Matplotlib names it."""
        return "log" if self.log else "linear"

    def edges(self) -> list[float]:
        """Return the edges of a distribution's bins."""
        spaced = np.geomspace if self.log else np.linspace
        return spaced(self.low, self.high, BINS + 1).tolist()


def span_of(values: Array, zero: bool = True, log: bool = False) -> Span:
    """Return an axis that holds values with a little room.

    Args:
        values: Those that are not finite are left out.
        zero: Whether a linear one begins at zero, if no value is below.
        log: Whether it is logarithmic, if no value is negative and one is positive.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return Span(0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    least = float(known[known > 0.0].min(initial=np.inf))
    if log and low >= 0.0 and np.isfinite(least):
        return Span(max(least, high / MAX_DECADES_RATIO) / 1.15, high * 1.15, log=True)
    if zero and low >= 0.0:
        low = 0.0
    room = ROOM * (high - low) or 0.5 * abs(high) or 1.0
    return Span(low if low == 0.0 else low - room, high + room)


def _style(axes: Axes, title: str, x: str, y: str) -> None:
    style_axes(axes, literal(fold(title, LABEL_LETTERS)))
    axes.set_xlabel(literal(fold(x, LABEL_LETTERS)))
    axes.set_ylabel(literal(fold(y, LABEL_LETTERS)))


def _legend(axes: Axes, **handles: Any) -> None:
    axes.legend(fontsize=style.LEGEND_PT, labelcolor=style.INK, frameon=False, handlelength=1.4,
                labelspacing=0.3, loc="best", **handles)  # fmt: skip
