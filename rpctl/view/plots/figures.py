"""The figure of a run: its paths from above, tracking errors, speeds and efforts.

Paths, with the robot along them and the obstacles, are the only panel that the page does not have
as a chart: it shows the same in its scene.
"""

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
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull, QhullError

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.errors import RpctlError, require_known
from rpctl.files.writing import write_atomically
from rpctl.robot.coordinates import read_root
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, run_obstacles
from rpctl.simulation.run.run import Run
from rpctl.view.charts import (
    ALL_SPLITS,
    PANELS,
    PATHS,
    Chart,
    Panel,
    charts,
    coloured_joints,
    decades,
    error_span,
    has_base,
    noise_note,
    prefixed,
)
from rpctl.view.labels import MARK, comment, literal
from rpctl.view.plots import style
from rpctl.view.plots.style import (
    LEGEND_ROW_IN,
    PAPER,
    add_legend,
    joint_legend,
    own_settings,
    sampled,
    style_axes,
)
from rpctl.view.scene.stage import line_ends, near, rims

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
    run: Run,
    path: str | Path,
    *,
    panels: Sequence[str] = (),
    column: bool = False,
    log: bool = False,
) -> Path:
    """Write the figure of a run for a paper; the file is there whole or not at all.

    Args:
        run: The run.
        path: The file: .pdf, of lines and text, or .png.
        panels: The panels wanted, by name and in order; all that the run has, if none is named.
        column: As wide as a column of a two-column page (88 mm), not as the page (180 mm).
        log: Whether errors have logarithmic axes.

    Returns:
        The path.

    Raises:
        RpctlError: The suffix is another one, or the run has no such panel.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".pdf", ".png"):
        raise RpctlError(f"{path}: figures are .pdf or .png; give a name with that ending")
    figure = tracking_figure(run, panels=panels, column=column, log=log)
    if suffix == ".pdf":
        return write_atomically(path, to_pdf(figure, run.digest))
    return write_atomically(path, to_png(figure, PRINT_DPI, run.digest))


@own_settings()
def tracking_figure(
    run: Run, *, panels: Sequence[str] = (), column: bool = False, log: bool = False
) -> Figure:
    """Return the figure of a run; panels without data are left out.

    Args:
        run: The run.
        panels: Names of panels, in order; all that the run has if empty.
        column: Whether it is as wide as a column (88 mm) or as a page (180 mm).
        log: Whether errors have logarithmic axes, of their size.

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
            _draw_chart(axes, run, panel, chart, log and chart.errors)
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
def svg_address(figure: Figure) -> str:
    """Return a figure as an address that holds it as SVG, the same for the same figure."""
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "rpctl"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def find_panels(run: Run) -> list[PanelChart]:
    """Return the panels that a run has data for, in the order of ``PANELS``, and their charts."""
    found: list[PanelChart] = []
    if has_base(run) or run.log.ee.shape[1]:
        found.append((PATHS, None))
    found += [(chart.panel, chart) for chart in charts(run) if chart.panel is not None]
    return sorted(found, key=lambda each: PANELS.index(each[0].name))


def _draw_chart(axes: Axes, run: Run, panel: Panel, chart: Chart, log: bool) -> None:
    prefix, factor = prefixed(chart) if chart.errors else ("", 1.0)
    for limit in chart.limits:
        axes.axhline(limit, color=style.INK, **style.LIMIT_STYLE)
    lines = [line for line in (*chart.lines, *panel.more) if line.shown]
    joints = len(coloured_joints(run)) if panel.legend == "joints" else 0
    for line in lines:
        look = style.line_style(line.colour, line.dash, joints)
        if line.band is not None:
            _draw_band(axes, run.t, line.band, panel, look["color"])
        name = line.printed or f"{literal(line.label)}, {prefix}{line.unit}"
        label = name if panel.legend == "own" else None
        values = np.abs(line.values) if log else line.values
        axes.plot(run.t, factor * values, label=label, **look)
    wanted = [line.reference for line in lines if line.reference is not None]
    for reference in wanted if panel.references else ():
        axes.plot(run.t, reference, **style.DESIRED_STYLE)
    if wanted and panel.legend == "own":
        axes.plot([], [], label="reference", **style.DESIRED_STYLE)
    span = panel.span
    if chart.errors:
        span = decades(lines) if log else error_span(lines)
        axes.set_yscale("log" if log else "linear")
        axes.text(0.5, 0.5, noise_note(chart), ha="center", va="bottom", color=style.DESIRED,
                  fontsize=style.SMALL_PT, transform=axes.transAxes)  # fmt: skip
    if span is not None:
        axes.set_ylim(factor * span[0], factor * span[1])
    axes.set_xlabel("time, s")
    units = " or ".join(f"{prefix}{unit}" for unit in chart.unit.split(", "))
    axes.set_ylabel(panel.axis or units)


def _draw_band(axes: Axes, t: Array, band: tuple[Array, Array], panel: Panel, colour: str) -> None:
    """Shade what lies between the edges (K,) of a band; one without an end leaves the panel."""
    end = np.inf if panel.span is None else panel.span[1]
    low, high = (np.minimum(edge, end) for edge in band)
    axes.fill_between(t, low, high, label=ALL_SPLITS, color=colour, alpha=0.2, lw=0.0)


MAX_POSES = 10  # of the robot along its path, at most
MIN_POSE_SPACING = 1.2  # lengths of the robot from one of its poses to the next, at least
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # of the time between them, in powers of ten
MAX_TICKS = 9  # of the x axis, at most
HEADING_TICK_RATIO = 0.4  # of the track: length of a heading's tick
OBSTACLE_LABELS = {BASE: "obstacle of the base", TIP: "obstacle of the end effector"}
HATCHES = {BASE: "////", TIP: "...."}
HALF_PLANE_DIAGONALS = 20.0  # m, or diagonals of what is drawn: how far a half-plane goes on
ZORDER = 1.2  # above the grid, below the robot
CLEARANCE_STYLE: dict[str, Any] = {"lw": 0.6, "ls": (0, (4, 2.5)), "zorder": ZORDER}


def draw_paths(axes: Axes, run: Run) -> None:
    """Draw the paths of base and end effector, actual and desired, robot and obstacles."""
    pairs = []
    if run.robot.drive.wheels:
        pairs.append((run.log.base, run.base_ref, style.BASE, "base"))
    if run.log.ee.shape[1]:
        pairs.append((run.log.ee, run.log.ee_ref, style.TIP, "end effector"))
    for actual, _, colour, label in pairs:
        axes.plot(*actual[:, :2].T, color=colour, lw=1.2, label=label)
        axes.plot(*actual[0, :2], "o", color=style.PAPER, mec=colour, mew=1.1, ms=4.2, zorder=4)
    for number, (_, desired, _, _) in enumerate(pairs):
        axes.plot(*desired[:, :2].T, label=None if number else "desired", **style.DESIRED_STYLE)
    axes.plot([], [], "o", color=style.PAPER, mec=style.INK, mew=0.9, ms=3.6, label="start")
    if run.robot.drive.wheels:
        _draw_poses(axes, run)
    draw_obstacles(axes, run)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=MAX_TICKS, steps=[1, 2, 5, 10]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel(PATHS.axis)


def _draw_poses(axes: Axes, run: Run) -> None:
    """Draw the robot's outline and heading at regular times."""
    outline = support_outline(run)
    size = _size(run)
    interval = _interval(run, size)
    wanted = np.arange(run.t[0], run.t[-1] + 1e-9, interval) if interval else run.t[:1]
    for k in np.searchsorted(run.t, wanted).clip(max=len(run.t) - 1):
        x, y, heading = run.log.base[k]
        ahead = HEADING_TICK_RATIO * size * np.array([np.cos(heading), np.sin(heading)])
        axes.plot([x, x + ahead[0]], [y, y + ahead[1]], color=style.INK, lw=0.9, zorder=3.5)
        if outline is not None:
            corners = style.placed(outline, read_root(run.q[k])).T
            axes.fill(*corners, fc=style.BASE, ec="none", alpha=0.08, zorder=1.5)
            axes.fill(*corners, fc="none", ec=style.INK, lw=0.5, alpha=0.7, zorder=1.6)
    if interval and outline is not None:
        text = f"contacts and heading, every {interval:g} s"
        axes.fill([], [], fc=style.FAINT, ec=style.INK, lw=0.5, label=text)


def support_outline(run: Run) -> Array | None:
    """Return the corners (n, 2) around the contacts in the root link's frame, m, or None.

    There are none where fewer than three contacts are known, or all lie in one line.
    """
    points = np.array(run.ground.points).reshape(-1, 2)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def _size(run: Run) -> float:
    """Return the size of the robot as drawn, m: the extent of its contacts, or its track."""
    points = np.array(run.ground.points).reshape(-1, 2)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return max(extent, run.robot.drive.track) or 1.0


def _interval(run: Run, size: float) -> float:
    """Return a round time between drawn poses, s; 0 where the robot moves less than one spacing."""
    duration = float(run.t[-1] - run.t[0])
    length = float(np.linalg.norm(np.diff(run.log.base[:, :2], axis=0), axis=1).sum())
    count = min(MAX_POSES, length / (MIN_POSE_SPACING * size))
    if count < 1.0:
        return 0.0
    least = duration / count
    steps = 10.0 ** np.floor(np.log10(least)) * np.array(ROUND_STEPS)
    return float(steps[steps >= 0.999 * least][0])


def draw_obstacles(axes: Axes, run: Run) -> None:
    """Draw the obstacles of a run after its paths; the axes widen to include those nearby."""
    obstacles = run_obstacles(run)
    if not obstacles:
        return
    lower, upper = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    shown = near(np.concatenate([rims(obstacles), *_nearest_points(obstacles, run)]), lower, upper)
    if len(shown):
        axes.update_datalim(shown)
        axes.autoscale_view()
    colours = {BASE: style.BASE_OBSTACLE, TIP: style.TIP_OBSTACLE}
    far = HALF_PLANE_DIAGONALS * max(float(np.hypot(*(upper - lower))), 1.0)
    for obstacle in obstacles:
        fill_style = _fill_style(obstacle.body, colours[obstacle.body])
        _draw(axes, obstacle, 0.5 * (lower + upper), far, fill_style)
    for body in dict.fromkeys(obstacle.body for obstacle in obstacles):
        axes.fill([], [], label=OBSTACLE_LABELS[body], **_fill_style(body, colours[body]))
    if any(obstacle.radius for obstacle in obstacles):
        axes.plot([], [], label="limit for its centre", color=style.INK, **CLEARANCE_STYLE)


def half_plane(plane: HalfPlane, centre: Array, far: float) -> Array:
    """Return the corners (4, 2) of a rectangle on the blocked side of a half-plane, m.

    The first two lie on its line.

    Args:
        plane: The half-plane.
        centre: Beside the middle of the line (2,), m.
        far: How far it goes on in each direction, m.
    """
    (gap,) = plane.distance(centre[None])
    ends = line_ends(plane, centre, gap, far)
    return np.concatenate([ends, ends[::-1] - far * plane.normal])


def _nearest_points(obstacles: Sequence[AvoidedObstacle], run: Run) -> list[Array]:
    """Return, for each half-plane, the point (1, 2) of its line nearest to its body's path, m."""
    feet = []
    for body, shape in ((o.body, o.shape) for o in obstacles):
        path = (run.log.base if body == BASE else run.log.ee)[:, :2]
        if isinstance(shape, HalfPlane) and path.size:
            gaps = shape.distance(path)
            k = int(np.argmin(gaps))
            feet.append(path[k : k + 1] - gaps[k] * shape.normal)
    return feet


def _draw(
    axes: Axes, obstacle: AvoidedObstacle, centre: Array, far: float, fill_style: dict[str, Any]
) -> None:
    """Draw one obstacle; it does not widen the axes."""
    shape, radius = obstacle.shape, obstacle.radius
    clearance_style = {**CLEARANCE_STYLE, "color": fill_style["ec"]}
    if isinstance(shape, Disc):
        axes.add_artist(Circle((shape.x, shape.y), shape.radius, **fill_style))
        if radius:
            axes.add_artist(
                Circle((shape.x, shape.y), shape.radius + radius, fill=False, **clearance_style)
            )
        return
    corners = half_plane(shape, centre, far)
    axes.add_artist(Polygon(corners, **fill_style))
    if radius:
        axes.add_artist(Line2D(*(corners[:2] + radius * shape.normal).T, **clearance_style))


def _fill_style(body: str, colour: str) -> dict[str, Any]:
    """Return how an obstacle is filled: edge and hatching in one colour, on a tint of it."""
    tint = to_rgba(colour, 0.1)
    return {"fc": tint, "ec": colour, "lw": 0.8, "hatch": HATCHES[body], "zorder": ZORDER}
