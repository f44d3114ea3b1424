"""Durations and delays rounded to whole control periods, and notes on the rounding.

The loop samples at whole control periods only, so a duration ends with the last one that is within
it, and a delay is the nearest number of them; halves count up.
"""

from __future__ import annotations

import math

from rpctl.errors import require_positive

CONTROL_PERIOD = 0.002  # s, where none is asked for
WHOLE_PERIOD_TOLERANCE = 1e-6  # of a period: a quotient this near to a whole number counts as one


def whole_periods(duration: float, control_period: float) -> int:
    """Return how many control periods (s) lie within a duration (s); one at least.

    Raises:
        RpctlError: One of them is not positive.
    """
    require_positive("duration", duration)
    require_positive("control_period", control_period)
    return max(1, math.floor(duration / control_period + WHOLE_PERIOD_TOLERANCE))


def delay_periods(delay: float, control_period: float) -> int:
    """Return the number of control periods (s) nearest to a delay (s); halves count up."""
    return math.floor(delay / control_period + 0.5 + WHOLE_PERIOD_TOLERANCE)


def duration_note(asked: float, control_period: float) -> tuple[str, ...]:
    """Return the note that a run ends before the duration asked for (s), or none."""
    periods = whole_periods(asked, control_period)
    if _whole(asked, control_period, periods):
        return ()
    return (
        f"a duration of {asked:g} s is no whole number of control periods of {control_period:g} s: "
        f"the run ends at {periods * control_period:g} s",
    )


def log_note(every: int, control_period: float) -> tuple[str, ...]:
    """Return the note that not every sample is logged, or none.

    Args:
        every: Each so-many-th is.
        control_period: s.
    """
    if every == 1:
        return ()
    return (
        f"one sample of {every} is logged, each {every * control_period:g} s: figures and curves "
        "do not see what happens in between",
    )


def delay_note(asked: float, control_period: float) -> tuple[str, ...]:
    """Return the note that the delay is not the one asked for (s), or none."""
    periods = delay_periods(asked, control_period)
    if _whole(asked, control_period, periods):
        return ()
    return (
        f"a delay of {asked:g} s is no whole number of control periods of {control_period:g} s: "
        f"{periods * control_period:g} s are simulated",
    )


def _whole(time: float, control_period: float, periods: int) -> bool:
    return abs(time / control_period - periods) <= WHOLE_PERIOD_TOLERANCE
