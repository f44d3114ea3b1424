"""What the names in a study's files are called where people read them, and in which unit.

Merits have their words in :data:`~rpctl.study.merits.MERITS`, scattered settings here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rpctl.study.merits import MERITS
from rpctl.study.statistics import Interval

MM_BELOW_M = 1.0  # lengths below are shown in mm
OF_FILE = "× the file's"
PARAMETERS = {  # by path, or by the path up to a pattern of names: words and unit
    "plant.tau_bias": ("effort's bias", "N·m or N"),
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
        path: As ``plant.masses.arm_*``, which is ``mass of arm_*``.
    """
    if path in PARAMETERS:
        return Words(*PARAMETERS[path])
    for known, (name, unit) in PARAMETERS.items():
        if path.startswith(f"{known}."):
            rest = path.removeprefix(f"{known}.")
            if known == "plant.centres":
                pattern, _, axis = rest.rpartition(".")
                return Words(f"{name} of {pattern} along {axis}", unit)
            return Words(f"{name} of {rest}", unit)
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
