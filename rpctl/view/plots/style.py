"""How the figure of a run looks: colours, axes, legends."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.simulation.run.run import Run
from rpctl.view.labels import fold, literal, shorten
from rpctl.view.palette import LINES, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER, INK, FAINT = light("card"), light("ink"), light("line")  # background, text, grid
CYCLE = tuple(colour for colour, _ in LINES[:7])
BASE, TIP, DESIRED = light("base"), light("tip"), light("soft")
BASE_OBSTACLE, TIP_OBSTACLE = light("obstacles-base"), light("obstacles-tip")
TEXT_PT, SMALL_PT = 7.5, 6.5  # pt
LEGEND_PT = SMALL_PT - 0.5  # pt
COLUMN_GAP_IN = 5.0 * LEGEND_PT / 72.0  # inches: a legend's line, and what is between its columns
PT_PER_IN = 72.0
MAX_NAME_LENGTH = 34  # characters in one line of a legend: they fit into a column of a page
LINE_WIDTH_PT, JOINT_WIDTH_PT, THIN_JOINT_WIDTH_PT = 1.1, 1.0, 0.8  # pt
MAX_WIDE_JOINTS = 8  # the lines of more joints than this are thin
DESIRED_STYLE: dict[str, Any] = {"color": DESIRED, "lw": 0.8, "ls": (0, (3, 3)), "zorder": 3}
LIMIT_STYLE: dict[str, Any] = {"lw": 0.8, "ls": (0, (6, 3))}
MAX_POINTS = 12_000  # of one line: more cannot be told apart on paper
DASH_STYLES = ("-", (0, (4, 1.4)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))


@contextmanager
def own_settings() -> Iterator[None]:
    """Draw as rpctl does, whatever the user's settings: TeX reads no name, and lacks no glyph.

    A sign that the font lacks is drawn as a box; the warnings of it would name files of Matplotlib.
    """
    from matplotlib import rc_context

    with rc_context({"text.usetex": False}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)
        yield


def sampled(run: Run) -> Run:
    """Return a run with every n-th of its samples, so that at most ``MAX_POINTS`` remain."""
    step = -(-len(run.t) // MAX_POINTS)
    if step == 1:
        return run
    kept = {name: array[::step] for name, array in run.log.arrays().items()}
    return replace(run, log=run.log.changed(kept))


def line_style(colour: int, dash: int = 0, joints: int = 0) -> dict[str, Any]:
    """Return how a line is drawn: seven colours, repeated in four dash patterns.

    Args:
        colour: Its colour, by which a joint is the same in every panel.
        dash: Its dash pattern while the colours last.
        joints: Number of joints of the run if the line is a joint's, else 0.
    """
    turn, colour = divmod(colour, len(CYCLE))
    width = JOINT_WIDTH_PT if joints <= MAX_WIDE_JOINTS else THIN_JOINT_WIDTH_PT
    return {
        "color": CYCLE[colour],
        "ls": DASH_STYLES[(dash + turn) % len(DASH_STYLES)],
        "lw": width if joints else LINE_WIDTH_PT,
    }


def style_axes(axes: Axes, title: str) -> None:
    """Give a panel its title, grid, ticks and colours."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.set_title(title, loc="left", fontsize=TEXT_PT, fontweight="bold", color=INK, pad=4, y=1.0)
    axes.yaxis.set_offset_position("right")  # a factor such as 1e-5: not where the title is
    axes.set_facecolor(PAPER)
    axes.tick_params(labelsize=SMALL_PT, colors=INK, color=FAINT, length=2.5, pad=2)
    axes.grid(True, which="major", color=FAINT, lw=0.5)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(fontsize=SMALL_PT, color=INK)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=FAINT, linewidth=0.8)


def add_legend(axes: Axes, below: float = 0.0, title: str = "") -> int:
    """Add the legend of a panel whose lines have names of their own, in it or below it.

    Args:
        axes: The panel's axes.
        below: How wide it may be below the panel, inches; 0 where it stands in the panel.
        title: What its names share.

    Returns:
        Lines of text that stand below the panel.
    """
    axes.minorticks_off()
    handles, names = axes.get_legend_handles_labels()
    if not handles:
        return 0
    folded = [fold(name, MAX_NAME_LENGTH) for name in names]
    columns = _split(folded, below) if below else []
    place: dict[str, Any] = {"loc": "upper center", "ncols": len(columns)} if below else {}
    legend = axes.legend(
        handles,
        folded,
        **place,
        title=literal(title),
        title_fontsize=LEGEND_PT,
        fontsize=LEGEND_PT,
        labelcolor=INK,
        facecolor=PAPER,
        edgecolor="none",
        framealpha=0.8,
        borderpad=0.3,
        handlelength=1.8,
        labelspacing=0.25,
    )
    legend.set_zorder(5)
    lines = [[name.count("\n") + 1 for name in column] for column in columns]
    return sum(map(max, zip_longest(*lines, fillvalue=0))) + bool(columns and title)


def _split(names: Sequence[str], width: float) -> list[list[str]]:
    """Return the names in as many columns, three at most, as stand side by side in a width."""
    for count in range(min(3, len(names)), 1, -1):
        columns = [column.tolist() for column in np.array_split(np.array(names), count)]
        if sum(max(map(text_width, column)) + COLUMN_GAP_IN for column in columns) <= width:
            return columns
    return [list(names)]


def legend_columns(labels: Sequence[str], width: float, most: int, size: float = LEGEND_PT) -> int:
    """Return how many columns of a legend fit side by side.

    Args:
        labels: Its names.
        width: Of the figure, inches.
        most: Columns that are wanted.
        size: Of the text, pt.
    """
    column = max((text_width(label, size) for label in labels), default=0.0) + COLUMN_GAP_IN
    return max(1, min(most, len(labels), int(width / column)))


def text_width(text: str, size: float = LEGEND_PT) -> float:
    """Return the width of the widest line of a text of a size (pt), inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font, lines = FontProperties(size=size), [line for line in literal(text).split("\n") if line]
    sizes = (text_to_path.get_text_width_height_descent(line, font, ismath=False) for line in lines)
    return max((float(width) for width, *_ in sizes), default=0.0) / PT_PER_IN


def joint_names(joints: Sequence[str]) -> tuple[list[str], str]:
    """Return the joints' names as a legend has them, and the title that says what they share."""
    short = shorten(joints)
    return [fold(name, MAX_NAME_LENGTH) for name in short.names], short.shared


def joint_legend(figure: Figure, joints: Sequence[str], columns: int) -> None:
    """Add the legend of joints, common to all panels, below them.

    Args:
        figure: The figure.
        joints: The joints in the order of their colours.
        columns: Names in a row.
    """
    from matplotlib.lines import Line2D

    names, title = joint_names(joints)
    handles = [
        Line2D([], [], label=literal(name), **line_style(colour, joints=len(joints)))
        for colour, name in enumerate(names)
    ]
    if handles:
        figure.legend(
            handles=handles,
            loc="lower center",
            borderaxespad=0.0,
            ncols=columns,
            title=literal(title),
            title_fontsize=LEGEND_PT,
            fontsize=LEGEND_PT,
            labelcolor=INK,
            frameon=False,
            handlelength=2.4,
            columnspacing=1.4,
            labelspacing=0.3,
        )
