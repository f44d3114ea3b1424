"""A chart as page and paper figure draw it: lines over time on common axes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpctl.arrays import Array

# Panels of the paper figure, in its order
PANELS = (
    "paths",
    "base",
    "joints",
    "tip",
    "speeds",
    "joint-speeds",
    "efforts",
    "tip-over",
    "grip",
    "clearance",
)
ERROR_FLOOR = 1e-12  # an error below it is rounding, which a logarithm would only magnify
MAX_DECADES = 6.0  # of an error's axis


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart.

    Attributes:
        label: What it shows.
        unit: Unit of the value that the page's legend gives.
        values: What is drawn (K,), in the unit of the chart's axis.
        colour: Index into a palette, the same on page and paper.
        scale: The value in the page's legend is ``values`` times this.
        reference: The desired values (K,), drawn dashed, or None.
        shown: Whether it is visible at first; paper omits it otherwise.
        band: The smallest and the largest possible value (K,); inf where there is no upper bound,
            NaN where it is not defined. None where there is one value.
        printed: Its name in a legend of its panel.
        dash: Index of its dash pattern on paper; the page draws all lines solid.
    """

    label: str
    unit: str
    values: Array
    colour: int
    scale: float = 1.0
    reference: Array | None = None
    shown: bool = True
    band: tuple[Array, Array] | None = None
    printed: str = ""
    dash: int = 0


@dataclass(frozen=True, eq=False)
class Panel:
    """How the paper figure shows a chart, where that differs from the page.

    Attributes:
        name: Its name on the command line, one of ``PANELS``.
        title: What stands above it.
        axis: Label of the value axis.
        factor: What is printed is the chart's value times this.
        legend: Whether its lines have a legend in the panel, share that of the joints below the
            figure, or have none.
        references: Whether references are drawn.
        span: Ends of the value axis in the chart's unit; None leaves them to matplotlib.
        more: Lines that only the panel has.
        shared: What was left out of the names of its lines, for the title of its legend.
        wide: Whether it takes a row of its own.
    """

    name: str
    title: str
    axis: str
    factor: float = 1.0
    legend: Literal["own", "joints", "none"] = "none"
    references: bool = True
    span: tuple[float, float] | None = None
    more: tuple[Line, ...] = ()
    shared: str = ""
    wide: bool = False


# Paths from above (plots/paths.py): the only panel without a chart, as the page has its scene.
PATHS = Panel("paths", "Paths", "y, m", legend="own", wide=True)


@dataclass(frozen=True, eq=False)
class Chart:
    """Lines that share their axes.

    Attributes:
        title: What the chart shows.
        unit: Unit of its axis.
        lines: At least one.
        limits: Levels that are drawn dashed and always in view.
        errors: Whether its lines are errors, of which the magnitude is drawn over decades.
        note: What a reader must know beside the title.
        panel: How it is printed; None where only the page has it.
        named: Whether its lines are called after joints or runs: legends shorten names together.
    """

    title: str
    unit: str
    lines: tuple[Line, ...]
    limits: tuple[float, ...] = ()
    errors: bool = False
    note: str = ""
    panel: Panel | None = None
    named: bool = False


def decades(lines: Iterable[Line]) -> tuple[float, float]:
    """Return the ends of an error's axis: a fifth of the settled error, twice the maximum."""
    errors = [np.abs(line.values) for line in lines if line.shown]
    top = 2.0 * max(*(float(error.max()) for error in errors), 10.0 * ERROR_FLOOR)
    settled = min(float(np.median(error[-max(1, len(error) // 5) :])) for error in errors)
    bottom = max(min(0.2 * max(settled, ERROR_FLOOR), 1e-2 * top), top / 10.0**MAX_DECADES)
    return bottom, top
