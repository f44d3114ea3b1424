"""The picture of a region of attraction: at each place a rose, each petal a heading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.study.attraction import REACH_M, Ending, Fraction, fractions, placement
from rpctl.view.labels import literal
from rpctl.view.palette import light, mixed, rgb
from rpctl.view.plots import style
from rpctl.view.plots.style import SMALL_PT, TEXT_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL_IN, LEFT_IN, GAP_IN, HEAD_IN, FOOT_IN = 2.1, 0.55, 0.2, 0.72, 0.95  # inches
PETAL_FRACTION = 0.46  # of the distance between two places: the length of a petal
FIRST_S, LAST_S = 3.0, 60.0  # of the colours of converging starts: settled so soon, so late
FAST, SLOW = light("settled-early"), light("settled-late")  # the colours themselves
FAILED, REFUSED, UNDECIDED = light("failed"), light("refused"), light("undecided")
KEYS = {
    "did not converge, and says so": FAILED,
    "still on its way at the end": UNDECIDED,
    "the law does not take this reference": REFUSED,
}
ARROW: dict[str, Any] = {
    "arrowstyle": "-|>",
    "color": style.INK,
    "lw": 1.0,
    "shrinkA": 0,
    "shrinkB": 0,
}
CAPTION = (
    "A petal is a start: it lies where the robot stands, seen from its reference (the arrow),\n"
    "and points where the robot heads."
)
EDGE: dict[str, Any] = {"linewidth": 0.3, "edgecolor": style.PAPER}


@style.own_settings()
def attraction_figure(endings: Sequence[Ending], title: str) -> Figure:
    """Return the figure: a row of panels a law, a column a reference.

    At each place where the robot starts, seen from its reference, is a rose of petals; each petal
    points where the robot heads. The arrow is the reference, which heads to the right.

    Args:
        endings: Of the starts.
        title: What it is of.
    """
    from matplotlib.figure import Figure

    found = fractions(endings)
    laws = list(dict.fromkeys(each.kinematic for each in found))
    references = list(dict.fromkeys(each.reference for each in found))
    width = LEFT_IN + (PANEL_IN + GAP_IN) * len(references) + 0.1
    height = HEAD_IN + (PANEL_IN + 2.0 * GAP_IN) * len(laws) + FOOT_IN
    width = max(width, LEFT_IN + 2.0 * (PANEL_IN + GAP_IN))  # the legend's
    figure = Figure((width, height))
    figure.set_facecolor(style.PAPER)
    figure.text(0.1 / width, 1.0 - 0.2 / height, literal(title), va="top", fontsize=TEXT_PT + 1.0,
                fontweight="bold", color=style.INK)  # fmt: skip
    figure.text(0.1 / width, 1.0 - 0.4 / height, CAPTION, va="top", fontsize=SMALL_PT,
                color=style.DESIRED)  # fmt: skip
    for each in found:
        i, j = laws.index(each.kinematic), references.index(each.reference)
        left = LEFT_IN + j * (PANEL_IN + GAP_IN)
        bottom = height - HEAD_IN - (i + 1) * (PANEL_IN + 2.0 * GAP_IN) + GAP_IN
        place = (left / width, bottom / height, PANEL_IN / width, PANEL_IN / height)
        axes = figure.add_axes(place)
        group = [e for e in endings if (e.start.kinematic, e.start.reference) == each[:2]]
        _panel(axes, group, each, first=j == 0, last=i == len(laws) - 1)
    _key(figure, width, height)
    return figure


def _panel(
    axes: Axes, endings: Sequence[Ending], figures: Fraction, first: bool, last: bool
) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Wedge

    starts = [placement(ending.start.error) for ending in endings]
    apart = 2.0 * REACH_M / max(len({round(start.x, 6) for start in starts}) - 1, 1)
    half = 180.0 / len({round(start.heading, 6) for start in starts})
    petals, colours = [], []
    for (x, y, heading), ending in zip(starts, endings, strict=True):
        middle = math.degrees(heading)
        petals.append(Wedge((x, y), PETAL_FRACTION * apart, middle - half, middle + half))
        colours.append(_colour(ending))
    collection = PatchCollection(petals, facecolors=colours, **EDGE)
    axes.add_collection(collection)
    edge = REACH_M + 0.6 * apart
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal")
    axes.annotate("", (0.3, 0.0), (-0.3, 0.0), arrowprops=ARROW, zorder=4)
    axes.set_title(
        f"{literal(figures.kinematic)}, {literal(figures.reference)}: "
        f"{figures.converged} of {figures.starts}",
        fontsize=TEXT_PT, color=style.INK, pad=4,
    )  # fmt: skip
    axes.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2, labelleft=first)
    axes.tick_params(labelbottom=last)
    for spine in axes.spines.values():
        spine.set(color=style.FAINT)
    if first:
        axes.set_ylabel("to the left of its reference, m", fontsize=SMALL_PT, color=style.INK)
    if last:
        axes.set_xlabel("ahead of its reference, m", fontsize=SMALL_PT, color=style.INK)


def _colour(ending: Ending) -> str:
    if ending.outcome is None:
        return REFUSED
    if ending.failed:
        return FAILED
    return UNDECIDED if ending.settled_at is None else _between(ending.settled_at)


def _between(settled_at: float) -> str:
    """Return the colour of a converging start by when it settled (s), on a logarithmic scale."""
    part = math.log(max(settled_at, FIRST_S) / FIRST_S) / math.log(LAST_S / FIRST_S)
    return mixed(FAST, SLOW, min(part, 1.0))


def _key(figure: Figure, width: float, height: float) -> None:
    """Draw what the colours mean: a scale of times, and the words of the others."""
    scale = figure.add_axes((LEFT_IN / width, 0.33 / height, 1.5 / width, 0.09 / height))
    times = np.geomspace(FIRST_S, LAST_S, 64)
    scale.imshow([[rgb(_between(t)) for t in times.tolist()]], aspect="auto",
                 extent=(0.0, 1.0, 0.0, 1.0))  # fmt: skip
    ticks = [3, 6, 15, 30, 60]
    places = [math.log(t / FIRST_S) / math.log(LAST_S / FIRST_S) for t in ticks]
    scale.set(xticks=places, yticks=[])
    scale.set_xticklabels([str(t) for t in ticks], fontsize=SMALL_PT, color=style.INK)
    scale.tick_params(length=2)
    scale.set_title("within 5 cm from so many seconds on", fontsize=SMALL_PT, loc="left", pad=3,
                    color=style.INK)  # fmt: skip
    for k, (words, colour) in enumerate(KEYS.items()):
        at = 0.46 - 0.15 * k
        left = LEFT_IN + 1.8
        figure.text(left / width, at / height, "■", fontsize=SMALL_PT + 1.0, va="center",
                    color=colour)  # fmt: skip
        figure.text((left + 0.13) / width, at / height, words, fontsize=SMALL_PT, va="center",
                    color=style.INK)  # fmt: skip
