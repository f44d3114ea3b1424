"""How the figure of a run looks: colours, axes, legends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rpctl.arrays import Array
from rpctl.simulation.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TEXT_PT, SMALL_PT = 7.5, 6.5  # pt
MAX_WIDE_LINES = 8  # more lines than this are drawn thinner
DESIRED_STYLE: dict[str, Any] = {"lw": 0.8, "ls": (0, (3, 3)), "zorder": 3}
LIMIT_STYLE: dict[str, Any] = {"lw": 0.8, "ls": (0, (6, 3))}
MAX_POINTS = 12_000  # of one line: more cannot be told apart on paper
DASH_STYLES = ("-", (0, (4, 1.4)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))


@dataclass(frozen=True)
class Theme:
    """Colours of a figure: paper, ink, grid, and what is drawn."""

    paper: str
    ink: str
    faint: str
    desired: str
    base: str
    tip: str
    third: str
    base_obstacle: str
    tip_obstacle: str
    cycle: tuple[str, ...]  # of the joints; after Okabe and Ito, told apart by the colour-blind


LIGHT = Theme(
    paper="#ffffff",
    ink="#1a1d21",
    faint="#e3e6ea",
    desired="#5c6470",
    base="#0072B2",
    tip="#D55E00",
    third="#009E73",
    base_obstacle="#b0325f",
    tip_obstacle="#9a6a00",
    cycle=("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7A6A53"),
)


def thin(values: Array) -> Array:
    """Return as many samples as a line needs."""
    return values[:: -(-len(values) // MAX_POINTS)]


def names(run: Run, theme: Theme) -> list[tuple[str, dict[str, Any]]]:
    """Return the actuators and joints of the common legend, each with its look."""
    names = dict.fromkeys((*run.robot.actuators, *run.robot.joint_names))
    return [(short_name(name), joint_style(run, name, theme)) for name in names]


def short_name(name: str) -> str:
    """Return a joint's name for a legend, where a dollar would start a formula."""
    return name.removesuffix("_joint").replace("$", r"\$")


def joint_style(run: Run, name: str, theme: Theme) -> dict[str, Any]:
    """Return how a joint is drawn, the same in every panel: seven colours in four dashes."""
    names = list(dict.fromkeys((*run.robot.actuators, *run.robot.joint_names)))
    turn, colour = divmod(names.index(name), len(theme.cycle))
    width = 1.0 if len(names) <= MAX_WIDE_LINES else 0.8
    return {"color": theme.cycle[colour], "ls": DASH_STYLES[turn % len(DASH_STYLES)], "lw": width}


def style_axes(axes: Axes, title: str, theme: Theme) -> None:
    """Give a panel its title, grid, ticks and colours."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.set_title(title, loc="left", fontsize=TEXT_PT, fontweight="bold", color=theme.ink, pad=4)
    axes.set_facecolor(theme.paper)
    axes.tick_params(labelsize=SMALL_PT, colors=theme.ink, color=theme.faint, length=2.5, pad=2)
    axes.grid(True, which="major", color=theme.faint, lw=0.5)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(fontsize=SMALL_PT, color=theme.ink)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=theme.faint, linewidth=0.8)


def add_legend(axes: Axes, theme: Theme, below: bool = False) -> None:
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
        labelcolor=theme.ink,
        facecolor=theme.paper,
        edgecolor="none",
        framealpha=0.8,
        borderpad=0.3,
        handlelength=1.8,
        labelspacing=0.25,
    )
    legend.set_zorder(5)


def joint_legend(
    figure: Figure, names: Sequence[tuple[str, dict[str, Any]]], columns: int, theme: Theme
) -> None:
    """Add the names of wheels and joints below the panels, which all share their looks."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=name, **joint_style) for name, joint_style in names]
    if handles:
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=min(columns, len(handles)),
            fontsize=SMALL_PT - 0.5,
            labelcolor=theme.ink,
            frameon=False,
            handlelength=2.4,
            columnspacing=1.4,
            labelspacing=0.3,
        )
