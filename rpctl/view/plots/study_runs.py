"""The picture of a study: errors over time, the merit's distribution, a map, what matters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.study.sensitivity import EITHER_SIDE, MONOTONIC, Importance, importances
from rpctl.study.statistics import LEVELS, envelope
from rpctl.study.words import (
    Unit,
    grouped,
    merit_words,
    parameter_words,
    percent,
    share_span,
    unit_of,
)
from rpctl.view.labels import ELLIPSIS, fold, literal
from rpctl.view.plots import style
from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, style_axes, text_width

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
MOST_BARS, BINS = 10, 40
COLOURS = {"base_error": style.BASE, "end_effector_error": style.TIP}
TITLES = {
    "base_error": "Base error over time",
    "end_effector_error": "End effector error over time",
}
MEASURES = {
    "sobol": "share of the variance, with interactions (total Sobol index)",
    "morris": "mean size of the change over the range (μ* of Morris)",
    "rank-correlation": "rank correlation",
}
WAYS = {MONOTONIC: style.BASE, EITHER_SIDE: style.TIP}
WAY_WORDS = {MONOTONIC: "of the parameter", EITHER_SIDE: "of its distance from its median"}

Draw = Callable[["Axes"], None]


def study_picture(result: StudyResult) -> bytes:
    """Return the picture of a study as the bytes of a PNG."""
    return to_png(study_runs_figure(result), DPI)


@style.own_settings()
def study_runs_figure(result: StudyResult) -> Figure:
    """Return the figure: two panels a row, then a row of bars; those that there is something for.

    An odd panel is as wide as the figure.
    """
    from matplotlib.figure import Figure

    panels: list[Draw] = [
        *(_over_time(result, name) for name in COLOURS if name in result.runs.series),
        lambda axes: _distribution(axes, result),
    ]
    if result.maps:
        panels.append(lambda axes: _map(axes, result))
    found = result.sensitivity_of(result.merit)
    bars = importances(found, MOST_BARS) if found is not None else []
    names = [_clipped(str(parameter_words(each.name).name)) for each in bars]
    bars_in = sum(BAR_IN + LINE_IN * name.count("\n") for name in names)
    title = _folded(_title(result), (WIDTH_IN - 0.3) / BOLD_RATIO, TEXT_PT + 1.0)
    head = HEAD_IN + 0.14 * (title.count("\n") + 1)
    rows = -(-len(panels) // 2)
    row_in = ABOVE_IN + PANEL_IN + BELOW_IN
    bars_row = ABOVE_IN + bars_in + BELOW_IN + LINE_IN if bars else 0.0
    height = head + rows * row_in + bars_row
    figure = Figure((WIDTH_IN, height))
    figure.set_facecolor(style.PAPER)
    heading: dict[str, Any] = {"fontsize": TEXT_PT + 1.0, "fontweight": "bold", "color": style.INK}
    figure.text(0.1 / WIDTH_IN, 1.0 - 0.1 / height, literal(title), va="top", **heading)
    half = 0.5 * (WIDTH_IN - LEFT_IN - RIGHT_IN - GAP_IN)
    for k, draw in enumerate(panels):
        row, column = divmod(k, 2)
        wide = k == len(panels) - 1 and not column
        left = LEFT_IN + column * (half + GAP_IN)
        bottom = height - head - row * row_in - ABOVE_IN - PANEL_IN
        width = WIDTH_IN - LEFT_IN - RIGHT_IN if wide else half
        draw(_axes(figure, left, bottom, width, PANEL_IN))
    if bars:
        left = max(map(text_width_small, names)) + 0.25
        axes = _axes(figure, left, BELOW_IN, WIDTH_IN - left - RIGHT_IN, bars_in)
        _importance(axes, result, bars, names)
    return figure


def text_width_small(text: str) -> float:
    """Return the width of a text as labels have it, inches."""
    return text_width(text, SMALL_PT)


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return axes at a place of the figure, inches."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def _title(result: StudyResult) -> str:
    success = result.success
    return (
        f"{result.robot}: {grouped(len(result.runs))} runs, {percent(success.value)} succeeded "
        f"(95 % interval {share_span(success)})"
    )


def _folded(text: str, width: float, size: float = SMALL_PT) -> str:
    """Return a text in lines that are as wide as a place (inches) at most."""
    length = len(text)
    while length > 4 and text_width(fold(text, length), size) > width:
        length -= 1 + length // 20
    return fold(text, length)


def _clipped(name: str) -> str:
    """Return a parameter's name in the lines that bars have room for."""
    lines = _folded(name, NAME_IN).split("\n")
    if len(lines) > NAME_LINES:
        lines = [*lines[: NAME_LINES - 1], lines[NAME_LINES - 1][:-1] + ELLIPSIS]
    return "\n".join(lines)


def _merit(result: StudyResult) -> tuple[str, Unit]:
    """Return the merit's words with the unit that it is shown in, and that unit."""
    values = result.runs.merits[result.merit]
    known = np.abs(values[np.isfinite(values)])
    unit = unit_of(result.units.get(result.merit, ""), float(known.max()) if len(known) else 0.0)
    return merit_words(result.merit) + (f" ({unit.name})" if unit.name else ""), unit


def _over_time(result: StudyResult, name: str) -> Draw:
    def draw(axes: Axes) -> None:
        found = envelope(np.asarray(result.runs.series[name], float), LEVELS)
        finite = found[np.isfinite(found)]
        unit = unit_of("m", float(finite.max()) if len(finite) else 0.0)
        top = (
            1.05 * unit.factor * float(finite.max()) if len(finite) and finite.max() > 0.0 else 1.0
        )
        shown, t, colour = np.minimum(unit.factor * found, 1e3 * top), result.runs.t, COLOURS[name]
        for low, high, alpha, label in ((0, 4, 0.18, "90 % of runs"), (1, 3, 0.4, "50 % of runs")):
            axes.fill_between(t, shown[low], shown[high], color=colour, alpha=alpha, lw=0,
                              label=label)  # fmt: skip
        axes.plot(t, shown[2], color=colour, lw=style.LINE_WIDTH_PT, label="median")
        axes.set_ylim(0.0, top)
        axes.set_xlabel("time (s)")
        axes.set_ylabel(f"error ({unit.name})")
        _legend(axes, reverse=True)
        style_axes(axes, TITLES[name])

    return draw


def _legend(axes: Axes, **options: Any) -> None:
    axes.legend(fontsize=style.LEGEND_PT, labelcolor=style.INK, frameon=False, handlelength=1.4,
                labelspacing=0.3, loc=options.pop("loc", "upper right"), **options)  # fmt: skip


def _distribution(axes: Axes, result: StudyResult) -> None:
    label, unit = _merit(result)
    values = unit.factor * result.runs.merits[result.merit]
    known = np.isfinite(values)
    groups = [values[known & result.succeeded], values[known & ~result.succeeded]]
    axes.hist(groups, BINS, stacked=True, color=[style.BASE, style.TIP],
              label=["succeeded", "did not"])  # fmt: skip
    axes.set_xlabel(label)
    axes.set_ylabel("runs")
    if not result.succeeded.all():
        _legend(axes)
    style_axes(axes, literal(f"Distribution: {merit_words(result.merit)}"))


def _importance(axes: Axes, result: StudyResult, bars: list[Importance], names: list[str]) -> None:
    """Draw the bars from the top down, each as high as the lines of its name."""
    found = result.sensitivity_of(result.merit)
    assert found is not None
    factor, label = 1.0, MEASURES[found.method]
    if found.method == "morris":
        largest = max(abs(each.value) for each in bars)
        factor, name = unit_of(result.units.get(result.merit, ""), largest)
        label += f" ({name})" if name else ""
    values = factor * np.array([each.value for each in bars])
    ends = factor * np.array([(each.value - each.low, each.high - each.value) for each in bars])
    whiskers = np.where(np.isfinite(ends), np.maximum(ends, 0.0), 0.0).T
    rows_in = np.array([BAR_IN + LINE_IN * name.count("\n") for name in names])
    y = np.cumsum(rows_in) - 0.5 * rows_in
    axes.barh(y, values, xerr=whiskers, color=[WAYS.get(each.way, style.BASE) for each in bars],
              height=0.6 * BAR_IN, ecolor=style.INK, error_kw={"lw": 0.8})  # fmt: skip
    style_axes(axes, literal(f"What matters: {merit_words(result.merit)}"))
    axes.set_ylim(float(rows_in.sum()), 0.0)
    axes.set_yticks(y, [literal(each) for each in names], fontsize=SMALL_PT)
    axes.grid(False, axis="y")
    if found.method == "rank-correlation":
        axes.set_xlim(-1.0 if values.min() < -0.2 else min(-0.05, *(values - whiskers[0])), 1.0)
        _ways(axes, {each.way for each in bars})
    axes.axvline(0.0, color=style.INK, lw=0.6)
    axes.set_xlabel(f"{label}; line: its 95 % interval")


def _ways(axes: Axes, shown: set[str]) -> None:
    """Say below the bars whose correlation their colours stand for."""
    from matplotlib.patches import Patch

    handles = [Patch(color=WAYS[each], label=WAY_WORDS[each]) for each in WAYS if each in shown]
    height_in = axes.get_position().height * axes.figure.get_size_inches()[1]  # type: ignore[union-attr]
    below = -(BELOW_IN - 0.2) / height_in
    _legend(axes, handles=handles, loc="upper center", ncols=2, bbox_to_anchor=(0.5, below),
            borderaxespad=0.0)  # fmt: skip


def _map(axes: Axes, result: StudyResult) -> None:
    found, figure = result.maps[0], axes.figure
    label, unit = _merit(result)
    box, (width_in, _) = axes.get_position(), figure.get_size_inches()  # type: ignore[union-attr]
    room = SCALE_ROOM_IN / width_in
    axes.set_position((box.x0, box.y0, box.width - room, box.height))
    scale = figure.add_axes(
        (box.x1 - room + 0.1 / width_in, box.y0, SCALE_IN / width_in, box.height)
    )
    shown = np.ma.masked_invalid(unit.factor * found.median)
    drawn = axes.pcolormesh(found.x_edges, found.y_edges, shown, cmap="cividis")
    bar = figure.colorbar(drawn, cax=scale)
    bar.outline.set_visible(False)
    scale.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2.0, pad=2)
    scale.set_ylabel(_folded(label, PANEL_IN), fontsize=SMALL_PT, color=style.INK)
    style_axes(axes, "Median over what matters most")
    x, y = (str(parameter_words(name)) for name in (found.x, found.y))
    axes.set_xlabel(literal(_clip_lines(x, width_in * axes.get_position().width)))
    axes.set_ylabel(literal(_clip_lines(y, PANEL_IN)))
    axes.grid(False)


def _clip_lines(text: str, width: float) -> str:
    """Return the label of an axis in two lines at most, which are as long as the axis."""
    lines = _folded(text, width).split("\n")
    return "\n".join(lines if len(lines) <= 2 else [lines[0], lines[1][:-1] + ELLIPSIS])
