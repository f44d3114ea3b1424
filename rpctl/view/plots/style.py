"""How the figure of a run looks: colours, axes, legends."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.textpath import text_to_path
from matplotlib.ticker import MaxNLocator

from rpctl.arrays import Array
from rpctl.simulation.run.run import Run
from rpctl.view.labels import fold, literal, shorten
from rpctl.view.palette import LINES, light

PAPER, INK, FAINT = light("card"), light("ink"), light("line")  # background, text, grid
CYCLE = tuple(colour for colour, _ in LINES[:7])
BASE, TIP, DESIRED = light("base"), light("tip"), light("soft")
BASE_OBSTACLE, TIP_OBSTACLE = light("obstacles-base"), light("obstacles-tip")
TEXT_PT, SMALL_PT = 7.5, 6.5  # pt
LEGEND_PT = SMALL_PT - 0.5  # pt
COLUMN_GAP_IN = 5.0 * LEGEND_PT / 72.0  # inches: a legend's line, and what is between its columns
PT_PER_IN = 72.0
LEGEND_ROW_IN = 0.14  # inches: height of a legend's line
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
    with rc_context({"text.usetex": False}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)
        yield


def placed(points: Array, pose: Sequence[float] | Array) -> Array:
    """Return points (n, 2) of the root link's frame on the floor, m, at its pose (3,)."""
    x, y, turn = pose
    cos, sin = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]) + [x, y])


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
    columns = legend_columns(folded, below, 3) if below else 1
    place: dict[str, Any] = {"facecolor": PAPER, "edgecolor": "none", "framealpha": 0.8}
    if below:
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False}
    legend = axes.legend(
        handles, folded, **place, **_legend_style(title), ncols=columns, handlelength=1.8
    )
    legend.set_zorder(5)
    return _lines(folded, columns, title) if below else 0


def legend_columns(names: Sequence[str], width: float, most: int, size: float = LEGEND_PT) -> int:
    """Return how many columns of a legend fit side by side.

    Args:
        names: Its names.
        width: Of the figure, inches.
        most: Columns that are wanted.
        size: Of the text, pt.
    """
    column = max((text_width(name, size) for name in names), default=0.0) + COLUMN_GAP_IN
    return max(1, min(most, len(names), int(width / column)))


def _lines(names: Sequence[str], columns: int, title: str) -> int:
    """Return the lines of text of a legend."""
    rows = -(-len(names) // columns)
    return rows * max((name.count("\n") + 1 for name in names), default=0) + bool(title)


def _legend_style(title: str) -> dict[str, Any]:
    return {
        "title": literal(title),
        "title_fontsize": LEGEND_PT,
        "fontsize": LEGEND_PT,
        "labelcolor": INK,
        "labelspacing": 0.3,
    }


def text_width(text: str, size: float = LEGEND_PT) -> float:
    """Return the width of the widest line of a text of a size (pt), inches."""
    font, lines = FontProperties(size=size), [line for line in literal(text).split("\n") if line]
    sizes = (text_to_path.get_text_width_height_descent(line, font, ismath=False) for line in lines)
    return max((float(width) for width, *_ in sizes), default=0.0) / PT_PER_IN


def joint_legend(figure: Figure, joints: Sequence[str], width: float, most: int) -> float:
    """Add the legend of joints, common to all panels, below them; return its height, inches.

    Args:
        figure: The figure.
        joints: The joints in the order of their colours.
        width: Of the figure, inches.
        most: Names in a row.
    """
    if not joints:
        return 0.0
    short = shorten(joints)
    names = [fold(name, MAX_NAME_LENGTH) for name in short.names]
    columns = legend_columns(names, width, most)
    handles = [
        Line2D([], [], label=literal(name), **line_style(colour, joints=len(joints)))
        for colour, name in enumerate(names)
    ]
    place: dict[str, Any] = {"loc": "outside lower center", "frameon": False, "columnspacing": 1.4}
    figure.legend(
        handles=handles, **place, **_legend_style(short.shared), ncols=columns, handlelength=2.4
    )
    return LEGEND_ROW_IN * _lines(names, columns, short.shared)
