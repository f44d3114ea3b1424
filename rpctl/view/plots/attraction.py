"""The picture of a region of attraction: at each place a rose, each petal a heading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Wedge

from rpctl.study.attraction import REACH_M, Fraction, Start, converged, failed, fractions, placement
from rpctl.study.cells import REFUSED, Figures, Row
from rpctl.view.labels import literal
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.style import SMALL_PT, TEXT_PT

PANEL_IN, HEAD_IN = 2.4, 1.3  # inches
PETAL_FRACTION = 0.46  # of the distance between two places: the length of a petal
TICKS_S = (3, 6, 15, 30, 60)  # of the colours of converging starts: settled so soon to so late
FAST, SLOW = light("settled-early"), light("settled-late")  # the colours themselves
FAILED, NOT_TAKEN, UNDECIDED = light("failed"), light("refused"), light("undecided")
KEYS = {
    "did not converge": FAILED,
    "undecided at the end": UNDECIDED,
    "the law cannot follow this reference": NOT_TAKEN,
}
ARROW: dict[str, Any] = {"arrowstyle": "-|>", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
CAPTION = (
    "Each petal is a start: its position is that of the robot relative to its reference (the\n"
    "arrow), its direction the robot's heading."
)
SMALL: dict[str, Any] = {"fontsize": SMALL_PT, "color": style.INK}


@style.own_settings()
def attraction_figure(rows: Sequence[Row[Start]], title: str) -> Figure:
    """Return the figure: a row of panels a law, a column a reference.

    At each place where the robot starts, seen from its reference, is a rose of petals; each petal
    points where the robot heads. The arrow is the reference, which heads to the right.

    Args:
        rows: What became of the starts.
        title: What it is of.
    """
    found = fractions(rows)
    laws = list(dict.fromkeys(each.kinematic for each in found))
    references = list(dict.fromkeys(each.reference for each in found))
    size = PANEL_IN * max(2, len(references)), HEAD_IN + PANEL_IN * len(laws)
    figure = Figure(size, layout="constrained", facecolor=style.PAPER)
    panels = figure.subplots(len(laws), len(references), squeeze=False, sharex=True, sharey=True)
    times = time_colours()
    for each in found:
        axes = panels[laws.index(each.kinematic), references.index(each.reference)]
        key = each.kinematic, each.reference
        group = [row for row in rows if (row.cell.kinematic, row.cell.run.reference) == key]
        _panel(axes, group, each, times)
    figure.suptitle(literal(title), x=0.02, ha="left", fontsize=TEXT_PT + 1.0,
                    fontweight="bold", color=style.INK)  # fmt: skip
    for axes in panels[:, 0]:
        axes.set_ylabel("to the left of its reference, m", **SMALL)
    for axes in panels[-1]:
        axes.set_xlabel("ahead of its reference, m", **SMALL)
    scale = figure.colorbar(times, ax=panels, location="top", aspect=50, ticks=TICKS_S)
    scale.ax.set_xticklabels([str(t) for t in TICKS_S], **SMALL)
    scale.ax.minorticks_off()
    scale.set_label("seconds until it stays within 5 cm (logarithmic)", **SMALL)
    handles = [Patch(color=colour, label=words) for words, colour in KEYS.items()]
    figure.legend(handles=handles, loc="outside lower center", frameon=False, fontsize=SMALL_PT,
                  title=CAPTION, title_fontsize=SMALL_PT)  # fmt: skip
    return figure


def time_colours() -> ScalarMappable:
    """Return the colours of converging starts by when they settled (s), on a logarithmic scale."""
    ramp = LinearSegmentedColormap.from_list("settled", [FAST, SLOW])
    return ScalarMappable(LogNorm(TICKS_S[0], TICKS_S[-1], clip=True), ramp)


def _panel(axes: Axes, rows: Sequence[Row[Start]], found: Fraction, times: ScalarMappable) -> None:
    starts = [placement(row.cell.run.initial_error) for row in rows]
    apart = 2.0 * REACH_M / max(len({round(start.x, 6) for start in starts}) - 1, 1)
    half = 180.0 / len({round(start.heading, 6) for start in starts})
    petals = []
    for x, y, heading in starts:
        middle = math.degrees(heading)
        petals.append(Wedge((x, y), PETAL_FRACTION * apart, middle - half, middle + half))
    colours = [colour_of(row.figures, times) for row in rows]
    look: dict[str, Any] = {"linewidth": 0.3, "edgecolor": style.PAPER}
    axes.add_collection(PatchCollection(petals, facecolors=colours, **look))
    edge = REACH_M + 0.6 * apart
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal")
    axes.annotate("", (0.3, 0.0), (-0.3, 0.0), arrowprops=ARROW, zorder=4)
    name = literal(Path(found.reference).name)
    axes.set_title(f"{found.kinematic}, {name}: {found.converged} of {found.starts}",
                   fontsize=TEXT_PT, color=style.INK, pad=4)  # fmt: skip
    axes.tick_params(labelsize=SMALL_PT, colors=style.INK, length=2)
    axes.spines[:].set(color=style.FAINT)


def colour_of(figures: Figures, times: ScalarMappable) -> Any:
    """Return the colour of a start by what became of it."""
    if figures.outcome == REFUSED:
        return NOT_TAKEN
    if failed(figures):
        return FAILED
    at: Any = figures.settled_at
    return times.to_rgba(at) if converged(figures) else UNDECIDED
