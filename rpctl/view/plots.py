"""The figure of a run: paths, tracking errors, speeds and efforts, on paper or on a dark page."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.description.records import Array
from rpctl.files import write_atomically
from rpctl.simulation.run import Run
from rpctl.view.plot_style import (
    DARK,
    DESIRED,
    LIGHT,
    Theme,
    dress,
    explain,
    joint_legend,
    look,
    names,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, ROW = 180.0 / 25.4, 58.0 / 25.4  # inches
DPI = 200
MAX_POINTS = 12_000  # of one line: more cannot be told apart on paper
FLOOR = 1e-12  # below it an error is rounding, and a logarithm only noise
DECADES = 6.0  # that an error's axis shows at most
SLIPPING = 3.0  # that a grip's axis shows at most: beyond, the wheel slips or is in the air
COLOURS = 256  # of the PNG's palette: a third of the size, and the eye sees no difference


Panel = Callable[["Axes", Run, Theme], None]


def save_tracking_figure(run: Run, path: str | Path) -> Path:
    """Write the figure of a run as PNG, 180 mm wide, there whole or not at all.

    Args:
        run: The run.
        path: The file.

    Returns:
        The path.
    """
    return write_atomically(path, tracking_image(run))


def tracking_image(run: Run, dark: bool = False) -> bytes:
    """Return the figure of a run as the bytes of a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas: Any = FigureCanvasAgg(tracking_figure(run, dark))
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    buffer = io.BytesIO()
    image.quantize(COLOURS).save(buffer, "PNG", optimize=True, dpi=(DPI, DPI))
    return buffer.getvalue()


def tracking_figure(run: Run, dark: bool = False) -> Figure:
    """Return the figure of a run; panels that the robot has nothing for are left out."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    theme = DARK if dark else LIGHT
    panels = _panels(run)
    rows = (len(panels) + 1) // 2
    legend = names(run, theme)
    strip = 0.14 * -(-len(legend) // 6)
    layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05, wspace=0.02, hspace=0.02)
    figure = Figure((WIDTH, rows * ROW + strip), dpi=DPI, layout=layout)
    figure.set_facecolor(theme.paper)
    for number, (title, draw) in enumerate(panels):
        axes = figure.add_subplot(rows, 2, number + 1)
        dress(axes, f"({'abcdefghij'[number]})  {title}", theme)
        draw(axes, run, theme)
        explain(axes, theme)
    joint_legend(figure, legend, theme)
    return figure


def _panels(run: Run) -> list[tuple[str, Panel]]:
    """Return the titles and the drawings that suit the run."""
    based = "omega" in run.quasi_velocities
    panels: list[tuple[str, Panel]] = []
    if based or run.ee.shape[1]:
        panels.append(("Paths", _paths))
    if based:
        panels.append(("Base error", _base_error))
    if run.joint_names:
        panels.append(("Joint errors", _joint_errors))
    if run.ee.shape[1]:
        panels.append(("End-effector error", _tip_error))
    if based:
        panels.append(("Base speeds", _speeds))
    panels += _effort_panels(run)
    if run.tip_margin.size:
        grip = f"Grip at friction {run.friction:g}, limit dashed"
        panels += [("Tip-over margin, limit dashed", _tip_margin), (grip, _grip)]
    return panels


def _effort_panels(run: Run) -> list[tuple[str, Panel]]:
    """Return one panel for efforts with limits, and one for each unit of those without."""
    limits = np.array(run.effort_limits)
    limited = [i for i, limit in enumerate(limits) if np.isfinite(limit) and limit > 0.0]
    panels: list[tuple[str, Panel]] = []
    if limited:

        def ratios(axes: Axes, run: Run, theme: Theme) -> None:
            for sign in (-1.0, 1.0):
                axes.axhline(sign, color=theme.ink, lw=0.8, ls=(0, (6, 3)))
            _actuator_lines(axes, run, limited, 1.0 / limits[limited], theme)
            axes.set_ylabel("effort / limit")
            share = run.tau[:, limited] / limits[limited]
            axes.set_ylim(1.12 * min(-1.0, share.min()), 1.12 * max(1.0, share.max()))

        panels.append(("Efforts, limits dashed", ratios))
    for unit in ("N·m", "N"):
        chosen = [i for i in range(len(limits)) if i not in limited and _unit(run, i) == unit]
        if chosen:
            panels.append((f"Efforts without limits, {unit}", _absolute(chosen, unit)))
    return panels


def _absolute(chosen: list[int], unit: str) -> Panel:
    def draw(axes: Axes, run: Run, theme: Theme) -> None:
        _actuator_lines(axes, run, chosen, np.ones(len(chosen)), theme)
        axes.set_ylabel(f"effort, {unit}")

    return draw


def _unit(run: Run, actuator: int) -> str:
    """Return the unit of an actuator's effort; wheels turn, so theirs is a torque."""
    name = run.actuators[actuator]
    prismatic = name in run.joint_names and run.units[run.joint_names.index(name)] == "m"
    return "N" if prismatic else "N·m"


def _paths(axes: Axes, run: Run, theme: Theme) -> None:
    pairs = [(run.base, run.base_ref, theme.base, "base")]
    if "omega" not in run.quasi_velocities:
        pairs = []
    if run.ee.shape[1]:
        pairs.append((run.ee, run.ee_ref, theme.tip, "end effector"))
    for actual, _, colour, label in pairs:
        axes.plot(*_thin(actual[:, :2]).T, color=colour, lw=1.2, label=label)
        axes.plot(*actual[0, :2], "o", color=theme.paper, mec=colour, mew=1.1, ms=4.2, zorder=4)
    for number, (_, desired, _, _) in enumerate(pairs):
        explained = None if number else "desired"
        axes.plot(*_thin(desired[:, :2]).T, color=theme.desired, label=explained, **DESIRED)
    axes.plot([], [], "o", color=theme.paper, mec=theme.ink, mew=0.9, ms=3.6, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _base_error(axes: Axes, run: Run, theme: Theme) -> None:
    labels = ("longitudinal |x₁|, m", "lateral |x₂|, m", "heading |x₃|, rad")
    colours = (theme.base, theme.tip, theme.third)
    for i, (label, colour) in enumerate(zip(labels, colours, strict=True)):
        _log(axes, run, run.e[:, i], color=colour, lw=1.1, label=label)
    _log_axis(axes, run.e[:, :3], "m or rad")


def _joint_errors(axes: Axes, run: Run, theme: Theme) -> None:
    errors = run.e[:, 3:]
    for i, name in enumerate(run.joint_names):
        _log(axes, run, errors[:, i], **look(run, name, theme))
    _log_axis(axes, errors, " or ".join(sorted(set(run.units), reverse=True)))


def _tip_error(axes: Axes, run: Run, theme: Theme) -> None:
    distance = 1e3 * np.linalg.norm(run.ee_ref - run.ee, axis=1)
    angle = 1e3 * run.ee_angle
    _log(axes, run, distance, color=theme.tip, lw=1.2, label="position, mm")
    _log(axes, run, angle, color=theme.desired, lw=0.9, label="orientation, mrad")
    _log_axis(axes, np.column_stack([distance, angle]), "mm or mrad")


def _speeds(axes: Axes, run: Run, theme: Theme) -> None:
    speeds = (
        ("v", theme.base, "v, m/s"),
        ("vx", theme.base, "vx, m/s"),
        ("vy", theme.third, "vy, m/s"),
        ("omega", theme.tip, "ω, rad/s"),
    )
    for name, colour, label in speeds:
        if name in run.quasi_velocities:
            i = run.quasi_velocities.index(name)
            axes.plot(_thin(run.t), _thin(run.nu[:, i]), color=colour, lw=1.1, label=label)
            explained = "reference" if name == "omega" else None
            desired = _thin(run.nu_ref[:, i])
            axes.plot(_thin(run.t), desired, color=theme.desired, label=explained, **DESIRED)
    axes.set_xlabel("t, s")
    axes.set_ylabel("m/s or rad/s")


def _tip_margin(axes: Axes, run: Run, theme: Theme) -> None:
    axes.axhline(0.0, color=theme.ink, lw=0.8, ls=(0, (6, 3)))
    axes.plot(_thin(run.t), _thin(run.tip_margin), color=theme.base, lw=1.1)
    low, high = min(0.0, run.tip_margin.min()), max(0.0, run.tip_margin.max())
    axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    axes.set_xlabel("t, s")
    axes.set_ylabel("zero-moment point to edge, m")


def _grip(axes: Axes, run: Run, theme: Theme) -> None:
    axes.axhline(1.0, color=theme.ink, lw=0.8, ls=(0, (6, 3)))
    axes.plot(_thin(run.t), _thin(run.slip_ratio), color=theme.tip, lw=1.1)
    axes.set_ylim(0.0, 1.12 * min(max(1.0, run.slip_ratio.max()), SLIPPING))
    axes.set_xlabel("t, s")
    axes.set_ylabel("force / (friction · load)")


def _actuator_lines(axes: Axes, run: Run, chosen: list[int], scale: Array, theme: Theme) -> None:
    for i, factor in zip(chosen, scale, strict=True):
        efforts = _thin(run.tau[:, i] * factor)
        axes.plot(_thin(run.t), efforts, **look(run, run.actuators[i], theme))
    axes.set_xlabel("t, s")


def _log(axes: Axes, run: Run, values: Array, **look: Any) -> None:
    axes.semilogy(_thin(run.t), np.maximum(np.abs(_thin(values)), FLOOR), **look)


def _log_axis(axes: Axes, values: Array, unit: str) -> None:
    """Scale an error's axis to its largest value, and to what it settles at, not to its zeros."""
    top = 2.0 * max(float(np.abs(values).max()), 10.0 * FLOOR)
    settled = np.median(np.abs(values[-max(1, len(values) // 5) :]), axis=0)
    bottom = 0.2 * max(float(settled.min()), FLOOR)
    axes.set_ylim(max(min(bottom, 1e-2 * top), top / 10.0**DECADES), top)
    axes.set_xlabel("t, s")
    axes.set_ylabel(unit)


def _thin(values: Array) -> Array:
    return values[:: -(-len(values) // MAX_POINTS)]
