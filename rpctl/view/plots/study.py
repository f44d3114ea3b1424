"""The picture of a benchmark: a panel for each scenario and reference, a line for each law."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rpctl.study.cells import Figures
from rpctl.study.compare import PAPER, CompareRow, LawPair, group_rows
from rpctl.view.labels import literal
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.style import SMALL_PT, TEXT_PT

LEFT_IN, PANEL_IN, LINE_IN, HEAD_IN = 1.7, 0.95, 0.125, 1.3  # inches
LEFT_ROOM = 0.06  # of a linear axis: left of zero, for what stands at its edge
MM_PER_M = 1e3  # mm of a m
GREY = light("lost")
BOLD: dict[str, Any] = {"fontsize": TEXT_PT, "fontweight": "bold", "color": style.INK}
DOT: dict[str, Any] = {"marker": "o", "ms": 3.6, "lw": 0.8}
RING: dict[str, Any] = {"marker": "o", "ms": 3.4, "mfc": style.PAPER, "mew": 0.9, "ls": ""}
LOST: dict[str, Any] = {"marker": "x", "ms": 3.6, "color": GREY, "ls": ""}
BROKEN: dict[str, Any] = {"marker": "^", "ms": 3.0, "color": style.INK, "ls": ""}


@style.own_settings()
def study_figure(
    rows: Sequence[CompareRow], title: str, proposed: LawPair, log: bool = False
) -> Figure:
    """Return the figure: rms errors of base and end effector; one axis a reference.

    Args:
        rows: The rows of a grid.
        title: What it is of.
        proposed: The controller that rpctl proposes.
        log: Whether the axes of errors are logarithmic.
    """
    groups = group_rows(rows)
    scenarios, references = (list(dict.fromkeys(each)) for each in zip(*groups, strict=True))
    laws = list(dict.fromkeys(row.cell.controller for row in rows))
    size = (
        LEFT_IN + PANEL_IN * max(3, len(references)),
        HEAD_IN + LINE_IN * (len(laws) + 2) * len(scenarios),
    )
    figure = Figure(size, layout="constrained", facecolor=style.PAPER)
    panels = figure.subplots(
        len(scenarios), len(references), squeeze=False, sharex="col", sharey=True
    )
    colours = {PAPER: style.TIP, proposed: style.BASE}
    for line, scenario in zip(panels, scenarios, strict=True):
        line[0].set_ylabel(literal(scenario), **BOLD)
        for axes, reference in zip(line, references, strict=True):
            _style(axes, laws, colours, log)
            for row in groups.get((scenario, reference), []):
                law = row.cell.controller
                _mark(axes, row.figures, laws.index(law), colours.get(law, GREY))
    for axes, reference in zip(panels[0], references, strict=True):
        axes.set_title(literal(Path(reference).name), pad=5, **BOLD)
    figure.suptitle(literal(title), x=0.01, ha="left", **BOLD)
    for axes in () if log else panels[0]:
        axes.set_xlim(left=-LEFT_ROOM * axes.get_xlim()[1])
    known = {PAPER: "the paper's", proposed: "rpctl's"}
    named = {f"{law} ({whose})": colours[law] for law, whose in known.items() if law in laws}
    _legend(figure, named, log)
    return figure


def _style(axes: Axes, laws: Sequence[LawPair], colours: dict[LawPair, str], log: bool) -> None:
    """Give a panel its axis, and a line for each law, from the top down."""
    axes.set(xscale="log" if log else "linear", ylim=(len(laws) - 0.4, -0.6), facecolor=style.PAPER)
    axes.set_yticks(range(len(laws)), [literal(str(law)) for law in laws])
    axes.margins(x=0.12)
    axes.grid(True, axis="x", color=style.FAINT, lw=0.5)
    axes.set_axisbelow(True)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.tick_params(length=0, labelsize=SMALL_PT - 1, colors=style.INK, pad=2)
    for label, law in zip(axes.get_yticklabels(), laws, strict=False):  # the first column
        label.set_color(style.INK if law in colours else style.DESIRED)
    axes.spines[:].set(color=style.FAINT, linewidth=0.6)


def _mark(axes: Axes, figures: Figures, line: int, colour: str) -> None:
    """Draw a dot for the base and a ring for the end effector; what failed is at an edge."""
    edge = axes.get_yaxis_transform()
    if figures.failure is not None or figures.rms_base is None:
        axes.plot([0.95], [line], transform=edge, **LOST)
        return
    base, tip = MM_PER_M * figures.rms_base, figures.rms_end_effector
    if tip:
        axes.plot([base, MM_PER_M * tip], [line, line], color=colour, lw=0.8, zorder=2)
        axes.plot([MM_PER_M * tip], [line], mec=colour, **RING)
    axes.plot([base], [line], color=colour, zorder=4, **DOT)
    if figures.violations:
        axes.plot([0.05], [line], transform=edge, **BROKEN)


def _legend(figure: Figure, named: dict[str, str], log: bool) -> None:
    looks = {
        **{name: {**DOT, "color": colour} for name, colour in named.items()},
        "others": {**DOT, "color": GREY},
        "base": {**DOT, "color": style.INK, "ls": ""},
        "end effector": {**RING, "color": style.INK},
        "did not run": LOST,
        "broke a limit": BROKEN,
    }
    handles = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    title = "rms error, mm (logarithmic)" if log else "rms error, mm"
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=SMALL_PT,
                  labelcolor=style.INK, frameon=False, handlelength=1.6,
                  title=title, title_fontsize=SMALL_PT)  # fmt: skip
