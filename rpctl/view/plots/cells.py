"""Where the panels of a figure stand: in cells whose margins are the same everywhere.

The margins hold what a panel can have around its axes. Matplotlib's own layouts measure it
instead, several times a panel, which takes longer than to draw it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Margins around the axes of a panel, inches: for ticks of up to seven characters and the label of
# the values; for half a tick's text; for the title; for ticks and the label of the time.
LEFT_IN, RIGHT_IN, TOP_IN, BOTTOM_IN = 0.55, 0.1, 0.22, 0.34
VALUE_LABEL_IN, TIME_LABEL_IN = 0.42, 0.175  # from the axes to the labels


@dataclass(frozen=True, eq=False)
class PanelCell:
    """A panel's axes and its place in the figure.

    Attributes:
        axes: The axes.
        row: Its row, from the top.
        columns: Its columns, from the left.
        height: Of its row, inches.
        legend: Height of the legend below the panel, inches; 0 where it has none there.
    """

    axes: Axes
    row: int
    columns: slice
    height: float
    legend: float


def place_cells(figure: Figure, cells: Sequence[PanelCell], columns: int, strip: float) -> None:
    """Give a figure its height, and each panel its place and those of its labels.

    Args:
        figure: The figure; its width stays.
        cells: The panels.
        columns: Columns of the figure.
        strip: Height to leave free below the panels, inches.
    """
    rows = [0.0] * (1 + max((cell.row for cell in cells), default=-1))
    for cell in cells:
        rows[cell.row] = max(rows[cell.row], cell.height + cell.legend)
    width, height = float(figure.get_figwidth()), sum(rows) + strip
    figure.set_size_inches(width, height)
    for cell in cells:
        x = LEFT_IN + cell.columns.start * width / columns
        w = (cell.columns.stop - cell.columns.start) * width / columns - LEFT_IN - RIGHT_IN
        y = strip + sum(rows[cell.row + 1 :]) + BOTTOM_IN + cell.legend
        h = cell.height - TOP_IN - BOTTOM_IN
        cell.axes.set_position((x / width, y / height, w / width, h / height))
        cell.axes.yaxis.set_label_coords(-VALUE_LABEL_IN / w, 0.5)
        cell.axes.xaxis.set_label_coords(0.5, -TIME_LABEL_IN / h)
        legend = cell.axes.get_legend()
        if cell.legend and legend is not None:
            legend.set_bbox_to_anchor((0.5, (y - BOTTOM_IN) / height), figure.transFigure)
