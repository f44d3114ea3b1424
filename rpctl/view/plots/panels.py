"""The panels of a run's figure: the paths from above, and its charts over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run
from rpctl.view.chart import ERROR_FLOOR, PANELS, PATHS, Chart, Panel, decades
from rpctl.view.charts import ALL_SPLITS, charts, coloured_joints, has_base
from rpctl.view.plots import style
from rpctl.view.plots.paths import draw_paths

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PanelChart = tuple[Panel, Chart | None]  # a panel and its chart; None where it shows the paths


def find_panels(run: Run) -> list[PanelChart]:
    """Return the panels that a run has data for, in the order of ``PANELS``, and their charts."""
    found: list[PanelChart] = []
    if has_base(run) or run.log.ee.shape[1]:
        found.append((PATHS, None))
    found += [(chart.panel, chart) for chart in charts(run) if chart.panel is not None]
    return sorted(found, key=lambda each: PANELS.index(each[0].name))


def draw_panel(axes: Axes, run: Run, panel: Panel, chart: Chart | None) -> None:
    """Draw what a panel shows.

    Args:
        axes: The panel's axes.
        run: The run.
        panel: The panel.
        chart: Its chart; None where it shows the paths.
    """
    if chart is None:
        draw_paths(axes, run)
    else:
        _draw_chart(axes, run, panel, chart)


def _draw_chart(axes: Axes, run: Run, panel: Panel, chart: Chart) -> None:
    for limit in chart.limits:
        axes.axhline(panel.factor * limit, color=style.INK, **style.LIMIT_STYLE)
    lines = [line for line in (*chart.lines, *panel.more) if line.shown]
    joints = len(coloured_joints(run)) if panel.legend == "joints" else 0
    for line in lines:
        look = style.line_style(line.colour, line.dash, joints)
        if line.band is not None:
            _draw_band(axes, run.t, line.band, panel, look["color"])
        values = np.maximum(np.abs(line.values), ERROR_FLOOR) if chart.errors else line.values
        label = line.printed if panel.legend == "own" else None
        axes.plot(run.t, panel.factor * values, label=label, **look)
    wanted = [line.reference for line in lines if line.reference is not None]
    for reference in wanted if panel.references else ():
        axes.plot(run.t, panel.factor * reference, **style.DESIRED_STYLE)
    if wanted and panel.legend == "own":
        axes.plot([], [], label="reference", **style.DESIRED_STYLE)
    span = decades(lines) if chart.errors else panel.span
    if chart.errors:
        axes.set_yscale("log")
    if span is not None:
        axes.set_ylim(panel.factor * span[0], panel.factor * span[1])
    axes.set_xlabel("t, s")
    axes.set_ylabel(panel.axis)


def _draw_band(axes: Axes, t: Array, band: tuple[Array, Array], panel: Panel, colour: str) -> None:
    """Shade what lies between the edges (K,) of a band; one without an end leaves the panel."""
    end = np.inf if panel.span is None else panel.span[1]
    low, high = (panel.factor * np.minimum(edge, end) for edge in band)
    axes.fill_between(t, low, high, label=ALL_SPLITS, color=colour, alpha=0.2, lw=0.0)
