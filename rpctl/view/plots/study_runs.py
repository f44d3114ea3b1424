"""The picture of a study: the figures of its page, two panels a row, then a row of bars."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.study.words import grouped, merit_words, number, parameter_words, percent, share_span
from rpctl.view.labels import ELLIPSIS, fold, literal
from rpctl.view.palette import LINES, RAMP, light
from rpctl.view.plots import style
from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, style_axes, text_width
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

    from rpctl.study.study_result import StudyResult

WIDTH_IN, PANEL_IN = 7.0, 1.65  # inches: of the figure, and the height of a panel's axes
LEFT_IN, RIGHT_IN, GAP_IN = 0.74, 0.2, 0.8  # inches: beside and between panels, for their labels
HEAD_IN, ABOVE_IN, BELOW_IN = 0.14, 0.26, 0.48  # inches: title of the figure, of a panel; x labels
LINE_IN, BAR_IN = 0.11, 0.17  # inches: a line of small text, and the row of a bar
SCALE_IN, SCALE_ROOM_IN = 0.1, 0.78  # inches: a colour bar, and what it needs with its labels
BOLD_RATIO = 1.2  # of the width of bold text to that of plain text, at most
NAME_IN, NAME_LINES = 2.4, 2  # the most that the name of a parameter takes
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
    names = [_clipped(parameter_words(each.name).name) for each in bars.bars] if bars else []
    rows_in = np.array([BAR_IN + LINE_IN * name.count("\n") for name in names])
    success = result.success
    share = f"{percent(success.value)} succeeded (95 % interval {share_span(success)})"
    title = f"{result.robot}: {grouped(len(result.runs))} runs, {share}"
    title = _folded(title, (WIDTH_IN - 0.3) / BOLD_RATIO, TEXT_PT + 1.0)
    head = HEAD_IN + 0.14 * (title.count("\n") + 1)
    row_in = ABOVE_IN + PANEL_IN + BELOW_IN
    bars_in = float(rows_in.sum())
    height = head + -(-len(panels) // 2) * row_in
    height += ABOVE_IN + bars_in + BELOW_IN + LINE_IN if bars else 0.0
    figure = Figure((WIDTH_IN, height))
    figure.set_facecolor(style.PAPER)
    heading: dict[str, Any] = {"fontsize": TEXT_PT + 1.0, "fontweight": "bold", "color": style.INK}
    figure.text(0.1 / WIDTH_IN, 1.0 - 0.1 / height, literal(title), va="top", **heading)
    half = 0.5 * (WIDTH_IN - LEFT_IN - RIGHT_IN - GAP_IN)
    for k, chart in enumerate(panels):
        row, column = divmod(k, 2)
        wide = k == len(panels) - 1 and not column
        left = LEFT_IN + column * (half + GAP_IN)
        bottom = height - head - row * row_in - ABOVE_IN - PANEL_IN
        width = WIDTH_IN - LEFT_IN - RIGHT_IN if wide else half
        _draw(figure, _axes(figure, left, bottom, width, PANEL_IN), chart, width)
    if bars:
        left = max(text_width(name, SMALL_PT) for name in names) + 0.25
        axes = _axes(figure, left, BELOW_IN, WIDTH_IN - left - RIGHT_IN, bars_in)
        _importance(axes, bars, names, rows_in)
    return figure


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


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return axes at a place of the figure, inches."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def _folded(text: str, width: float, size: float = SMALL_PT) -> str:
    """Return a text in lines that are as wide as a place (inches) at most."""
    length = len(text)
    while length > 4 and text_width(fold(text, length), size) > width:
        length -= 1 + length // 20
    return fold(text, length)


def _clipped(text: str, width: float = NAME_IN, size: float = SMALL_PT) -> str:
    """Return a text in ``NAME_LINES`` lines at most, each as wide as a place (inches)."""
    lines = _folded(text, width, size).split("\n")
    if len(lines) > NAME_LINES:
        lines = [*lines[: NAME_LINES - 1], lines[NAME_LINES - 1][:-1] + ELLIPSIS]
    return "\n".join(lines)


def _draw(figure: Figure, axes: Axes, chart: StillChart, width: float) -> None:
    """Draw a panel of a width (inches)."""
    if chart.cells is not None:
        width -= SCALE_ROOM_IN
    x = replace(chart.x, label=_clipped(chart.x.label, width))
    y = replace(chart.y, label=_clipped(chart.y.label, PANEL_IN))
    draw_still_chart(axes, replace(chart, x=x, y=y))
    if chart.cells is not None:
        _scale(figure, axes, chart.cells.label)
    else:
        axes.legend(fontsize=style.LEGEND_PT, labelcolor=style.INK, frameon=False,
                    handlelength=1.4, labelspacing=0.3, loc="best")  # fmt: skip


def _scale(figure: Figure, axes: Axes, label: str) -> None:
    """Add what the colours of a map mean."""
    box, (width_in, _) = axes.get_position(), figure.get_size_inches()
    room = SCALE_ROOM_IN / width_in
    axes.set_position((box.x0, box.y0, box.width - room, box.height))
    left = box.x1 - room + 0.1 / width_in
    scale = figure.add_axes((left, box.y0, SCALE_IN / width_in, box.height))
    bar = figure.colorbar(axes.collections[0], cax=scale)
    bar.outline.set_visible(False)
    scale.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2.0, pad=2)
    scale.set_ylabel(_folded(label, PANEL_IN), fontsize=SMALL_PT, color=style.INK)


def _importance(
    axes: Axes, shown: ImportanceBars, names: list[str], rows_in: np.ndarray[Any, Any]
) -> None:
    """Draw the bars from the top down, each as high as the lines of its name (inches)."""
    from matplotlib.patches import Patch

    factor, bars = shown.unit.factor, shown.bars
    values = factor * np.array([each.value for each in bars])
    ends = factor * np.array([(each.value - each.low, each.high - each.value) for each in bars])
    whiskers = np.where(np.isfinite(ends), np.maximum(ends, 0.0), 0.0).T
    y = np.cumsum(rows_in) - 0.5 * rows_in
    colours = {False: style.BASE, True: style.TIP}
    axes.barh(y, values, xerr=whiskers, color=[colours[shown.bent(each)] for each in bars],
              height=0.6 * BAR_IN, ecolor=style.INK, error_kw={"lw": 0.8})  # fmt: skip
    style_axes(axes, literal(f"What matters: {shown.title}"))
    axes.set_xlim(factor * shown.axis.low, factor * shown.axis.high)
    axes.set_ylim(float(rows_in.sum()), 0.0)
    axes.set_yticks(y, [literal(each) for each in names], fontsize=SMALL_PT)
    axes.grid(False, axis="y")
    axes.axvline(0.0, color=style.INK, lw=0.6)
    unit = f" ({shown.unit.name})" if shown.unit.name else ""
    axes.set_xlabel(f"{shown.measure}{unit}; line: its 95 % interval")
    if shown.rank:
        kinds = {shown.bent(each) for each in bars}
        handles = [Patch(color=colours[kind], label=BENT[kind]) for kind in sorted(kinds)]
        below = -(BELOW_IN - 0.2) / float(rows_in.sum())
        axes.legend(handles=handles, loc="upper center", ncols=2, bbox_to_anchor=(0.5, below),
                    borderaxespad=0.0, fontsize=style.LEGEND_PT, labelcolor=style.INK,
                    frameon=False, handlelength=1.4)  # fmt: skip


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
