"""The picture of a study: the figures of its page, two panels a row, then a row of bars."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.study.study_result import StudyResult
from rpctl.study.words import grouped, merit_words, number, parameter_words, percent, share_span
from rpctl.view.labels import fold, literal
from rpctl.view.palette import LINES, RAMP, light
from rpctl.view.plots import style
from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, style_axes
from rpctl.view.still_chart import Axis, Cells, Mark, StillChart, fitting
from rpctl.view.study_figures import (
    ImportanceBars,
    distribution_chart,
    envelope_charts,
    importance_bars,
    map_chart,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN, PANEL_IN, HEAD_IN, BAR_IN = 7.0, 2.3, 0.4, 0.24  # inches: of the figure, and heights
TITLE_LETTERS, LABEL_LETTERS, NAME_LETTERS = 86, 36, 44  # in a line
DPI = 200
MOST_BARS = 10
BENT = {False: "of the parameter", True: "of its distance from its median"}  # of a correlation
PX_PER_PT = 96.0 / 72.0
TICK_ROOM = 40  # characters of the labels below a panel that fit


def study_picture(result: StudyResult) -> bytes:
    """Return the picture of a study as the bytes of a PNG."""
    return to_png(study_runs_figure(result), DPI)


@style.own_settings()
def study_runs_figure(result: StudyResult) -> Figure:
    """Return the figure; an odd panel is as wide as it is."""
    from matplotlib.figure import Figure

    panels = _panels(result)
    found = result.sensitivity_of(result.merit)
    bars = importance_bars(result, found, MOST_BARS) if found is not None else None
    rows = -(-len(panels) // 2)
    heights = [PANEL_IN * rows, 1.0 + BAR_IN * len(bars.bars) if bars else 0.01]
    success = result.success
    share = f"{percent(success.value)} succeeded (95 % interval {share_span(success)})"
    title = fold(f"{result.robot}: {grouped(len(result.runs))} runs, {share}", TITLE_LETTERS)
    size = WIDTH_IN, HEAD_IN + 0.14 * title.count("\n") + sum(heights)
    figure = Figure(size, layout="constrained", facecolor=style.PAPER)
    figure.suptitle(literal(title), x=0.015, ha="left", fontsize=TEXT_PT + 1.0, fontweight="bold",
                    color=style.INK)  # fmt: skip
    above, below = figure.subfigures(2, 1, height_ratios=heights)
    grid = above.add_gridspec(rows, 2)
    for k, chart in enumerate(panels):
        row, column = divmod(k, 2)
        alone = k == len(panels) - 1 and not column
        _panel(above.add_subplot(grid[row, :] if alone else grid[row, column]), chart)
    if bars:
        _importance(below.add_subplot(), bars)
    return figure


def _panel(axes: Axes, chart: StillChart) -> None:
    """Draw a chart with its legend, or with the scale of its colours."""
    x = replace(chart.x, label=fold(chart.x.label, LABEL_LETTERS))
    y = replace(chart.y, label=fold(chart.y.label, LABEL_LETTERS))
    draw_still_chart(axes, replace(chart, x=x, y=y, title=fold(chart.title, LABEL_LETTERS)))
    if chart.cells is None:
        axes.legend(fontsize=style.LEGEND_PT, labelcolor=style.INK, frameon=False,
                    handlelength=1.4, labelspacing=0.3, loc="best")  # fmt: skip
        return
    bar = axes.figure.colorbar(axes.collections[0], ax=axes, aspect=16)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2.0, pad=2)
    label = fold(chart.cells.label, LABEL_LETTERS)
    bar.set_label(literal(label), fontsize=SMALL_PT, color=style.INK)


def _panels(result: StudyResult) -> list[StillChart]:
    """Return the charts that there is something for, under the titles that they have here."""
    merit, unit = result.merit, result.units.get(result.merit, "")
    charts = [
        replace(chart, title=f"{chart.title[:1].upper()}{chart.title[1:]} over time")
        for chart in envelope_charts(result)
    ]
    spread = distribution_chart(merit, result.runs.merits[merit], result.succeeded, unit)
    if isinstance(spread, StillChart):
        label = merit_words(merit) + (f" ({spread.x.label})" if spread.x.label else "")
        title = f"Distribution: {merit_words(merit)}"
        charts.append(replace(spread, title=title, x=replace(spread.x, label=label)))
    known = (each for each in result.maps[:1] if np.isfinite(each.median).any())
    maps = (map_chart(each, unit)[0] for each in known)
    return charts + [replace(chart, title="Median over what matters most") for chart in maps]


def _importance(axes: Axes, shown: ImportanceBars) -> None:
    """Draw the bars from the top down."""
    from matplotlib.patches import Patch

    factor, bars = shown.unit.factor, shown.bars
    values = factor * np.array([each.value for each in bars])
    ends = factor * np.array([(each.value - each.low, each.high - each.value) for each in bars])
    whiskers = np.where(np.isfinite(ends), np.maximum(ends, 0.0), 0.0).T
    colours = {False: style.BASE, True: style.TIP}
    axes.barh(range(len(bars)), values, xerr=whiskers, height=0.6, ecolor=style.INK,
              color=[colours[shown.bent(each)] for each in bars], error_kw={"lw": 0.8})  # fmt: skip
    style_axes(axes, literal(f"What matters: {shown.title}"))
    axes.set(xlim=(factor * shown.axis.low, factor * shown.axis.high), ylim=(len(bars) - 0.5, -0.5))
    names = [literal(fold(parameter_words(each.name).name, NAME_LETTERS)) for each in bars]
    axes.set_yticks(range(len(bars)), names, fontsize=SMALL_PT)
    axes.grid(False, axis="y")
    axes.axvline(0.0, color=style.INK, lw=0.6)
    unit = f" ({shown.unit.name})" if shown.unit.name else ""
    axes.set_xlabel(f"{shown.measure}{unit}; line: its 95 % interval")
    if shown.rank:
        kinds = sorted({shown.bent(each) for each in bars})
        handles = [Patch(color=colours[kind], label=BENT[kind]) for kind in kinds]
        axes.legend(handles=handles, loc="best", fontsize=style.LEGEND_PT, frameon=False,
                    labelcolor=style.INK, handlelength=1.4)  # fmt: skip


def draw_still_chart(axes: Axes, chart: StillChart) -> None:
    """Draw a chart; who wants a legend or a scale of its cells adds it."""
    if chart.cells is not None:
        _draw_cells(axes, chart.cells)
    for mark in chart.marks:
        _draw_mark(axes, mark, chart.y)
    style.style_axes(axes, literal(chart.title))
    axes.set(xscale=_scale_of(chart.x), yscale=_scale_of(chart.y))
    axes.minorticks_off()
    across, up = fitting(chart.x.ticks(), TICK_ROOM), chart.y.ticks()
    axes.set_xticks(across, [number(value) for value in across])
    axes.set_yticks(up, [number(value) for value in up])
    axes.set(xlim=(chart.x.low, chart.x.high), ylim=(chart.y.low, chart.y.high))
    axes.set(xlabel=literal(chart.x.label), ylabel=literal(chart.y.label))
    if chart.cells is not None:
        axes.grid(False)


def _scale_of(axis: Axis) -> str:
    return "log" if axis.log else "linear"


def _draw_mark(axes: Axes, mark: Mark, axis: Axis) -> None:
    """Draw a mark; what is beyond its axis is drawn at its end."""
    y = np.clip(mark.y, axis.low, axis.high)
    line = mark.colour.removeprefix("c")
    colour = LINES[int(line)][0] if line.isdigit() else light(mark.colour)
    look: dict[str, Any] = {"color": colour, "alpha": mark.opacity, "label": mark.label or None}
    if mark.floor is None:
        dash = style.LIMIT_STYLE["ls"] if mark.dashed else "-"
        axes.plot(mark.x, y, lw=mark.width / PX_PER_PT, ls=dash, **look)
        return
    floor = np.clip(mark.floor, axis.low, axis.high)
    if mark.steps:
        axes.stairs(y, mark.x, baseline=floor, lw=0.0, fill=True, **look)
    else:
        axes.fill_between(mark.x, floor, y, lw=0.0, **look)


def _draw_cells(axes: Axes, cells: Cells) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    ramp = LinearSegmentedColormap.from_list("ramp", RAMP).with_extremes(over=light("lost"))
    lost = np.nextafter(cells.high, np.inf)
    shown = np.ma.masked_invalid(np.where(np.isposinf(cells.values), lost, cells.values))
    edges = cells.x_edges, cells.y_edges
    axes.pcolormesh(*edges, shown, cmap=ramp, vmin=cells.low, vmax=cells.high)
