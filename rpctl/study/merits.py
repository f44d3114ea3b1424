"""Which merits a run has and whether it succeeded; what they and scattered settings are called."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.errors import require_known
from rpctl.robot.model import Robot
from rpctl.simulation.merits.measures import Totals, fold, measures, merits_of, position_limits
from rpctl.simulation.merits.outcome import DIVERGING, ON_PATH_M, TRACKED
from rpctl.simulation.merits.summary import LIMIT_TOLERANCE
from rpctl.simulation.run.run import Run
from rpctl.study.statistics import Interval

AWAY, OVER_LIMIT, REFUSED = "away", "over limit", "refused"
RUN_OUTCOMES = (TRACKED, AWAY, OVER_LIMIT, DIVERGING, REFUSED)  # from good to bad


@dataclass(frozen=True)
class Merit:
    """A figure of a run.

    Attributes:
        words: What it is called where people read it.
        unit: Its unit; empty where it has none.
        what: What exactly it is, in a sentence's words.
        needs: ``"arm"``, ``"end effector"``, ``"effort limits"``, ``"velocity limits"`` or
            ``"position limits"`` where only robots that have such a thing have the figure.
    """

    words: str
    unit: str
    what: str
    needs: str = ""


MERITS: dict[str, Merit] = {
    "rms_base_error": Merit(
        "base error, rms", "m", "root mean square of P's distance from its reference"
    ),
    "final_base_error": Merit("base error at the end", "m", "that distance at the end"),
    "max_base_error": Merit("largest base error", "m", "its largest"),
    "settled_rms_base_error": Merit(
        "base error, rms of the second half", "m", "its root mean square over the second half"
    ),
    "final_lateral_error": Merit(
        "lateral error at the end", "m", "size of its lateral part at the end"
    ),
    "rms_end_effector_error": Merit(
        "end effector error, rms",
        "m",
        "root mean square of the end effector's distance from its reference",
        "end effector",
    ),
    "final_end_effector_error": Merit(
        "end effector error at the end", "m", "that distance at the end", "end effector"
    ),
    "max_joint_error": Merit(
        "largest joint error",
        "rad or m",
        "largest distance of a joint of the arm from its reference",
        "arm",
    ),
    "max_effort_ratio": Merit(
        "largest effort over its limit", "", "largest effort over its limit", "effort limits"
    ),
    "max_speed_ratio": Merit(
        "largest speed over its limit",
        "",
        "largest rate of an actuator's joint over its limit",
        "velocity limits",
    ),
    "max_position_excess": Merit(
        "farthest beyond a position limit",
        "rad or m",
        "how far a joint of the arm or one that steers went beyond its limits; negative: it stayed "
        "as far within",
        "position limits",
    ),
    "work": Merit("work of the actuators", "J", "what the actuators did in all"),
    "lost": Merit(
        "work lost to friction", "J", "what damping and friction in the joints took of it"
    ),
    "settling_time": Merit(
        "settling time", "s", f"since when P stays within {ON_PATH_M:g} m; inf: it does not"
    ),
    "samples_at_limits": Merit(
        "samples at a limit of effort", "", "number of samples at which a limit bound the efforts"
    ),
}


def merits_for(robot: Robot, chosen: tuple[str, ...] | None = None) -> tuple[str, ...]:
    """Return the names of the merits that a robot has.

    Args:
        robot: The robot.
        chosen: Which of them are wanted; None: all that it has.

    Raises:
        UnknownNameError: One is none of this robot's.
    """
    positions = [each for pair in position_limits(robot) for each in pair]
    has = {
        "": True,
        "arm": bool(robot.joints),
        "end effector": robot.end_effector is not None,
        "effort limits": bool(np.isfinite(robot.effort_limits).any()),
        "velocity limits": bool(np.isfinite(robot.velocity_limits).any()),
        "position limits": bool(np.isfinite(positions).any()),
    }
    names = tuple(name for name, merit in MERITS.items() if has[merit.needs])
    require_known(f"merit of {robot.name}", chosen or (), names)
    return names if chosen is None else tuple(chosen)


class RunVerdict(NamedTuple):
    """What became of a run: one of :data:`RUN_OUTCOMES`, and why, in words."""

    outcome: str
    reason: str


def verdict(totals: Totals, count: int, tolerance: float = ON_PATH_M) -> RunVerdict:
    """Return what became of a run that came to its end.

    It succeeded if P and the end effector were within the tolerance of their references, on average
    over the last quarter, and no limit of an effort, a rate or a position was broken.

    Args:
        totals: What was folded of its samples, a number each.
        count: Number of its samples.
        tolerance: m.
    """
    samples = count - 3 * count // 4
    broken = {
        "effort": totals.effort_max - 1.0,
        "velocity": totals.speed_max - 1.0,
        "position": totals.excess_max,
    }
    found = [kind for kind, excess in broken.items() if excess > LIMIT_TOLERANCE]
    if found:
        return RunVerdict(OVER_LIMIT, f"it broke limits of {' and '.join(found)}")
    away = {"base": totals.base_last / samples, "end effector": totals.tip_last / samples}
    name, mean = max(away.items(), key=lambda each: float(each[1]))
    return RunVerdict(
        TRACKED if mean <= tolerance else AWAY,
        f"{name} is {float(mean):.3g} m from its reference on average over the last quarter",
    )


def run_merits(run: Run, tolerance: float = ON_PATH_M) -> tuple[dict[str, float], RunVerdict]:
    """Return the merits of a run that logged every sample, by name, and what became of it.

    Args:
        run: The run.
        tolerance: How far from its reference it may be on average over its last quarter, m.
    """
    log, count = run.log, len(run.t)
    totals = fold(measures(run))
    found = merits_of(totals, log.work[-1], log.lost[-1], count, run.config.run.control_period)
    return {name: float(value) for name, value in found.items()}, verdict(totals, count, tolerance)


# ---- what is shown to people: names, units, numbers ---------------------------------------

MM_BELOW_M = 1.0  # lengths below are shown in mm
OF_FILE = "× the file's"
PARAMETERS = {  # by path, or by the path up to a pattern of names: words and unit
    "plant.tau_bias": ("constant extra effort", "N·m or N"),
    "plant.delay": ("delay", "s"),
    "plant.joint_friction": ("dry friction", "N·m or N"),
    "plant.dropped": ("share of samples lost", ""),
    "plant.masses": ("mass", OF_FILE),
    "plant.centres": ("centre of mass", "m"),
    "plant.inertias": ("inertia", OF_FILE),
    "plant.radii": ("wheel radius", OF_FILE),
    "plant.track": ("track", OF_FILE),
    "plant.damping": ("added damping", ""),
    "plant.noise.position": ("noise of position", "m"),
    "plant.noise.heading": ("noise of heading", "rad"),
    "plant.noise.joints": ("noise of joints", "rad or m"),
    "plant.noise.speed": ("noise of speed", "m/s"),
    "plant.noise.turn_rate": ("noise of turning rate", "rad/s"),
    "plant.noise.joint_rates": ("noise of joint rates", "rad/s or m/s"),
    "plant.payload.mass": ("payload", "kg"),
    "plant.slope.along_x": ("slope along x", "rad"),
    "plant.slope.along_y": ("slope along y", "rad"),
    "plant.effort_lag": ("lag of efforts", "s"),
    "plant.effort": ("effort limits", OF_FILE),
    "plant.backlash": ("backlash", "rad or m"),
    "plant.jitter": ("jitter of samples", "s"),
    "plant.lag": ("lag", "s"),
    "plant.lags": ("lag", "s"),
    "plant.dead_time": ("dead time", "s"),
    "run.initial_error.x": ("initial error along x", "m"),
    "run.initial_error.y": ("initial error along y", "m"),
    "run.initial_error.theta": ("initial error of heading", "rad"),
    "kinematic.horizon": ("kinematic horizon", "s"),
    "kinematic.joint_horizon": ("kinematic horizon of joints", "s"),
    "kinematic.beta": ("weight β of the lateral error", ""),
    "kinematic.leash.distance": ("leash's distance", "m"),
    "kinematic.leash.heading": ("leash's heading", "rad"),
    "kinematic.approach.distance": ("approach's distance", "m"),
    "kinematic.approach.heading": ("approach's heading", "rad"),
    "dynamic.horizon_dyn": ("dynamic horizon", "s"),
    "dynamic.joint_horizon_dyn": ("dynamic horizon of joints", "s"),
    "dynamic.inner.horizon_dyn": ("dynamic horizon", "s"),
    "dynamic.inner.joint_horizon_dyn": ("dynamic horizon of joints", "s"),
    "dynamic.gain": ("integral gain", "1/s"),
    "dynamic.joint_gain": ("integral gain of joints", "1/s"),
}


THINGS = {  # that a pattern names, where these are not joints
    **dict.fromkeys(("plant.masses", "plant.centres", "plant.inertias"), "links"),
    "plant.radii": "wheels",
    "plant.lags": "quasi-velocities",
}


class Words(NamedTuple):
    """What something is called, and its unit; empty where it has none."""

    name: str
    unit: str

    def __str__(self) -> str:
        """Return the name with its unit in parentheses."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


class Unit(NamedTuple):
    """How numbers are shown: times ``factor``, with ``name`` behind them."""

    factor: float
    name: str


def merit_words(name: str) -> str:
    """Return what a merit is called: ``rms_base_error`` is ``base error, rms``."""
    return MERITS[name].words if name in MERITS else name.replace("_", " ")


def merit_unit(name: str) -> str:
    """Return the unit of a merit; empty where it has none."""
    return MERITS[name].unit if name in MERITS else ""


def parameter_words(path: str) -> Words:
    """Return what a scattered setting is called, and its unit.

    Args:
        path: As ``plant.masses.arm_*``, which is ``mass of links arm_*``; of ``*`` it is that of
            all links.
    """
    if path in PARAMETERS:
        return Words(*PARAMETERS[path])
    for known, (name, unit) in PARAMETERS.items():
        if path.startswith(f"{known}."):
            pattern, axis = path.removeprefix(f"{known}."), ""
            if known == "plant.centres":
                pattern, _, axis = pattern.rpartition(".")
            if "*" in pattern:
                things = THINGS.get(known, "joints")
                pattern = f"all {things}" if pattern == "*" else f"{things} {pattern}"
            return Words(f"{name} of {pattern}{axis and f' along {axis}'}", unit)
    table, _, rest = path.partition(".")
    return Words((rest or table).replace("_", " ").replace(".", " "), "")


def unit_of(name: str, largest: float) -> Unit:
    """Return how numbers of a unit are shown.

    Args:
        name: The unit; empty: a plain number.
        largest: The largest number.
    """
    return Unit(1e3, "mm") if name == "m" and abs(largest) < MM_BELOW_M else Unit(1.0, name)


def number(value: float, unit: Unit | None = None) -> str:
    """Return a number of three digits with its unit; a dash where there is none.

    Args:
        value: The number.
        unit: How it is shown.
    """
    factor, name = unit or Unit(1.0, "")
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    shown = value * factor
    text = f"{shown:.0f}" if 1e3 <= abs(shown) < 1e6 else f"{shown:.3g}"
    return f"{text} {name}".strip().replace("-", "−")


def grouped(count: int) -> str:
    """Return a count whose thousands stand apart from 10 000 on."""
    return f"{count:,}".replace(",", " ") if count >= 10_000 else str(count)


def percent(share: float) -> str:
    """Return a share (0 to 1) in per cent, with digits enough to tell it from 0 and from 100 %."""
    gap = min(share, 1.0 - share)
    digits = 1 if gap > 0.01 else 0 if gap <= 0.0 else min(-math.floor(math.log10(100.0 * gap)), 6)
    text = f"{100.0 * share:.{digits}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def share_span(found: Interval) -> str:
    """Return the interval of a share, as ``99.96 to 100 %``."""
    return f"{percent(found.low).removesuffix(' %')} to {percent(found.high)}"
