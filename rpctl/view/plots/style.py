"""How the figure of a run looks: colours, axes, legends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rpctl.arrays import Array
from rpctl.view.charts import short_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER, INK, FAINT = "#ffffff", "#1a1d21", "#e3e6ea"  # background, text, grid
CYCLE = (  # of lines; after Okabe and Ito, told apart by the colour-blind
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#7A6A53",
)
BASE, TIP = CYCLE[:2]
DESIRED = "#5c6470"
BASE_OBSTACLE, TIP_OBSTACLE = "#b0325f", "#9a6a00"
TEXT_PT, SMALL_PT = 7.5, 6.5  # pt
LINE_WIDTH_PT, JOINT_WIDTH_PT, THIN_JOINT_WIDTH_PT = 1.1, 1.0, 0.8  # pt
MAX_WIDE_JOINTS = 8  # the lines of more joints than this are thin
DESIRED_STYLE: dict[str, Any] = {"color": DESIRED, "lw": 0.8, "ls": (0, (3, 3)), "zorder": 3}
LIMIT_STYLE: dict[str, Any] = {"lw": 0.8, "ls": (0, (6, 3))}
MAX_POINTS = 12_000  # of one line: more cannot be told apart on paper
DASH_STYLES = ("-", (0, (4, 1.4)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))


def thin(values: Array) -> Array:
    """Return every n-th of samples (K, ...), so that at most ``MAX_POINTS`` remain."""
    return values[:: -(-len(values) // MAX_POINTS)]


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
    axes.set_title(title, loc="left", fontsize=TEXT_PT, fontweight="bold", color=INK, pad=4)
    axes.set_facecolor(PAPER)
    axes.tick_params(labelsize=SMALL_PT, colors=INK, color=FAINT, length=2.5, pad=2)
    axes.grid(True, which="major", color=FAINT, lw=0.5)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(fontsize=SMALL_PT, color=INK)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=FAINT, linewidth=0.8)


def add_legend(axes: Axes, below: bool = False) -> None:
    """Add the legend of a panel whose lines have names of their own, in it or below it."""
    axes.minorticks_off()
    entries = len(axes.get_legend_handles_labels()[0])
    if not entries:
        return
    place: dict[str, Any] = {}
    if below:
        place = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, -0.16),
            "ncols": 3 if entries <= 6 else 2,
        }
    legend = axes.legend(
        **place,
        fontsize=SMALL_PT - 0.5,
        labelcolor=INK,
        facecolor=PAPER,
        edgecolor="none",
        framealpha=0.8,
        borderpad=0.3,
        handlelength=1.8,
        labelspacing=0.25,
    )
    legend.set_zorder(5)


def joint_legend(figure: Figure, joints: Sequence[str], columns: int) -> None:
    """Add the legend of joints, common to all panels, below them.

    Args:
        figure: The figure.
        joints: The joints in the order of their colours.
        columns: Most names in a row.
    """
    from matplotlib.lines import Line2D

    handles = []
    for colour, joint in enumerate(joints):
        name = short_name(joint).replace("$", r"\$")  # a dollar would start a formula
        handles.append(Line2D([], [], label=name, **line_style(colour, joints=len(joints))))
    if handles:
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=min(columns, len(handles)),
            fontsize=SMALL_PT - 0.5,
            labelcolor=INK,
            frameon=False,
            handlelength=2.4,
            columnspacing=1.4,
            labelspacing=0.3,
        )
