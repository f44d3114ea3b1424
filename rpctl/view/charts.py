"""The charts of a run, described once: the page and the paper figure both draw these."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.leaning import MAX_TILT
from rpctl.simulation.merits.collision_facts import GROUND, SELF
from rpctl.simulation.run.run import Run
from rpctl.view.labels import shorten

BASE_SPEED_LABELS = {
    "v": ("forward", "m/s"),
    "vx": ("forward", "m/s"),
    "vy": ("to the left", "m/s"),
    "omega": ("turning", "rad/s"),
    "pitch_rate": ("pitch rate", "rad/s"),
    "roll_rate": ("roll rate", "rad/s"),
}
ALL_SPLITS = "all splits of the load"  # what a band shows
EQUAL_SPRINGS = "equally stiff contacts"  # what the line in a band shows
GRIP_SHOWN_MAX = 3.0  # largest slip ratio drawn; beyond it the curve is clipped
MAX_JOINTS_WITH_REFERENCE = 3  # a panel with more joints has no room for their references
CLEARANCE_SHOWN_MAX = 1.0  # m: links that are farther from a thing are far
NEAR_M = 0.1  # m: from where on it is shown how near links are to the ground or to each other,
NEAR_RATIO = 0.5  # if at the start they were farther than this allows
OWN_THINGS = {SELF: "each other", GROUND: "ground"}  # in legends
FAR_RATIO = 0.2  # of limits: efforts and tilts below it would be flat lines beside them
AXIS_ZOOM = 1.12  # a panel's axis ends at the extreme values times this,
AXIS_MARGIN = 0.08  # or this fraction of their range beyond them


def charts(run: Run) -> Iterator[Chart]:
    """Yield the charts that a run has data for: errors, speeds, efforts, margins, loads.

    One by one: the lines of all at once are most of a long run's memory.
    """
    for make in MAKERS:
        yield from (chart for chart in make(run) if chart.lines)


def has_base(run: Run) -> bool:
    """Return whether the base moves."""
    return any(_of_base(run, name) for name in run.robot.quasi_velocities)


def coloured_joints(run: Run) -> list[str]:
    """Return the joints in the order of their colours, the same in all charts."""
    return list(dict.fromkeys((*run.robot.actuators, *run.robot.joint_names)))


def grip_top(run: Run) -> float:
    """Return the upper end of the slip-ratio axis: the largest value, from 1 to GRIP_SHOWN_MAX.

    Of the band, a largest value beyond GRIP_SHOWN_MAX does not count.
    """
    most = float(np.nanmax(run.log.slip_range, initial=0.0))
    needed = min(float(run.log.slip_ratio.max()), GRIP_SHOWN_MAX)
    return max(1.0, needed, most if most <= GRIP_SHOWN_MAX else 0.0)


def _base_error(run: Run) -> list[Chart]:
    if not has_base(run):
        return []
    x1, x2, x3 = run.log.e[:, :3].T
    lines = (
        Line("distance", "m", np.hypot(x1, x2), 3, shown=False),
        Line("longitudinal", "m", x1, 0),
        Line("lateral", "m", x2, 1, dash=1),
        Line("heading", "rad", x3, 2, dash=2),
    )
    panel = Panel("base", "Base error", legend="own")
    note = "positive: reference ahead, to the left"
    return [Chart("Base error", "m, rad", lines, errors=True, note=note, panel=panel)]


def _tilt(run: Run) -> list[Chart]:
    """Return how a root link that leans pitches forward and rolls to the right."""
    if not run.robot.drive.leans:
        return []
    x, y, z, w = run.q[:, 3:7].T
    rises = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x)])  # of its x and y axes
    cos, sin = np.cos(run.robot.drive.heading), np.sin(run.robot.drive.heading)
    ahead, left = np.array([[cos, sin], [-sin, cos]]) @ rises
    pitch = np.arctan2(-ahead, 1.0 - 2.0 * (x * x + y * y))
    roll = np.arcsin(np.clip(left, -1.0, 1.0))
    lines = (
        Line("pitch", "rad", pitch, 0, printed="pitch, forward"),
        Line("roll", "rad", roll, 1, printed="roll, to the right", dash=1),
    )
    far = max(np.abs(pitch).max(), np.abs(roll).max()) < FAR_RATIO * MAX_TILT
    limits, end = ((), f"±{MAX_TILT:g} rad") if far else ((-MAX_TILT, MAX_TILT), "the dashed lines")
    panel = Panel("tilt", "Tilt" if far else "Tilt, limits dashed", "rad", legend="own")
    note = f"forward, and to the right; fallen beyond {end}"
    return [Chart("Tilt", "rad", lines, limits, note=note, panel=panel)]


def _tip_error(run: Run) -> list[Chart]:
    if not run.log.ee.shape[1]:
        return []
    distance = np.linalg.norm(run.log.ee_ref - run.log.ee, axis=1)
    lines = (
        Line("position", "m", distance, 1),
        Line("orientation", "rad", run.log.ee_angle, 4, dash=1),
    )
    panel = Panel("tip", "End-effector error", legend="own")
    return [Chart("End-effector error", "m, rad", lines, errors=True, panel=panel)]


def _joint_errors(run: Run) -> list[Chart]:
    lines = tuple(
        Line(name, unit, error, _colour(run, name))
        for name, unit, error in zip(
            run.robot.joint_names, run.robot.units, run.log.e[:, 3:].T, strict=True
        )
    )
    panel, note = Panel("joints", "Joint errors", legend="joints"), "reference minus actual"
    unit = _units(lines)
    return [Chart("Joint errors", unit, lines, errors=True, note=note, panel=panel, named=True)]


def _speeds(run: Run) -> list[Chart]:
    """Return the quasi-velocities with their reference: of the base, the arm, and the rest.

    On paper the rest, steering, joins the base and continues its colours.
    """
    base, arm, rest = _speed_lines(run)
    short = shorten([line.label for line in rest])
    joining = tuple(
        replace(line, colour=k, label=name)
        for k, (line, name) in enumerate(zip(rest, short.names, strict=True), len(base))
    )
    unit, few = _units([*base, *joining], " or "), len(arm) <= MAX_JOINTS_WITH_REFERENCE
    titles = "Base speeds", "Joint speeds", "Other speeds"
    panels = (
        Panel("speeds", titles[0], unit, legend="own", more=joining, shared=short.shared),
        Panel("joint-speeds", titles[1], _units(arm, " or "), legend="joints", references=few),
        None,
    )
    note = "dashed: reference"
    return [
        Chart(title, _units(lines), tuple(lines), note=note, panel=panel, named=lines is not base)
        for title, lines, panel in zip(titles, (base, arm, rest), panels, strict=True)
    ]


def _speed_lines(run: Run) -> tuple[list[Line], list[Line], list[Line]]:
    """Return the lines of the base's speeds, of the arm's, and of the rest."""
    base: list[Line] = []
    arm: list[Line] = []
    rest: list[Line] = []
    for name, actual, wanted in zip(
        run.robot.quasi_velocities, run.nu.T, run.log.nu_ref.T, strict=True
    ):
        if _of_base(run, name):
            group, colour, (label, unit) = base, len(base), BASE_SPEED_LABELS[name]
        else:
            group = arm if name in run.robot.joint_names else rest
            colour, label, unit = _colour(run, name), name, f"{_unit(run, name)}/s"
        group.append(Line(label, unit, actual, colour, reference=wanted))
    return base, arm, rest


def _efforts(run: Run) -> list[Chart]:
    """Return the efforts in percent of their limits, and for each unit those without limits."""
    limited: list[Line] = []
    free: dict[str, list[Line]] = {"N·m": [], "N": []}
    for name, tau, limit in zip(
        run.robot.actuators, run.tau.T, run.robot.effort_limits, strict=True
    ):
        colour = _colour(run, name)
        unit = "N" if _unit(run, name) == "m" else "N·m"
        if np.isfinite(limit) and limit > 0.0:
            limited.append(Line(name, "%", 100.0 * tau / limit, colour))
        else:
            free[unit].append(Line(name, unit, tau, colour))
    ends = (
        min([-100.0, *(float(line.values.min()) for line in limited)]),
        max([100.0, *(float(line.values.max()) for line in limited)]),
    )
    far = all(np.abs(line.values).max() < 100.0 * FAR_RATIO for line in limited)
    panel = Panel(
        "efforts",
        "Efforts" if far else "Efforts, limits dashed",
        "effort, % of limit",
        legend="joints",
        span=None if far else (AXIS_ZOOM * ends[0], AXIS_ZOOM * ends[1]),
    )
    limits, note = ((), "limits: ±100 %") if far else ((-100.0, 100.0), "dashed: limits")
    found = [
        Chart("Efforts", "% of limit", tuple(limited), limits, note=note, panel=panel, named=True)
    ]
    for unit, lines in free.items():
        title = f"Efforts without limits, {unit}"
        panel = Panel("efforts", title, f"effort, {unit}", legend="joints")
        found.append(Chart(title, unit, tuple(lines), panel=panel, named=True))
    return found


def _tip_margin(run: Run) -> list[Chart]:
    margins = run.log.tip_margin
    if not margins.size:
        return []
    label = "zero-moment point to edge"
    low, high = min(0.0, float(margins.min())), max(0.0, float(margins.max()))
    room = AXIS_MARGIN * (high - low)
    span, title = (low - room, high + room), "Tip-over margin, limit dashed"
    panel = Panel("tip-over", title, f"{label}, m", span=span)
    line, note = Line(label, "m", margins, 0), "tips below the dashed line"
    return [Chart("Tip-over margin", "m", (line,), (0.0,), note=note, panel=panel)]


def _grip(run: Run) -> list[Chart]:
    if not run.log.slip_ratio.size:
        return []
    label, top = "force / (friction · load)", 100.0 * grip_top(run)
    least_most = 100.0 * run.log.slip_range.T
    band = None
    if least_most.size:  # beyond the top it has no upper bound
        band = np.minimum(least_most[0], top), np.where(least_most[1] > top, np.inf, least_most[1])
    ratio = 100.0 * run.log.slip_ratio
    line = Line(label, "%", np.minimum(ratio, top), 1, band=band, printed=EQUAL_SPRINGS)
    most = max(float(ratio.max()), float(np.nanmax(least_most, initial=0.0)))
    panel = Panel(
        "grip",
        f"Grip at friction {run.ground.friction:g}, limit dashed",
        f"{label}, %",
        legend="own" if band else "none",
        span=(0.0, AXIS_ZOOM * top),
    )
    note = f"friction {run.ground.friction:g}, slips above 100"
    note += f" (drawn up to {top:.0f})" if most > top else ""
    note += f"; shaded: {ALL_SPLITS}" if band else ""
    return [Chart("Grip used", "%", (line,), (100.0,), note=note, panel=panel)]


def _loads(run: Run) -> list[Chart]:
    """Return the vertical forces of the ground; no panel has them."""
    loads, note = run.log.contact_load, ""
    bands: list[tuple[Array, Array] | None] = [None] * len(run.ground.contacts)
    if run.log.ground_load.size:  # what the plant has, not what the reduced model makes of it
        loads, note = run.log.ground_load, "as the plant has them"
    elif run.log.load_range.size:
        bands = [(low, high) for low, high in run.log.load_range.transpose(1, 2, 0)]
        note = f"shaded: {ALL_SPLITS}"
    named = zip(run.ground.contacts, loads.T, bands, strict=False)
    lines = [Line(name, "N", load, k, band=band) for k, (name, load, band) in enumerate(named)]
    return [Chart("Ground loads", "N", tuple(lines), note=note, named=True)]


def _slips(run: Run) -> list[Chart]:
    """Return how fast the wheels slip over the ground; no panel has it."""
    speeds = np.linalg.norm(run.log.wheel_slip, axis=2).T if run.log.wheel_slip.size else ()
    lines = tuple(
        Line(wheel.joint, "mm/s", 1e3 * speed, k)
        for k, (wheel, speed) in enumerate(zip(run.robot.drive.wheels, speeds, strict=False))
    )
    note = "of the contact point over the ground"
    return [Chart("Wheel slip", "mm/s", lines, note=note, named=True)]


def _clearances(run: Run) -> list[Chart]:
    """Return the distances of the links to obstacles, and to what else they came near."""
    facts = run.collisions
    if facts is None:
        return []
    lines: list[Line] = []
    for clearance, series in zip(facts.clearances, facts.series, strict=True):
        least = clearance.distance
        near = least < 0.0 or (least < NEAR_M and least < NEAR_RATIO * series[0])
        if clearance.to in OWN_THINGS and not near:
            continue  # links do not come near to the ground, or are near to each other by build
        known = np.array([*zip(facts.times, series, strict=True),
                          (clearance.time, clearance.distance)])  # fmt: skip
        known = known[np.argsort(known[:, 0], kind="stable")]
        label = OWN_THINGS.get(clearance.to, clearance.to.removeprefix("the "))
        values = np.minimum(np.interp(run.t, *known.T), CLEARANCE_SHOWN_MAX)
        lines.append(Line(label, "m", values, len(lines), dash=len(lines)))
    values = np.array(
        [0.0, *(end for line in lines for end in (line.values.min(), line.values.max()))]
    )
    margin = AXIS_MARGIN * float(np.ptp(values))
    span = float(values.min()) - margin, float(values.max()) + margin
    title = "Clearance of the links, contact dashed"
    panel = Panel("clearance", title, "distance, m", legend="own", span=span)
    note = "collides below the dashed line"
    return [Chart("Clearance", "m", tuple(lines), (0.0,), note=note, panel=panel)]


def _of_base(run: Run, name: str) -> bool:
    """Return whether a quasi-velocity is the base's, and not that of a joint with such a name."""
    return name in BASE_SPEED_LABELS and name not in run.robot.joint_names


def _unit(run: Run, joint: str) -> str:
    """Return the unit of a joint's position; wheels and steering, which are no arm's, turn."""
    return dict(zip(run.robot.joint_names, run.robot.units, strict=True)).get(joint, "rad")


def _colour(run: Run, joint: str) -> int:
    return list(dict.fromkeys((*coloured_joints(run), joint))).index(joint)


def _units(lines: Iterable[Line], between: str = ", ") -> str:
    return between.join(dict.fromkeys(line.unit for line in lines))


MAKERS: tuple[Callable[[Run], list[Chart]], ...] = (
    _base_error, _tilt, _tip_error, _joint_errors, _speeds, _efforts, _tip_margin, _grip, _loads,
    _slips, _clearances,
)  # fmt: skip


# Panels of the paper figure, in its order
PANELS = (
    "paths",
    "base",
    "tilt",
    "joints",
    "tip",
    "speeds",
    "joint-speeds",
    "efforts",
    "tip-over",
    "grip",
    "clearance",
)
NOISE = 1e-6  # m or rad: an error below it is noise, to which no axis is scaled
MAX_DECADES = 6.0  # of an error's logarithmic axis
PREFIXES = {"": 1.0, "m": 1e3, "µ": 1e6}  # of the units of errors: an axis' numbers are times this
LEAST_SHOWN = 0.1  # of an axis' largest number, in the unit with its prefix


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart.

    Attributes:
        label: What it shows.
        unit: Unit of the value that the page's legend gives.
        values: What is drawn (K,), in the unit of the chart's axis.
        colour: Index into a palette, the same on page and paper.
        reference: The desired values (K,), drawn dashed, or None.
        shown: Whether it is visible at first; paper omits it otherwise.
        band: The smallest and the largest possible value (K,); inf where there is no upper bound,
            NaN where it is not defined. None where there is one value.
        printed: Its name in a legend of its panel, where that is another one.
        dash: Index of its dash pattern on paper; the page draws all lines solid.
    """

    label: str
    unit: str
    values: Array
    colour: int
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
        axis: Label of the value axis; of errors it is their unit.
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
    axis: str = ""
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
        errors: Whether its lines are errors in m or rad: on a logarithmic axis, where it is
            chosen, their size is drawn.
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
    """Return the ends of an error's logarithmic axis, above noise.

    They are a fifth of the settled error and twice the largest.
    """
    errors = [np.abs(line.values) for line in lines if line.shown]
    top = 2.0 * max(*(float(error.max()) for error in errors), 5.0 * NOISE)
    settled = min(float(np.median(error[-max(1, len(error) // 5) :])) for error in errors)
    return max(min(0.2 * settled, 1e-2 * top), top / 10.0**MAX_DECADES, NOISE), top


def error_span(lines: Iterable[Line]) -> tuple[float, float]:
    """Return the ends of an error's linear axis: it holds 0, and is not scaled to noise."""
    values = [line.values for line in lines if line.shown]
    low = min(-NOISE, *(float(np.fmin.reduce(each)) for each in values))
    high = max(NOISE, *(float(np.fmax.reduce(each)) for each in values))
    margin = AXIS_MARGIN * (high - low)
    return low - margin, high + margin


def prefixed(chart: Chart) -> tuple[str, float]:
    """Return the prefix of an error's units that suits its largest value, and its factor."""
    top = max(map(abs, error_span(chart.lines)))
    return next(each for each in PREFIXES.items() if top * each[1] >= LEAST_SHOWN)


def noise_note(chart: Chart) -> str:
    """Return what is said of errors that are all noise; empty where one is not."""
    shown = [line for line in chart.lines if line.shown]
    small = all(np.abs(line.values).max() < NOISE for line in shown)
    units = " and ".join(dict.fromkeys(f"1 µ{line.unit}" for line in shown))
    return f"all below {units}" if small else ""
