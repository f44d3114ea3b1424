"""A chart that stands still, which a page without scripts has; and axes over any values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array

DECADES_RATIO = 40.0  # largest over smallest: beyond, an axis is logarithmic
MAX_DECADES_RATIO = 1e6  # that a logarithmic axis shows
TICKS = 5  # about, of an axis
ROOM = 0.04  # of the range of values: left free at either end


@dataclass(frozen=True)
class Axis:
    """An axis, linear or logarithmic; its label names quantity and unit."""

    low: float
    high: float
    label: str = ""
    log: bool = False

    def at(self, values: Array | float) -> Array:
        """Return where values are, 0 at a linear axis's low end to 1; beyond its ends at them."""
        inside = np.clip(values, self.low, self.high)
        return np.asarray((inside - self.low) / (self.high - self.low))

    def value(self, shares: Array) -> Array:
        """Return the values at shares of the way from the low end to the high one."""
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** shares)
        return np.asarray(self.low + (self.high - self.low) * shares)

    def ticks(self) -> list[float]:
        """Return round values inside a linear axis, about :data:`TICKS` of them."""
        step = _round_step((self.high - self.low) / TICKS)
        first = math.ceil(self.low / step - 1e-9)
        return [k * step for k in range(first, math.floor(self.high / step + 1e-9) + 1)]


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least * 0.999)


def axis_over(values: Array, label: str = "", log: bool | None = None, zero: bool = True) -> Axis:
    """Return an axis that holds values, with a little room.

    Args:
        values: Those that are not finite are left out.
        label: The quantity and its unit.
        log: Whether it is logarithmic; None: where the values span decades.
        zero: Whether a linear one begins at zero, if no value is below.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return Axis(0.0, 1.0, label)
    low, high = float(known.min()), float(known.max())
    least = float(known[known > 0.0].min(initial=np.inf))
    if log is None:
        log = low >= 0.0 and high > DECADES_RATIO * least
    if log and math.isfinite(least):
        return Axis(max(least, high / MAX_DECADES_RATIO) / 1.15, high * 1.15, label, log=True)
    if zero and low >= 0.0:
        low = 0.0
    room = ROOM * (high - low) or 0.5 * abs(high) or 1.0
    return Axis(low if low == 0.0 else low - room, high + room, label)


@dataclass(frozen=True, eq=False)
class Mark:
    """A line, or what is filled below it.

    Attributes:
        x: Places (n,).
        y: Values (n,); those that are no numbers are left out.
        colour: Its name in the palette, or ``c0``, ``c1``, ... of lines.
        filled: Whether it is filled down to the axis, not a line.
        opacity: Of the colour.
        width: Of a line, px on a page.
        dashed: Whether a line is dashed.
        label: Its name in a legend.
    """

    x: Array
    y: Array
    colour: str
    filled: bool = False
    opacity: float = 1.0
    width: float = 2.0
    dashed: bool = False
    label: str = ""


@dataclass(frozen=True, eq=False)
class StillChart:
    """Marks on common axes.

    Attributes:
        title: What it shows.
        x: The horizontal axis.
        y: The vertical one.
        marks: The first is drawn first.
        summary: What who does not see it is told.
    """

    title: str
    x: Axis
    y: Axis
    marks: tuple[Mark, ...] = ()
    summary: str = ""
