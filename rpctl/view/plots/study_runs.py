"""The picture of a study: errors over time, the merit's distribution, what matters, a map."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rpctl.study.sensitivity import RANKS, Sensitivity
from rpctl.study.statistics import LEVELS, envelope
from rpctl.view.labels import literal
from rpctl.view.plots import style
from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rpctl.study.study_result import StudyResult

WIDTH_IN, ROW_IN, HEAD_IN = 7.0, 2.1, 0.45  # inches
DPI = 200
MOST_BARS, BINS = 10, 40
COLOURS = {"base_error": style.BASE, "end_effector_error": style.TIP}
MEASURES = {
    "sobol": ("total", "total Sobol index"),
    "morris": ("mu_star", "μ* of Morris"),
    "rank-correlation": (RANKS[0], "rank correlation"),
}
EITHER_SIDE = "distance from its median"


class MeasuredBar(NamedTuple):
    """How much a parameter matters, and within which interval."""

    name: str
    value: float
    low: float
    high: float


def measured_bars(found: Sensitivity, most: int) -> list[MeasuredBar]:
    """Return how much parameters matter, what matters most first.

    Where that of a parameter's distance from its median is larger, it is shown and named so.

    Args:
        found: What was found.
        most: Number of parameters that are shown.
    """
    bars = []
    for name in found.ranking[:most]:
        j = found.parameters.index(name)
        bar = MeasuredBar(name, *found.measures[MEASURES[found.method][0]][j])
        if found.method == "rank-correlation":
            other = found.measures[RANKS[1]][j]
            if abs(other.value) > abs(bar.value):
                bar = MeasuredBar(f"{name}: {EITHER_SIDE}", *other)
        bars.append(bar)
    return bars


def study_picture(result: StudyResult) -> bytes:
    """Return the picture of a study as the bytes of a PNG."""
    return to_png(study_runs_figure(result), DPI)


@style.own_settings()
def study_runs_figure(result: StudyResult) -> Figure:
    """Return the figure: two panels a row, those that the study has something for."""
    from matplotlib.figure import Figure

    panels: list[Callable[[Axes], None]] = [
        *(_over_time(result, name) for name in COLOURS if name in result.runs.series),
        lambda axes: _distribution(axes, result),
    ]
    if result.sensitivity_of(result.merit) is not None:
        panels.append(lambda axes: _importance(axes, result))
    if result.maps:
        panels.append(lambda axes: _map(axes, result))
    rows = -(-len(panels) // 2)
    figure = Figure((WIDTH_IN, HEAD_IN + ROW_IN * rows), layout="constrained")
    figure.set_facecolor(style.PAPER)
    success = result.success
    title = (
        f"{result.robot}: {len(result.runs)} runs, {success.value:.1%} succeeded "
        f"({success.low:.1%} to {success.high:.1%})"
    )
    figure.suptitle(
        literal(title),
        fontsize=TEXT_PT + 1.0,
        fontweight="bold",
        color=style.INK,
        x=0.01,
        ha="left",
    )
    for k, draw in enumerate(panels):
        draw(figure.add_subplot(rows, 2, k + 1))
    return figure


def _over_time(result: StudyResult, name: str) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        found = envelope(np.asarray(result.runs.series[name], float), LEVELS)
        finite = found[np.isfinite(found)]
        top = 1.05 * float(finite.max()) if len(finite) and finite.max() > 0.0 else 1.0
        shown, t, colour = np.minimum(found, 1e3 * top), result.runs.t, COLOURS[name]
        for low, high, alpha in ((0, 4, 0.18), (1, 3, 0.35)):
            axes.fill_between(t, shown[low], shown[high], color=colour, alpha=alpha, lw=0)
        axes.plot(t, shown[2], color=colour, lw=style.LINE_WIDTH_PT)
        axes.set_ylim(0.0, top)
        axes.set_xlabel("time (s)")
        axes.set_ylabel("m")
        style_axes(axes, literal(f"{name.replace('_', ' ')}: median, 50 %, 90 % of runs"))

    return draw


def _distribution(axes: Axes, result: StudyResult) -> None:
    values = result.runs.merits[result.merit]
    known = np.isfinite(values)
    groups = [values[known & result.succeeded], values[known & ~result.succeeded]]
    axes.hist(groups, BINS, stacked=True, color=[style.BASE, style.TIP],
              label=["succeeded", "did not"])  # fmt: skip
    axes.set_xlabel(literal(f"{result.merit} ({result.units.get(result.merit) or '1'})"))
    axes.set_ylabel("runs")
    axes.legend(fontsize=SMALL_PT, frameon=False)
    style_axes(axes, literal(f"distribution of {result.merit}"))


def _importance(axes: Axes, result: StudyResult) -> None:
    found = result.sensitivity_of(result.merit)
    assert found is not None
    _, label = MEASURES[found.method]
    bars = measured_bars(found, MOST_BARS)[::-1]
    values = np.array([each.value for each in bars])
    ends = np.array([(each.value - each.low, each.high - each.value) for each in bars])
    whiskers = np.where(np.isfinite(ends), np.maximum(ends, 0.0), 0.0).T
    options: dict[str, Any] = {"ecolor": style.INK, "error_kw": {"lw": 0.8}}
    axes.barh(range(len(bars)), values, xerr=whiskers, color=style.BASE, height=0.6, **options)
    style_axes(axes, literal(f"what matters to {result.merit}"))
    axes.set_yticks(range(len(bars)), [literal(each.name) for each in bars], fontsize=SMALL_PT)
    axes.set_xlabel(label)


def _map(axes: Axes, result: StudyResult) -> None:
    found = result.maps[0]
    shown = np.ma.masked_invalid(found.median)
    drawn = axes.pcolormesh(found.x_edges, found.y_edges, shown, cmap="cividis")
    bar = axes.figure.colorbar(drawn, ax=axes)
    bar.ax.tick_params(labelsize=SMALL_PT)
    axes.set_xlabel(literal(found.x))
    axes.set_ylabel(literal(found.y))
    style_axes(axes, literal(f"median of {found.merit}"))
    axes.grid(False)
