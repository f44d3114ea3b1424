"""The verdict on a stressed run: the rule, once."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from rpctl.simulation.outcome import LATE, SUCCESSES
from rpctl.simulation.texts import length

PASS, DEGRADE, FAIL, REFUSED = "pass", "degrade", "fail", "refused"
VERDICTS = (PASS, DEGRADE, FAIL)  # from good to bad; a run that was refused has none
ENDED = "ended"  # outcome of a run that came to no end
TOLERANCE_RATIO = 0.01  # of the robot's length: how far from its reference a run that passes may be
MOST_TOLD = 3  # broken limits that a reason names; the figures have all
MAX_TILT = math.radians(10.0)  # rad: tyres and casters give way by less; a fall goes on beyond it


@dataclass(frozen=True)
class StressFigures:
    """What became of a stressed run.

    Attributes:
        outcome: In a word of :mod:`rpctl.simulation.outcome`; ``"ended"`` if it came to no end,
            ``"refused"`` if it never began.
        sentence: Why, in words.
        time: Simulated, s.
        base_error: Distance of P from its reference, root mean square of the second half, m; None
            of a run without an end.
        end_effector_error: Likewise of the end effector; None without one, too.
        violations: The limits of the URDF that were broken, each as ``JOINT KIND``.
        would_slip: Whether its motion needs more grip than there is, on a plant that always rolls.
        would_tip: Whether its motion would lift a wheel, on a plant that cannot fall.
        tilt: Largest angle by which the robot leant over from where it stood, rad.
        felt_ground: What the plant says of the ground, in words; empty where its wheels roll.
        lifted_wheels: Wheels that bore nothing for a while.
        hanging_wheels: Those of them that bore nothing where it stood, before it moved.
    """

    outcome: str
    sentence: str
    time: float = 0.0
    base_error: float | None = None
    end_effector_error: float | None = None
    violations: tuple[str, ...] = ()
    would_slip: bool = False
    would_tip: bool = False
    tilt: float = 0.0
    felt_ground: str = ""
    lifted_wheels: tuple[str, ...] = ()
    hanging_wheels: tuple[str, ...] = ()

    @property
    def error(self) -> float:
        """The larger of both errors, m; inf where there is none, or one is no number."""
        found = [each for each in (self.base_error, self.end_effector_error) if each is not None]
        return max(found, default=math.inf) if all(map(math.isfinite, found)) else math.inf

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as JSON says them."""
        return asdict(self)


def figures_from(data: dict[str, Any]) -> StressFigures:
    """Return the figures that JSON says.

    Raises:
        TypeError: Some are missing, or are no figures.
    """
    lists = ("violations", "lifted_wheels", "hanging_wheels")
    return StressFigures(**{**data, **{name: tuple(data.get(name, ())) for name in lists}})


class StressVerdict(NamedTuple):
    """One of ``VERDICTS``, or ``"refused"``, and why, in words."""

    name: str
    reason: str


def error_text(error: float) -> str:
    """Return an error (m) in mm, in five characters at most; nothing where there is none."""
    millimetres = 1e3 * error
    if not math.isfinite(error):
        return ""
    if error >= 9.95:
        return f"{error:.0f} m" if error < 999.5 else "> km"
    if error >= 0.9995:
        return f"{error:.1f} m"
    digits = 2 if millimetres < 9.995 else 1 if millimetres < 99.95 else 0
    return f"{millimetres:.{digits}f}"


def rule(tolerance: float) -> str:
    """Return the rule in words.

    Args:
        tolerance: How far from its reference a run that passes may be, m.
    """
    return (
        f"{PASS}: tracked within all limits, base and end effector within {length(tolerance)} of "
        f"their references (rms of the second half). {DEGRADE}: tracked farther away, or late, or "
        f"the motion needs more grip than there is. {FAIL}: stuck, diverging, collided, ended "
        "early, a limit broken, or tipped over."
    )


def judge(figures: StressFigures, tolerance: float) -> StressVerdict:
    """Return the verdict on a run.

    Args:
        figures: What became of it.
        tolerance: How far from its reference a run that passes may be, m.
    """
    if figures.outcome == REFUSED:
        return StressVerdict(REFUSED, figures.sentence)
    fault = _fault(figures)
    wheels = _wheels_in_the_air(figures)
    if fault is not None:
        return StressVerdict(FAIL, fault + wheels)
    if figures.outcome == LATE:
        return StressVerdict(DEGRADE, f"late: {figures.sentence}{wheels}")
    if figures.would_slip:
        return StressVerdict(DEGRADE, "its wheels would slip")
    away = f"{length(figures.error)} from its reference"
    if figures.error <= tolerance:
        return StressVerdict(PASS, away)
    return StressVerdict(DEGRADE, away + wheels)


def _wheels_in_the_air(figures: StressFigures) -> str:
    """Return which wheels bore nothing, as the end of a reason; empty if all did."""
    if figures.hanging_wheels:
        return f"; {', '.join(figures.hanging_wheels)} bore nothing from the start"
    return f"; {', '.join(figures.lifted_wheels)} lifted" if figures.lifted_wheels else ""


def _fault(figures: StressFigures) -> str | None:
    """Return why a run fails, in words; None if it does not."""
    if figures.outcome not in SUCCESSES:
        return f"{figures.outcome}: {figures.sentence}"
    if figures.tilt > MAX_TILT:
        return f"tipped over: it leant {math.degrees(figures.tilt):.0f} degrees"
    if figures.would_tip:
        return "it would tip over"
    if figures.violations:
        more = len(figures.violations) - MOST_TOLD
        rest = f" and {more} more" if more > 0 else ""
        return f"broke {', '.join(figures.violations[:MOST_TOLD])}{rest}"
    return None if math.isfinite(figures.error) else "its error is not finite"
