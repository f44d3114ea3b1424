"""What the interactive plots of a run show: lines over time, by what they measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run

BASE_SPEED_LABELS = {
    "v": ("v", "m/s"),
    "vx": ("vx", "m/s"),
    "vy": ("vy", "m/s"),
    "omega": ("ω", "rad/s"),
}
GRIP_SHOWN_MAX = 3.0  # that a grip's line shows at most: beyond, the wheel slips or is in the air


@dataclass(frozen=True, eq=False)
class ChartLine:
    """One line of a chart.

    Attributes:
        label: What it shows.
        unit: Unit of the value that a reader is told.
        values: What is drawn (K,).
        colour: Its number in the page's palette.
        scale: The value told is what is drawn times this.
        reference: What it should be (K,), drawn dashed, or None.
        shown: Whether it is drawn until somebody asks for it.
        band: The least and the largest value (K,) that it may have, the latter inf where it is far
            beyond the axis; None where there is one value.
    """

    label: str
    unit: str
    values: Array
    colour: int
    scale: float = 1.0
    reference: Array | None = None
    shown: bool = True
    band: tuple[Array, Array] | None = None


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
    """

    title: str
    unit: str
    lines: tuple[ChartLine, ...]
    limits: tuple[float, ...] = ()
    errors: bool = False
    note: str = ""


def charts(run: Run) -> list[Chart]:
    """Return the charts that suit a run: errors, speeds, efforts, and what the ground bears."""
    found = [_base_error(run), _tip_error(run), _joint_errors(run)]
    found += [*_speeds(run), *_efforts(run), *_margins(run), _loads(run)]
    return [chart for chart in found if chart is not None and chart.lines]


def has_base(run: Run) -> bool:
    """Return whether the base moves."""
    return any(_of_base(run, name) for name in run.robot.quasi_velocities)


def short_name(joint: str) -> str:
    """Return a joint's name without what all joints' names end in."""
    return joint.removesuffix("_joint")


def _base_error(run: Run) -> Chart | None:
    if not has_base(run):
        return None
    x1, x2, x3 = run.log.e[:, :3].T
    lines = (
        ChartLine("distance", "m", np.hypot(x1, x2), 3, shown=False),
        ChartLine("longitudinal x₁", "m", x1, 0),
        ChartLine("lateral x₂", "m", x2, 1),
        ChartLine("heading x₃", "rad", x3, 2),
    )
    return Chart("Base error", "m, rad", lines, errors=True)


def _tip_error(run: Run) -> Chart | None:
    if not run.log.ee.shape[1]:
        return None
    distance = np.linalg.norm(run.log.ee_ref - run.log.ee, axis=1)
    lines = (
        ChartLine("position", "m", distance, 1),
        ChartLine("orientation", "rad", run.log.ee_angle, 4),
    )
    return Chart("End-effector error", "m, rad", lines, errors=True)


def _joint_errors(run: Run) -> Chart:
    lines = tuple(
        ChartLine(short_name(name), unit, error, _colour(run, name))
        for name, unit, error in zip(
            run.robot.joint_names, run.robot.units, run.log.e[:, 3:].T, strict=True
        )
    )
    return Chart("Joint errors", _units(lines), lines, errors=True)


def _speeds(run: Run) -> list[Chart]:
    """Return the quasi-velocities with their reference: of the base, the arm, and the rest."""
    groups: dict[str, list[ChartLine]] = {"Base speeds": [], "Joint speeds": [], "Other speeds": []}
    for name, actual, wanted in zip(
        run.robot.quasi_velocities, run.nu.T, run.log.nu_ref.T, strict=True
    ):
        if _of_base(run, name):
            label, unit = BASE_SPEED_LABELS[name]
            title, colour = "Base speeds", len(groups["Base speeds"])
        else:
            label, unit, colour = short_name(name), f"{_unit(run, name)}/s", _colour(run, name)
            title = "Joint speeds" if name in run.robot.joint_names else "Other speeds"
        groups[title].append(ChartLine(label, unit, actual, colour, reference=wanted))
    return [
        Chart(title, _units(lines), tuple(lines), note="dashed: reference")
        for title, lines in groups.items()
    ]


def _efforts(run: Run) -> list[Chart]:
    """Return the efforts as shares of their limits, and for each unit those without limits."""
    limited: list[ChartLine] = []
    free: dict[str, list[ChartLine]] = {"N·m": [], "N": []}
    for name, tau, limit in zip(
        run.robot.actuators, run.tau.T, run.robot.effort_limits, strict=True
    ):
        unit, colour = "N" if _unit(run, name) == "m" else "N·m", _colour(run, name)
        if np.isfinite(limit) and limit > 0.0:
            limited.append(
                ChartLine(short_name(name), unit, 100.0 * tau / limit, colour, 0.01 * limit)
            )
        else:
            free[unit].append(ChartLine(short_name(name), unit, tau, colour))
    found = [Chart("Efforts", "% of limit", tuple(limited), (-100.0, 100.0), note="dashed: limits")]
    return found + [
        Chart(f"Efforts without limits, {unit}", unit, tuple(lines)) for unit, lines in free.items()
    ]


def _margins(run: Run) -> list[Chart]:
    if not run.log.tip_margin.size:
        return []
    tip = ChartLine("zero-moment point to edge", "m", run.log.tip_margin, 0)
    top = grip_top(run)
    used, band = 100.0 * np.minimum(run.log.slip_ratio, top), None
    if run.log.slip_range.size:
        least, most = 100.0 * run.log.slip_range.T
        band = np.minimum(least, 100.0 * top), np.where(most > 100.0 * top, np.inf, most)
    grip = ChartLine("force / (friction · load)", "%", used, 1, band=band)
    most = max(float(run.log.slip_ratio.max()), float(np.nanmax(run.log.slip_range, initial=0.0)))
    beyond = f" (drawn up to {100.0 * top:.0f})" if most > top else ""
    slips = f"friction {run.ground.friction:g}, slips above 100{beyond}"
    return [
        Chart("Tip-over margin", "m", (tip,), (0.0,), note="tips below the dashed line"),
        Chart("Grip used", "%", (grip,), (100.0,), note=slips + _shading(run)),
    ]


def grip_top(run: Run) -> float:
    """Return how far a grip's axis reaches: to all that is needed, unless that is far too much."""
    needed = [1.0, min(float(run.log.slip_ratio.max()), GRIP_SHOWN_MAX)]
    most = float(np.nanmax(run.log.slip_range, initial=0.0))
    return max(*needed, most if most <= GRIP_SHOWN_MAX else 0.0)


def _shading(run: Run) -> str:
    return "; shaded: all splits of the load" if run.log.slip_range.size else ""


def _loads(run: Run) -> Chart:
    bands: list[tuple[Array, Array] | None] = [None] * len(run.ground.contacts)
    if run.log.load_range.size:
        bands = [(low, high) for low, high in run.log.load_range.transpose(1, 2, 0)]
    lines = tuple(
        ChartLine(short_name(name), "N", load, k, band=band)
        for k, (name, load, band) in enumerate(
            zip(run.ground.contacts, run.log.contact_load.T, bands, strict=False)
        )
    )
    return Chart("Ground loads", "N", lines, note=_shading(run).removeprefix("; "))


def _of_base(run: Run, name: str) -> bool:
    """Return whether a quasi-velocity is the base's, and not that of a joint which is called so."""
    return name in BASE_SPEED_LABELS and name not in run.robot.joint_names


def _unit(run: Run, joint: str) -> str:
    """Return the unit of a joint's position; wheels and steering, which are no arm's, turn."""
    return (
        run.robot.units[run.robot.joint_names.index(joint)]
        if joint in run.robot.joint_names
        else "rad"
    )


def _units(lines: tuple[ChartLine, ...] | list[ChartLine]) -> str:
    return ", ".join(dict.fromkeys(line.unit for line in lines))


def _colour(run: Run, joint: str) -> int:
    """Return a joint's number, the same in all charts."""
    return list(dict.fromkeys((*run.robot.actuators, *run.robot.joint_names, joint))).index(joint)
