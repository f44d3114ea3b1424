"""What each panel of a run's figure shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run
from rpctl.view.charts import grip_top
from rpctl.view.plots.path import draw_paths
from rpctl.view.plots.style import (
    DASH_STYLES,
    DESIRED_STYLE,
    LIMIT_STYLE,
    Theme,
    joint_style,
    short_name,
    thin,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ERROR_FLOOR = 1e-12  # below it an error is rounding, and a logarithm only noise
MAX_DECADES = 6.0  # that an error's axis shows at most
MAX_JOINTS_WITH_REFERENCE = 3  # joints of which the references are drawn, too
SYMBOLS = {"v": "v", "vx": "$v_x$", "vy": "$v_y$", "omega": "ω"}
PANELS = ("paths", "base", "joints", "tip", "speeds", "joint-speeds", "efforts", "tip-over", "grip")

Draw = Callable[["Axes", Run, Theme], None]


@dataclass(frozen=True)
class FigurePanel:
    """A panel of the figure.

    Attributes:
        name: What a user calls it, one of ``PANELS``.
        title: What stands above it.
        draw: Draws it.
        joints: Whether its lines are those of the common legend.
        wide: Whether it takes a row of its own.
    """

    name: str
    title: str
    draw: Draw
    joints: bool = False
    wide: bool = False


def find_panels(run: Run) -> list[FigurePanel]:
    """Return the panels that a run has something for."""
    wheeled, arm = bool(_base_speeds(run)), run.log.ee.shape[1] > 0
    panels = []
    if wheeled or arm:
        panels.append(FigurePanel("paths", "Paths", draw_paths, wide=True))
    if wheeled:
        panels.append(FigurePanel("base", "Base error", _base_error))
    if run.robot.joint_names:
        panels.append(FigurePanel("joints", "Joint errors", _joint_errors, joints=True))
    if arm:
        panels.append(FigurePanel("tip", "End-effector error", _tip_error))
    if wheeled:
        panels.append(FigurePanel("speeds", "Base speeds", _speeds))
    if run.robot.joint_names:
        panels.append(FigurePanel("joint-speeds", "Joint speeds", _joint_speeds, joints=True))
    panels += _effort_panels(run)
    if run.log.tip_margin.size:
        panels.append(FigurePanel("tip-over", "Tip-over margin, limit dashed", _tip_margin))
    if run.log.slip_ratio.size:
        grip = f"Grip at friction {run.ground.friction:g}, limit dashed"
        panels.append(FigurePanel("grip", grip, _grip))
    return panels


def _base_speeds(run: Run) -> list[str]:
    """Return the quasi-velocities that are no joint of the arm."""
    return [name for name in run.robot.quasi_velocities if name not in run.robot.joint_names]


def _effort_panels(run: Run) -> list[FigurePanel]:
    """Return one panel for efforts with limits, and one for each unit of those without."""
    limits = np.array(run.robot.effort_limits)
    limited = [i for i, limit in enumerate(limits) if np.isfinite(limit) and limit > 0.0]
    panels = []
    if limited:

        def ratios(axes: Axes, run: Run, theme: Theme) -> None:
            for sign in (-1.0, 1.0):
                axes.axhline(sign, color=theme.ink, **LIMIT_STYLE)
            _actuator_lines(axes, run, limited, 1.0 / limits[limited], theme)
            axes.set_ylabel("effort / limit")
            effort_ratios = run.tau[:, limited] / limits[limited]
            axes.set_ylim(
                1.12 * min(-1.0, effort_ratios.min()), 1.12 * max(1.0, effort_ratios.max())
            )

        panels.append(FigurePanel("efforts", "Efforts, limits dashed", ratios, joints=True))
    for unit in ("N·m", "N"):
        chosen = [i for i in range(len(limits)) if i not in limited and _unit(run, i) == unit]
        if chosen:
            title = f"Efforts without limits, {unit}"
            panels.append(FigurePanel("efforts", title, _absolute(chosen, unit), joints=True))
    return panels


def _absolute(chosen: list[int], unit: str) -> Draw:
    def draw(axes: Axes, run: Run, theme: Theme) -> None:
        _actuator_lines(axes, run, chosen, np.ones(len(chosen)), theme)
        axes.set_ylabel(f"effort, {unit}")

    return draw


def _unit(run: Run, actuator: int) -> str:
    """Return the unit of an actuator's effort; wheels turn, so theirs is a torque."""
    name = run.robot.actuators[actuator]
    prismatic = (
        name in run.robot.joint_names and run.robot.units[run.robot.joint_names.index(name)] == "m"
    )
    return "N" if prismatic else "N·m"


def _base_error(axes: Axes, run: Run, theme: Theme) -> None:
    labels = ("longitudinal |x₁|, m", "lateral |x₂|, m", "heading |x₃|, rad")
    colours = (theme.base, theme.tip, theme.third)
    for i, (label, colour, dashes) in enumerate(zip(labels, colours, DASH_STYLES[:3], strict=True)):
        _log(axes, run, run.log.e[:, i], color=colour, ls=dashes, lw=1.1, label=label)
    _log_axis(axes, run.log.e[:, :3], "m or rad")


def _joint_errors(axes: Axes, run: Run, theme: Theme) -> None:
    errors = run.log.e[:, 3:]
    for i, name in enumerate(run.robot.joint_names):
        _log(axes, run, errors[:, i], **joint_style(run, name, theme))
    _log_axis(axes, errors, " or ".join(sorted(set(run.robot.units), reverse=True)))


def _tip_error(axes: Axes, run: Run, theme: Theme) -> None:
    distance = 1e3 * np.linalg.norm(run.log.ee_ref - run.log.ee, axis=1)
    angle = 1e3 * run.log.ee_angle
    _log(axes, run, distance, color=theme.tip, lw=1.2, label="position, mm")
    _log(
        axes, run, angle, color=theme.desired, ls=DASH_STYLES[1], lw=0.9, label="orientation, mrad"
    )
    _log_axis(axes, np.column_stack([distance, angle]), "mm or mrad")


def _speeds(axes: Axes, run: Run, theme: Theme) -> None:
    units = []
    for number, name in enumerate(_base_speeds(run)):
        units.append("m/s" if name in ("v", "vx", "vy") else "rad/s")
        label = f"{SYMBOLS.get(name) or short_name(name)}, {units[-1]}"
        column = run.robot.quasi_velocities.index(name)
        colour = theme.cycle[number % len(theme.cycle)]
        axes.plot(thin(run.t), thin(run.nu[:, column]), color=colour, lw=1.1, label=label)
    for name in _base_speeds(run):
        desired = run.log.nu_ref[:, run.robot.quasi_velocities.index(name)]
        axes.plot(thin(run.t), thin(desired), color=theme.desired, **DESIRED_STYLE)
    axes.plot([], [], color=theme.desired, label="reference", **DESIRED_STYLE)
    axes.set_xlabel("t, s")
    axes.set_ylabel(" or ".join(dict.fromkeys(units)))


def _joint_speeds(axes: Axes, run: Run, theme: Theme) -> None:
    for column, name in enumerate(run.robot.quasi_velocities):
        if name not in run.robot.joint_names:
            continue
        axes.plot(thin(run.t), thin(run.nu[:, column]), **joint_style(run, name, theme))
        if len(run.robot.joint_names) <= MAX_JOINTS_WITH_REFERENCE:
            axes.plot(
                thin(run.t), thin(run.log.nu_ref[:, column]), color=theme.desired, **DESIRED_STYLE
            )
    axes.set_xlabel("t, s")
    axes.set_ylabel(" or ".join(f"{unit}/s" for unit in sorted(set(run.robot.units), reverse=True)))


def _tip_margin(axes: Axes, run: Run, theme: Theme) -> None:
    axes.axhline(0.0, color=theme.ink, **LIMIT_STYLE)
    axes.plot(thin(run.t), thin(run.log.tip_margin), color=theme.base, lw=1.1)
    low, high = min(0.0, run.log.tip_margin.min()), max(0.0, run.log.tip_margin.max())
    axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    axes.set_xlabel("t, s")
    axes.set_ylabel("zero-moment point to edge, m")


def _grip(axes: Axes, run: Run, theme: Theme) -> None:
    axes.axhline(1.0, color=theme.ink, **LIMIT_STYLE)
    top = 1.12 * grip_top(run)
    line: dict[str, Any] = {"color": theme.tip, "lw": 1.1}
    if run.log.slip_range.size:
        low, high = np.minimum(run.log.slip_range.T, top)  # beyond, it leaves through the frame
        shade: dict[str, Any] = {"color": theme.tip, "alpha": 0.2, "lw": 0.0}
        axes.fill_between(
            thin(run.t), thin(low), thin(high), label="all splits of the load", **shade
        )
        line["label"] = "equally stiff contacts"
    axes.plot(thin(run.t), thin(run.log.slip_ratio), **line)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("t, s")
    axes.set_ylabel("force / (friction · load)")


def _actuator_lines(axes: Axes, run: Run, chosen: list[int], scale: Array, theme: Theme) -> None:
    for i, factor in zip(chosen, scale, strict=True):
        efforts = thin(run.tau[:, i] * factor)
        axes.plot(thin(run.t), efforts, **joint_style(run, run.robot.actuators[i], theme))
    axes.set_xlabel("t, s")


def _log(axes: Axes, run: Run, values: Array, **joint_style: Any) -> None:
    axes.semilogy(thin(run.t), np.maximum(np.abs(thin(values)), ERROR_FLOOR), **joint_style)


def _log_axis(axes: Axes, values: Array, unit: str) -> None:
    """Scale an error's axis to its largest value, and to what it settles at, not to its zeros."""
    top = 2.0 * max(float(np.abs(values).max()), 10.0 * ERROR_FLOOR)
    settled = np.median(np.abs(values[-max(1, len(values) // 5) :]), axis=0)
    bottom = 0.2 * max(float(settled.min()), ERROR_FLOOR)
    axes.set_ylim(max(min(bottom, 1e-2 * top), top / 10.0**MAX_DECADES), top)
    axes.set_xlabel("t, s")
    axes.set_ylabel(unit)
