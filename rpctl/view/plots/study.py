"""The picture of a benchmark: a panel for each scenario and reference, a line for each law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rpctl.study.compare import PAPER, LawPair, Row, group_rows
from rpctl.view.labels import literal
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.style import (
    COLUMN_GAP_IN,
    SMALL_PT,
    TEXT_PT,
    legend_columns,
    text_width,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS_WIDTH_IN, PANEL_WIDTH_IN = 1.55, 0.92  # widths, inches; of longer labels it is more
LAW_PT, LAW_GAP_IN = SMALL_PT - 1.2, 0.15  # of a law's name: its size, and the gap around it
LEGEND_ROW_IN = 0.14  # inches
LINE_HEIGHT_IN, GAP_IN, HEAD_IN, FOOT_IN = 0.115, 0.16, 0.52, 0.62  # heights, inches
MM_PER_M = 1e3  # mm of a m
AXIS_MARGIN_RATIO = 1.6  # times the extreme errors: where the axis ends
NARROW_SPAN_RATIO = 50.0  # times the least value of an axis: up to there 3 is marked, too
GREY = light("lost")
TITLE_STYLE: dict[str, Any] = {"fontsize": TEXT_PT, "fontweight": "bold", "color": style.INK}
Colours = dict[LawPair, str]  # of the two that matter
BROKEN_LIMIT_STYLE: dict[str, Any] = {"marker": "^", "color": style.INK, "ms": 3.0, "ls": ""}


@style.own_settings()
def study_figure(rows: Sequence[Row], title: str, proposed: LawPair) -> Figure:
    """Return the figure: rms errors of base and end effector; one axis a reference.

    Args:
        rows: The rows of a grid.
        title: What it is of.
        proposed: The controller that rpctl proposes.
    """
    from matplotlib.figure import Figure

    scenarios = list(dict.fromkeys(row.cell.scenario for row in rows))
    references = list(dict.fromkeys(row.cell.reference for row in rows))
    laws = list(dict.fromkeys(row.cell.controller for row in rows))
    panel_height = LINE_HEIGHT_IN * (len(laws) + 1)
    looks = _looks(proposed)
    law_width = LAW_GAP_IN + max(text_width(str(law), LAW_PT) for law in laws)
    labels_width = max(LABELS_WIDTH_IN, law_width)
    widest_key = COLUMN_GAP_IN + max(text_width(label, SMALL_PT) for label in looks)
    width = max(labels_width + PANEL_WIDTH_IN * len(references) + 0.15, widest_key)
    columns = legend_columns(list(looks), width, len(looks), SMALL_PT)
    more = LEGEND_ROW_IN * (-(-len(looks) // columns) - 1)  # rows of the legend
    height = HEAD_IN + (panel_height + GAP_IN) * len(scenarios) + FOOT_IN + more
    figure = Figure((width, height))
    figure.set_facecolor(style.PAPER)
    colours = {PAPER: style.TIP, proposed: style.BASE}
    groups = dict(group_rows(rows))
    spans = {name: _span([r for r in rows if r.cell.reference == name]) for name in references}
    for i, scenario in enumerate(scenarios):
        for j, reference in enumerate(references):
            left = labels_width + j * PANEL_WIDTH_IN + 0.04
            bottom = height - HEAD_IN - (i + 1) * panel_height - i * GAP_IN
            size = (PANEL_WIDTH_IN - 0.08) / width, panel_height / height
            axes = figure.add_axes((left / width, bottom / height, *size))
            shown, last = groups.get((scenario, reference), []), i == len(scenarios) - 1
            _panel(axes, shown, laws, colours, spans[reference], last)
            if i == 0:
                axes.set_title(literal(reference), pad=5, **TITLE_STYLE)
            if j == 0:
                _names(axes, scenario, laws, colours, labels_width)
    middle = labels_width + 0.5 * PANEL_WIDTH_IN * len(references)
    figure.text(middle / width, (0.36 + more) / height, "rms error, mm (logarithmic)", ha="center",
                fontsize=SMALL_PT, color=style.INK)  # fmt: skip
    heading = {**TITLE_STYLE, "fontsize": TEXT_PT + 1}
    figure.text(0.08 / width, 1.0 - 0.16 / height, literal(title), va="center", **heading)
    _legend(figure, height, looks, columns)
    return figure


def _span(rows: Sequence[Row]) -> tuple[float, float]:
    """Return the ends of the axis of one reference, mm."""
    errors = [
        MM_PER_M * error
        for row in rows
        if row.figures is not None
        for error in (row.figures.rms_base, row.figures.rms_end_effector)
        if error
    ]
    return (
        (min(errors) / AXIS_MARGIN_RATIO, max(errors) * AXIS_MARGIN_RATIO)
        if errors
        else (1.0, 10.0)
    )


def _panel(
    axes: Axes,
    rows: Sequence[Row],
    laws: Sequence[LawPair],
    colours: Colours,
    span: tuple[float, float],
    last: bool,
) -> None:
    """Draw a dot for the base and a ring for the end effector of each law, from the top down."""
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

    axes.set_xscale("log")
    axes.set_xlim(*span)
    axes.set_ylim(len(laws), -1)
    axes.set_facecolor(style.PAPER)
    axes.yaxis.set_major_locator(NullLocator())
    steps = (1.0, 3.0) if span[1] < NARROW_SPAN_RATIO * span[0] else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=4))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(True, axis="x", color=style.FAINT, lw=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelsize=SMALL_PT - 1, colors=style.INK, pad=2)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}") if last else NullFormatter())
    for spine in axes.spines.values():
        spine.set(color=style.FAINT, linewidth=0.6)
    for row in rows:
        colour = colours.get(row.cell.controller, GREY)
        _mark(axes, row, laws.index(row.cell.controller), colour, span)


def _mark(axes: Axes, row: Row, line: int, colour: str, span: tuple[float, float]) -> None:
    figures = row.figures
    if figures is None:
        axes.plot([span[1] / AXIS_MARGIN_RATIO**0.35], [line], "x", color=GREY, ms=3.6, mew=1.0)
        return
    base, tip = figures.rms_base, figures.rms_end_effector
    if tip:
        axes.plot([MM_PER_M * base, MM_PER_M * tip], [line, line], color=colour, lw=0.8, zorder=2)
        axes.plot([MM_PER_M * tip], [line], "o", mfc=style.PAPER, mec=colour, mew=0.9, ms=3.4)
    axes.plot([MM_PER_M * base], [line], "o", color=colour, ms=3.6, zorder=4)
    if figures.violations:
        axes.plot([span[0] * AXIS_MARGIN_RATIO**0.35], [line], **BROKEN_LIMIT_STYLE)


def _names(
    axes: Axes, scenario: str, laws: Sequence[LawPair], colours: Colours, width: float
) -> None:
    """Write the scenario and the names of its lines left of a panel."""
    for line, law in enumerate(laws):
        axes.annotate(str(law), (0, line), (-4, 0), ("axes fraction", "data"), "offset points",
                      ha="right", va="center", fontsize=LAW_PT,
                      color=style.INK if law in colours else style.DESIRED)  # fmt: skip
    left = -width * style.PT_PER_IN + 4
    axes.annotate(scenario, (0, 1), (left, 1), "axes fraction", "offset points", ha="left",
                  va="bottom", **TITLE_STYLE)  # fmt: skip


def _looks(proposed: LawPair) -> dict[str, dict[str, Any]]:
    """Return how the marks of the legend look, by their labels."""
    ring = {"marker": "o", "mfc": style.PAPER, "color": style.INK, "ms": 3.4, "ls": ""}
    return {
        f"{proposed} (rpctl's)": {"marker": "o", "color": style.BASE, "ms": 3.6},
        f"{PAPER} (the paper's)": {"marker": "o", "color": style.TIP, "ms": 3.6},
        "others": {"marker": "o", "color": GREY, "ms": 3.6},
        "base": {"marker": "o", "color": style.INK, "ms": 3.6, "ls": ""},
        "end effector": ring,
        "did not run": {"marker": "x", "color": GREY, "ms": 3.6, "ls": ""},
        "broke a limit": BROKEN_LIMIT_STYLE,
    }


def _legend(figure: Figure, height: float, looks: dict[str, dict[str, Any]], columns: int) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=label, lw=0.8, **look) for label, look in looks.items()]
    figure.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.04 / height),
                  ncols=columns, fontsize=SMALL_PT, labelcolor=style.INK, frameon=False,
                  handlelength=1.6, columnspacing=1.4)  # fmt: skip
