"""The picture of the speed table: bars on logarithmic scales, rpctl's in colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import (
    BASE,
    DESIRED,
    FAINT,
    INK,
    PAPER,
    SMALL_PT,
    TEXT_PT,
    own_settings,
)
from tests.bench.rows import MORE_IS_BETTER, Row, Section, in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN, BAR_IN, PANEL_IN, LEFT_IN, RIGHT_IN = 7.0, 0.2, 0.56, 1.8, 0.25
HEAD_IN = 0.25
CAPTION = "rpctl in blue, others in grey; the slowest first; logarithmic scales"
DPI = 160
PEER = "#b9c0c8"  # of bars that are not rpctl's
DECADES_BELOW = 0.35  # left of the shortest bar, so that it has a length


class Bar(NamedTuple):
    """A bar: its label, the row that it is, and whether it is rpctl's."""

    label: str
    name: str
    own: bool = True


class Panel(NamedTuple):
    """Bars of one unit."""

    title: str
    bars: tuple[Bar, ...]


PANELS = (
    Panel(
        "One forward step of TIAGo",
        (
            Bar("first draft in NumPy", "tiago: first draft in NumPy", False),
            Bar("Drake, projected by NumPy", "tiago: Drake", False),
            Bar("ReducedDynamics.forward", "tiago: `ReducedDynamics.forward`"),
            Bar("MuJoCo mj_forward, free tree", "tiago: MuJoCo `mj_forward`", False),
            Bar("Pinocchio's crba + rnea, the floor", "tiago: floor", False),
            Bar("machine code, 1 lane", "tiago: machine code, 1 lane"),
            Bar("machine code, 8 lanes, each", "tiago: machine code, 8 lanes"),
        ),
    ),
    Panel(
        "One closed loop of TIAGo at 2 ms",
        (
            Bar("rpctl in Python, with its log", "the same in Python"),
            Bar("MuJoCo, controller in Python", "MuJoCo, controller in Python", False),
            Bar("track, all it does, compiled", "`track`, all it does, compiled"),
            Bar("compiled, with its log", "the loop with its log, compiled"),
        ),
    ),
    Panel(
        "1000 runs of TIAGo, 10 s at 1 kHz, one core",
        (
            Bar("MuJoCo's rollout, open loop", "MuJoCo's rollout, open loop", False),
            Bar("rpctl.rollout, closed loop", "1000 runs of 10 s at 1 kHz, TIAGo"),
        ),
    ),
    Panel(
        "Whole processes",
        (
            Bar("import numpy, pinocchio", "`import numpy, pinocchio`", False),
            Bar("rpctl inspect tiago", "`rpctl inspect tiago`"),
            Bar("rpctl verify tiago", "`rpctl verify tiago`"),
            Bar("rpctl track tiago, 10 s", "`rpctl track tiago --duration 10`"),
        ),
    ),
)


def speed_picture(sections: Sequence[Section]) -> bytes:
    """Return the picture as PNG; bars that were not measured are left out.

    Args:
        sections: The whole table.
    """
    from matplotlib.figure import Figure

    rows = {row.name: row for section in sections for row in section.rows}
    drawn = []
    for panel in PANELS:
        bars = [(bar, rows[bar.name]) for bar in panel.bars if bar.name in rows]
        bars.sort(key=lambda pair: _slowness(pair[1]), reverse=True)
        if bars:
            drawn.append((panel.title, bars))
    height = sum(PANEL_IN + BAR_IN * len(bars) for _, bars in drawn) + HEAD_IN
    with own_settings():
        figure = Figure(figsize=(WIDTH_IN, max(height, 1.0)), facecolor=PAPER)
        top = height - HEAD_IN
        figure.text(
            LEFT_IN / WIDTH_IN, 1.0 - 0.2 / height, CAPTION, fontsize=SMALL_PT, color=DESIRED
        )
        for title, bars in drawn:
            top -= PANEL_IN - 0.2
            size = BAR_IN * len(bars)
            place = (
                LEFT_IN / WIDTH_IN,
                (top - size) / height,
                1.0 - (LEFT_IN + RIGHT_IN) / WIDTH_IN,
                size / height,
            )
            _draw(figure.add_axes(place), title, bars)
            top -= size + 0.2
        return to_png(figure, DPI)


def _slowness(row: Row) -> float:
    return -row.figure if row.unit in MORE_IS_BETTER else row.figure


def _draw(axes: Axes, title: str, bars: Sequence[tuple[Bar, Row]]) -> None:
    """Draw a panel."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    figures = [row.figure for _, row in bars]
    low, high = min(figures) / 10**DECADES_BELOW, max(figures)
    unit = bars[0][1].unit
    better = "longer is faster" if unit in MORE_IS_BETTER else "shorter is faster"
    for place, (bar, row) in enumerate(bars):
        axes.barh(place, row.figure - low, left=low, height=0.66, color=BASE if bar.own else PEER)
        axes.annotate(
            in_words(row.figure),
            (row.figure, place),
            (3.0, 0.0),
            textcoords="offset points",
            va="center",
            fontsize=SMALL_PT,
            color=INK,
            fontweight="bold" if bar.own else "normal",
        )
    axes.set_xscale("log")
    axes.set_xlim(low, high * (high / low) ** 0.12)
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.set_yticks(range(len(bars)), [bar.label for bar, _ in bars])
    axes.set_title(title, loc="left", fontsize=TEXT_PT, fontweight="bold", color=INK, pad=4)
    axes.set_title(f"{unit}, {better}", loc="right", fontsize=SMALL_PT, color=DESIRED, pad=4)
    axes.xaxis.set_major_locator(LogLocator())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.tick_params(labelsize=SMALL_PT, colors=INK, color=FAINT, length=0.0, pad=3)
    axes.set_facecolor(PAPER)
    axes.grid(True, axis="x", color=FAINT, lw=0.5)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
