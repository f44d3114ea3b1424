"""The figure of a run: paths, tracking errors, speeds and efforts."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_known
from rpctl.files.writing import write_atomically
from rpctl.simulation.run.run import Run
from rpctl.view.charts import (
    ALL_SPLITS,
    ERROR_FLOOR,
    PANELS,
    PATHS,
    Chart,
    Panel,
    charts,
    coloured_joints,
    decades,
    has_base,
)
from rpctl.view.marks import MARK, comment
from rpctl.view.plots import style
from rpctl.view.plots.paths import draw_paths
from rpctl.view.plots.style import (
    LEGEND_ROW_IN,
    PAPER,
    add_legend,
    joint_legend,
    own_settings,
    sampled,
    style_axes,
)

PAGE_WIDTH_IN, COLUMN_WIDTH_IN = (
    180.0 / 25.4,
    88.0 / 25.4,
)  # widths of a page and of one of its two columns, inches
ROW_HEIGHT_IN, WIDE_ROW_HEIGHT_IN = 58.0 / 25.4, 75.0 / 25.4  # heights of a row of panels, inches
MARGIN_IN = 0.07  # inches: around each panel, its labels included
DPI = 200  # of the figure in a run's folder
PRINT_DPI = 400  # of a figure for print
PANEL_LETTERS = "abcdefghijklmnopqrstuvwxyz"
TRUETYPE = 42  # fonts as publishers ask for them: whole letters that stay text
PanelChart = tuple[Panel, Chart | None]  # a panel and its chart; None where it shows the paths


def tracking_image(run: Run) -> bytes:
    """Return the figure of a run as the bytes of a PNG."""
    return to_png(tracking_figure(run), DPI, run.digest)


def save_figure(
    run: Run, path: str | Path, *, panels: Sequence[str] = (), column: bool = False
) -> Path:
    """Write the figure of a run for a paper; the file is there whole or not at all.

    Args:
        run: The run.
        path: The file: .pdf, of lines and text, or .png.
        panels: The panels wanted, by name and in order; all that the run has, if none is named.
        column: As wide as a column of a two-column page (88 mm), not as the page (180 mm).

    Returns:
        The path.

    Raises:
        RpctlError: The suffix is another one, or the run has no such panel.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".pdf", ".png"):
        raise RpctlError(f"{path}: figures are .pdf or .png; give a name that ends so")
    figure = tracking_figure(run, panels=panels, column=column)
    if suffix == ".pdf":
        return write_atomically(path, to_pdf(figure, run.digest))
    return write_atomically(path, to_png(figure, PRINT_DPI, run.digest))


@own_settings()
def tracking_figure(run: Run, *, panels: Sequence[str] = (), column: bool = False) -> Figure:
    """Return the figure of a run; panels without data are left out.

    Args:
        run: The run.
        panels: Names of panels, in order; all that the run has if empty.
        column: Whether it is as wide as a column (88 mm) or as a page (180 mm).

    Raises:
        UnknownNameError: The run has no such panel.
    """
    run = sampled(run)
    shown = _choose(find_panels(run), panels)
    width, columns = (COLUMN_WIDTH_IN, 1) if column or len(shown) == 1 else (PAGE_WIDTH_IN, 2)
    figure = Figure(dpi=DPI, facecolor=PAPER)
    figure.set_layout_engine("constrained", w_pad=MARGIN_IN, h_pad=MARGIN_IN)
    places = _places([panel for panel, _ in shown], columns)
    heights = [0.0] * (places[-1][0] + 1 if places else 1)
    grid = figure.add_gridspec(len(heights), columns)
    for (panel, chart), letter, (row, span) in zip(shown, PANEL_LETTERS, places, strict=False):
        axes = figure.add_subplot(grid[row, span])
        style_axes(axes, (f"({letter})  " if len(shown) > 1 else "") + panel.title)
        if chart is None:
            draw_paths(axes, run)
        else:
            _draw_chart(axes, run, panel, chart)
        below = add_legend(axes, below=width * (panel.wide and columns == 1), title=panel.shared)
        height = (WIDE_ROW_HEIGHT_IN if panel.wide else ROW_HEIGHT_IN) + LEGEND_ROW_IN * below
        heights[row] = max(heights[row], height)
    grid.set_height_ratios(heights)
    joints = coloured_joints(run) if any(panel.legend == "joints" for panel, _ in shown) else []
    figure.set_size_inches(width, sum(heights) + joint_legend(figure, joints, width, 3 * columns))
    return figure


def _places(panels: Sequence[Panel], columns: int) -> list[tuple[int, slice]]:
    """Return the row and the columns of each panel: left to right, a wide one in its own row."""
    places, row, column = [], 0, 0
    for panel in panels:
        span = columns if panel.wide else 1
        if column + span > columns:
            row, column = row + 1, 0
        places.append((row, slice(column, column + span)))
        column += span
    return places


def _choose(found: list[PanelChart], wanted: Sequence[str]) -> list[PanelChart]:
    if not wanted:
        return found
    require_known("panel", wanted, list(dict.fromkeys(panel.name for panel, _ in found)))
    return [each for name in wanted for each in found if each[0].name == name]


@own_settings()
def to_png(figure: Figure, dpi: int, run: str | None = None) -> bytes:
    """Return a figure as the bytes of a PNG.

    Args:
        figure: The figure.
        dpi: Dots per inch.
        run: Digest of the run that it is of, which the file tells; None: of no run.
    """
    buffer = io.BytesIO()
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)  # ``savefig`` draws twice, first for the layout alone
    canvas.print_png(buffer, metadata={MARK: run} if run else None)
    return buffer.getvalue()


@own_settings()
def to_pdf(figure: Figure, run: str | None = None) -> bytes:
    """Return a figure as the bytes of a PDF, its fonts and the digest of its run in it."""
    buffer = io.BytesIO()
    # Without a date the same run gives the same file.
    metadata = {"CreationDate": None, "Keywords": comment(run) or None}
    with rc_context({"pdf.fonttype": TRUETYPE}):
        figure.savefig(buffer, format="pdf", metadata=metadata)
    return buffer.getvalue()


@own_settings()
def to_svg(figure: Figure) -> bytes:
    """Return a figure as the bytes of an SVG, the same for the same figure."""
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "rpctl"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def svg_address(figure: Figure) -> str:
    """Return a figure as an address that holds it, for a page."""
    return f"data:image/svg+xml;base64,{base64.b64encode(to_svg(figure)).decode()}"


def find_panels(run: Run) -> list[PanelChart]:
    """Return the panels that a run has data for, in the order of ``PANELS``, and their charts."""
    found: list[PanelChart] = []
    if has_base(run) or run.log.ee.shape[1]:
        found.append((PATHS, None))
    found += [(chart.panel, chart) for chart in charts(run) if chart.panel is not None]
    return sorted(found, key=lambda each: PANELS.index(each[0].name))


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
